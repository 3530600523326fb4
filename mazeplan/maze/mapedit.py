"""Edits of a map's YAML text that keep the rest of the file: comments, order, spacing, line ends.

The parser's marks give the place of a value in the text. An edit replaces only these characters, or adds or removes
lines. The map may have errors (openings may overlap while a user drags one), but `yamltree` must read it. Angles in
degrees and lengths in mm, as in the file; openings count from 0 in the file's order. (A round trip by ruamel.yaml would
change spacing and line breaks.)
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import yaml

from mazeplan.core.errors import MapError
from mazeplan.maze.mapfile import default_name
from mazeplan.maze.yamltree import Tree, parse_yaml, shown

ANGLE_STEP_DEG = 0.1  # finer than the precision of a cut
WIDTH_STEP_MM = 0.01

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_ODD_BREAK = re.compile("\r(?!\n)|[\x85\u2028\u2029]")  # ends a line in YAML, though editors disagree
_BOM = "\ufeff"


@dataclass(frozen=True)
class Written:
    """An opening in the text; name: as in logs; line: from 1."""

    index: int
    line: int
    name: str
    outer: int
    inner: int
    angle_deg: float
    width_mm: float
    closed: bool


def written_openings(text: str) -> tuple[Written, ...]:
    """The openings with readable rings and numbers, even if the map has other errors; none if it is no YAML."""
    try:
        tree = parse_yaml(text.removeprefix(_BOM), file="map", error=MapError)
    except MapError:
        return ()
    return tuple(_written(tree))


def move_opening(text: str, index: int, angle_deg: float) -> str:
    """Set the angle, rounded to `ANGLE_STEP_DEG`, in 0 to 360."""
    return _set(text, index, "angle_deg", _angle(angle_deg))


def widen_opening(text: str, index: int, width_mm: float) -> str:
    """Set the width, rounded to `WIDTH_STEP_MM`."""
    return _set(text, index, "width_mm", _width(width_mm))


def close_opening(text: str, index: int, closed: bool) -> str:
    """Close or open it for routes."""
    return _set(text, index, "closed", "true" if closed else "false")


def add_opening(text: str, outer: int, angle_deg: float, width_mm: float) -> str:
    """Add an opening in the wall inside ring `outer`, below the last one of that wall and in the same style."""
    found = _Text(text)
    pairs = [("rings", f"[{outer}, {outer + 1}]"), ("angle_deg", _angle(angle_deg)), ("width_mm", _width(width_mm))]
    return found.restored(found.added(outer, pairs))


def remove_opening(text: str, index: int) -> str:
    """Remove an opening. A comment on its lines stays, with the name of the opening."""
    found = _Text(text)
    return found.restored(found.removed(index))


def _set(text: str, index: int, key: str, value: str) -> str:
    found = _Text(text)
    return found.restored(found.with_value(index, key, value))


def _angle(degrees: float) -> str:
    steps = round(_finite(degrees) / ANGLE_STEP_DEG) % round(360.0 / ANGLE_STEP_DEG)
    return f"{steps * ANGLE_STEP_DEG:.1f}".removesuffix(".0")


def _width(millimetres: float) -> str:
    steps = round(_finite(millimetres) / WIDTH_STEP_MM)
    return f"{steps * WIDTH_STEP_MM:.2f}".rstrip("0").rstrip(".")


def _finite(number: float) -> float:
    if not math.isfinite(number):
        raise MapError(f"got {number}, expected a finite number", file="map")
    return number


def _written(tree: Tree) -> Iterator[Written]:
    data: dict[str, Any] = tree.data if isinstance(tree.data, dict) else {}
    items, rings = data.get("openings"), data.get("rings")
    last = len(rings) if isinstance(rings, list) else 0
    for index, item in enumerate(items if isinstance(items, list) else ()):
        pair: Any = item.get("rings") if isinstance(item, dict) else None
        if not (isinstance(pair, list) and len(pair) == 2 and all(type(ring) is int for ring in pair)):
            continue
        outer, inner = sorted(pair)
        numbers = [item.get("angle_deg"), item.get("width_mm")]
        if inner != outer + 1 or not 1 <= outer < last or any(type(x) not in (int, float) for x in numbers):
            continue
        angle, width = float(numbers[0] or 0.0), float(numbers[1] or 0.0)
        name = item.get("name")
        called = name if isinstance(name, str) else default_name(outer, inner, angle)
        line = tree.line(("openings", index))
        yield Written(index, line, called, outer, inner, angle, width, item.get("closed") is True)


class _Text:
    """A map's text with the places of its openings."""

    def __init__(self, text: str) -> None:
        self.bom = _BOM if text.startswith(_BOM) else ""
        self.text = text = text.removeprefix(_BOM)
        self.tree = parse_yaml(text, file="map", error=MapError)
        if odd := _ODD_BREAK.search(text):
            line = text.count("\n", 0, odd.start()) + 1
            raise MapError("has line ends that are neither LF nor CRLF, edit it by hand", file="map", line=line)
        self.newline = "\r\n" if "\r\n" in text else "\n"
        root: Any = yaml.compose(text, Loader=_LOADER)
        pairs = root.value if isinstance(root, yaml.MappingNode) else ()
        place = next(((key, value) for key, value in pairs if key.value == "openings"), None)
        if place is None:
            raise MapError("missing, expected a list of openings", file="map", key="openings")
        self.key, self.list = place
        if not isinstance(self.list, yaml.SequenceNode) and self.tree.data["openings"] is not None:
            raise self.refused(f"got {shown(self.tree.data['openings'])}, expected a list of openings")
        self.items: list[Any] = self.list.value if isinstance(self.list, yaml.SequenceNode) else []
        self.in_flow = bool(root.flow_style)
        self.comments = list(self._find_comments(root))

    def refused(self, problem: str, index: int | None = None) -> MapError:
        node = self.key if index is None else self.items[index]
        key = "openings" if index is None else f"openings[{index}]"
        return MapError(problem, file="map", line=node.start_mark.line + 1, key=key)

    def restored(self, text: str) -> str:
        return self.bom + text

    # -- places -----------------------------------------------------------------------------------------------------

    def _find_comments(self, root: Any) -> Iterator[tuple[int, int]]:
        """Start and end of every comment: a # that is in no scalar."""
        scalars = sorted((node.start_mark.index, node.end_mark.index) for node in _scalars(root))
        place, scalars = 0, [*scalars, (len(self.text), len(self.text))]
        for start, end in scalars:
            while (mark := self.text.find("#", place, start)) >= 0:
                place = mark + len(re.match(r"[^\r\n]*", self.text[mark:])[0])  # pyright: ignore[reportOptionalSubscript]
                yield mark, place
            place = max(place, end)

    def end_of(self, node: Any) -> int:
        """Where a node's own characters end: the parser ends one in block style only where the next thing begins."""
        if isinstance(node, yaml.ScalarNode):
            start, end = node.start_mark.index, node.end_mark.index
            return start + len(self.text[start:end].rstrip())
        if node.flow_style or not node.value:
            return node.end_mark.index
        last = node.value[-1]
        return self.end_of(last[1] if isinstance(last, tuple) else last)

    def line_end(self, place: int) -> int:
        """Where the line ends, before its break."""
        found = re.compile(r"\r?\n|\Z").search(self.text, place)
        return len(self.text) if found is None else found.start()

    def line_start(self, place: int) -> int:
        return self.text.rfind("\n", 0, place) + 1

    def next_mark(self, place: int) -> int:
        """The next character that is neither blank nor comment."""
        ends = dict(self.comments)
        while place < len(self.text) and (self.text[place].isspace() or place in ends):
            place = ends.get(place, place + 1)
        return place

    def dash(self, index: int) -> int:
        """Where the dash of an entry in block style stands."""
        return self.next_mark(self.end_of(self.items[index - 1]) if index else self.list.start_mark.index)

    def column(self, place: int) -> int:
        return place - self.line_start(place)

    def replaced(self, start: int, end: int, by: str) -> str:
        return self.text[:start] + by + self.text[end:]

    def new_lines(self, place: int, lines: list[str]) -> str:
        """With lines below the one that holds `place`."""
        end = self.line_end(place)
        return self.replaced(end, end, "".join(self.newline + line for line in lines))

    # -- edits ------------------------------------------------------------------------------------------------------

    def with_value(self, index: int, key: str, value: str) -> str:
        item = self.entry(index)
        for name, node in item.value:
            if name.value != key:
                continue
            start, end = node.start_mark.index, self.end_of(node)
            if not isinstance(node, yaml.ScalarNode):
                raise self.refused(f"{key} is no number, expected one to edit", index)
            return self.replaced(start, end, value if end > start else f" {value}")
        end = self.end_of(item)
        if item.flow_style:
            last = item.value[-1][1]
            end = self.end_of(last)
            gap = " " if end == last.start_mark.index else ""  # behind a bare colon
            return self.replaced(end, end, f"{gap}, {key}: {value}")
        return self.new_lines(end, [" " * item.start_mark.column + f"{key}: {value}"])

    def entry(self, index: int) -> Any:
        if not 0 <= index < len(self.items):
            raise self.refused(f"got the number {index}, expected one of the {len(self.items)} openings")
        item = self.items[index]
        if not isinstance(item, yaml.MappingNode) or not item.value:
            raise self.refused("expected keys such as rings, angle_deg, width_mm", index)
        return item

    def added(self, outer: int, pairs: list[tuple[str, str]]) -> str:
        flow = "{" + ", ".join(f"{key}: {value}" for key, value in pairs) + "}"
        if not self.items:
            return self._added_first(flow)
        walls = {opening.index: opening.outer for opening in _written(self.tree)}
        before = max((i for i, wall in walls.items() if wall == outer), default=len(self.items) - 1)
        above, end = self.items[before], self.end_of(self.items[before])
        if self.list.flow_style:
            return self.replaced(end, end, f", {flow}")
        dash = self.dash(before)
        indent = " " * self.column(dash)
        if above.flow_style or not isinstance(above, yaml.MappingNode):
            return self.new_lines(end, [f"{indent}- {flow}"])
        same_line = self.line_start(dash) == self.line_start(above.start_mark.index)
        inner = " " * (above.start_mark.column - len(indent) - 1 if same_line else 1)
        rows = [f"{key}: {value}" for key, value in pairs]
        return self.new_lines(end, [f"{indent}-{inner}{rows[0]}", *(f"{indent} {inner}{row}" for row in rows[1:])])

    def _added_first(self, flow: str) -> str:
        """Into an empty list: on a line of its own, where the list has no lines yet."""
        start, end = self.list.start_mark.index, self.list.end_mark.index
        row = " " * (self.key.start_mark.column + 2) + f"- {flow}"
        if not isinstance(self.list, yaml.SequenceNode):  # nothing behind the colon
            return self.replaced(start, self.end_of(self.list), f" [{flow}]") if self.in_flow else self._below(row, "")
        if self.in_flow or self.text[start:end].strip("[] "):
            return self.replaced(start + 1, start + 1, flow)
        return self._below(row, self.text[start:end])

    def _below(self, row: str, instead_of: str) -> str:
        """A first line below the key, instead of what stood beside it."""
        start = self.list.start_mark.index
        end = start + len(instead_of) if instead_of else self.end_of(self.list)
        head = self.text[:start].rstrip(" ")
        rest = self.text[end:]
        stop = self.line_end(end) - end
        return head + rest[:stop].rstrip() + self.newline + row + rest[stop:]

    def removed(self, index: int) -> str:
        if not 0 <= index < len(self.items):
            raise self.refused(f"got the number {index}, expected one of the {len(self.items)} openings")
        if self.list.flow_style:
            return self._removed_from_flow(index)
        start, end = self.line_start(self.dash(index)), self.line_end(self.end_of(self.items[index]))
        kept = "".join(line + self.newline for line in self._kept(index, start, end))
        after = end + len(re.match(r"\r?\n|", self.text[end:])[0])  # pyright: ignore[reportOptionalSubscript]
        text = self.replaced(start, after, kept)
        if len(self.items) > 1:
            return text
        colon = self.next_mark(self.end_of(self.key)) + 1
        return text[:colon] + " []" + text[colon:]

    def _removed_from_flow(self, index: int) -> str:
        start, end = self.items[index].start_mark.index, self.items[index].end_mark.index
        kept = "".join(self.text[a:b] + self.newline for a, b in self.comments if start <= a < end)
        comma = self.next_mark(end)
        if self.text[comma] == ",":
            kept, end = kept + self.text[end:comma].lstrip(" "), comma + 1
        elif before := re.search(r", *\Z", self.text[:start]):
            start = before.start()
        if not kept:
            first, last = self.line_start(start), self.line_end(end)
            if not (self.text[first:start] + self.text[end:last]).strip():
                return self.replaced(first, min(last + len(self.newline), len(self.text)), "")
            if self.text[start - 1] in "[ " and self.text[end : end + 1] == " ":
                end += 1
        return self.replaced(start, end, kept)

    def _kept(self, index: int, start: int, end: int) -> Iterator[str]:
        """The comments among the lines of an entry, as lines of their own."""
        called = next((o.name for o in _written(self.tree) if o.index == index), f"openings[{index}]")
        for mark, stop in self.comments:
            if not start <= mark < end:
                continue
            first = self.line_start(mark)
            if not self.text[first:mark].strip():
                yield self.text[first:stop]
            else:
                indent = " " * self.column(self.dash(index))
                yield f"{indent}# removed {called}: {self.text[mark:stop].lstrip('# ')}"


def _scalars(node: Any) -> Iterator[Any]:
    if isinstance(node, yaml.ScalarNode):
        yield node
    for child in node.value if not isinstance(node, yaml.ScalarNode) else ():
        for part in child if isinstance(child, tuple) else (child,):
            yield from _scalars(part)
