"""Edits one list in a YAML text and keeps the rest of the file: comments, order, spacing, line ends.

The parser's marks give the place of a value in the text. An edit replaces only these characters, or adds or removes
lines. (To read and write the file with ruamel.yaml would change spacing and line breaks.)
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Any

import yaml

from mazeplan.core.errors import MapError
from mazeplan.maze.yamltree import parse_yaml, shown

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_ODD_BREAK = re.compile("\r(?!\n)|[\x85\u2028\u2029]")  # ends a line in YAML, though editors disagree
BOM = "\ufeff"

Pairs = list[tuple[str, str]]  # keys of an entry with the text of their values
Span = tuple[int, int, str]  # start and end of characters, and what replaces them


def applied(text: str, spans: Iterable[Span]) -> str:
    """The text with all spans replaced. Spans must not overlap."""
    for start, end, by in sorted(spans, reverse=True):
        text = text[:start] + by + text[end:]
    return text


class ListText:
    """A YAML text with the places of one of its lists.

    section: key of the list in the top mapping
    optional: whether the list may be missing

    The attribute `text` is without the byte order mark; the edits return whole texts with it. Raises MapError for a
    text that cannot be edited."""

    def __init__(self, text: str, section: str, *, optional: bool = False) -> None:
        self.section = section
        self.bom = BOM if text.startswith(BOM) else ""
        self.text = text = text.removeprefix(BOM)
        self.tree = parse_yaml(text, file="map", error=MapError)
        if odd := _ODD_BREAK.search(text):
            line = text.count("\n", 0, odd.start()) + 1
            raise MapError("has line ends that are neither LF nor CRLF, edit it by hand", file="map", line=line)
        self.newline = "\r\n" if "\r\n" in text else "\n"
        self.root: Any = yaml.compose(text, Loader=_LOADER)
        pairs = self.root.value if isinstance(self.root, yaml.MappingNode) else ()
        place = next(((key, value) for key, value in pairs if key.value == section), None)
        if place is None and not (optional and pairs):
            raise MapError(f"missing, expected a list of {section}", file="map", key=section)
        self.key: Any = place and place[0]  # None if there is no list
        self.list: Any = place and place[1]
        if place and not isinstance(self.list, yaml.SequenceNode) and self.tree.data[section] is not None:
            raise self.refused(f"got {shown(self.tree.data[section])}, expected a list of {section}")
        self.items: list[Any] = self.list.value if isinstance(self.list, yaml.SequenceNode) else []
        self.in_flow = bool(self.root.flow_style)
        self.comments = list(self._find_comments(self.root))

    def refused(self, problem: str, index: int | None = None) -> MapError:
        """The error about the list, or about one entry, with its line."""
        node = self.key if index is None else self.items[index]
        key = self.section if index is None else f"{self.section}[{index}]"
        return MapError(problem, file="map", line=None if node is None else node.start_mark.line + 1, key=key)

    # -- places -----------------------------------------------------------------------------------------------------

    def _find_comments(self, root: Any) -> Iterator[tuple[int, int]]:
        """Start and end of every comment. A comment begins with a # outside all scalars."""
        scalars = sorted((node.start_mark.index, node.end_mark.index) for node in _scalars(root))
        place, scalars = 0, [*scalars, (len(self.text), len(self.text))]
        for start, end in scalars:
            while (mark := self.text.find("#", place, start)) >= 0:
                place = mark + len(re.match(r"[^\r\n]*", self.text[mark:])[0])  # pyright: ignore[reportOptionalSubscript]
                yield mark, place
            place = max(place, end)

    def end_of(self, node: Any) -> int:
        """Where the characters of a node end. The parser's mark is of no use in block style: it is where the next node
        begins."""
        if isinstance(node, yaml.ScalarNode):
            start, end = node.start_mark.index, node.end_mark.index
            return start + len(self.text[start:end].rstrip())
        if node.flow_style or not node.value:
            return node.end_mark.index
        last = node.value[-1]
        return self.end_of(last[1] if isinstance(last, tuple) else last)

    def line_end(self, place: int) -> int:
        """Where the line of a place ends, before its line break."""
        found = re.compile(r"\r?\n|\Z").search(self.text, place)
        return len(self.text) if found is None else found.start()

    def line_start(self, place: int) -> int:
        """Where the line of a place begins."""
        return self.text.rfind("\n", 0, place) + 1

    def next_mark(self, place: int) -> int:
        """Place of the next character that is neither blank nor in a comment."""
        ends = dict(self.comments)
        while place < len(self.text) and (self.text[place].isspace() or place in ends):
            place = ends.get(place, place + 1)
        return place

    def dash(self, index: int) -> int:
        """Where the dash of an entry in block style stands."""
        return self.next_mark(self.end_of(self.items[index - 1]) if index else self.list.start_mark.index)

    def column(self, place: int) -> int:
        """Characters before a place in its line."""
        return place - self.line_start(place)

    def comments_of(self, index: int) -> Iterator[tuple[int, int]]:
        """Start and end of the comments on the lines of an entry in block style."""
        if not self.list.flow_style:
            start, end = self.line_start(self.dash(index)), self.line_end(self.end_of(self.items[index]))
            yield from ((mark, stop) for mark, stop in self.comments if start <= mark < end)

    def node(self, index: int, key: str) -> Any:
        """The node of a value; None if the entry does not have this key."""
        return next((node for name, node in self.entry(index).value if name.value == key), None)

    def span(self, node: Any, value: str) -> Span:
        """The span that replaces a scalar by `value`."""
        return node.start_mark.index, self.end_of(node), value

    def replaced(self, start: int, end: int, by: str) -> str:
        """The whole text with `by` in place of the characters from start to end."""
        return self.bom + self.text[:start] + by + self.text[end:]

    def new_lines(self, place: int, lines: list[str]) -> str:
        """The whole text with new lines below the line of `place`."""
        end = self.line_end(place)
        return self.replaced(end, end, "".join(self.newline + line for line in lines))

    # -- edits ------------------------------------------------------------------------------------------------------

    def with_value(self, index: int, key: str, value: str) -> str:
        """Set a value of an entry, or add the key with this value."""
        item = self.entry(index)
        if (node := self.node(index, key)) is not None:
            start, end = node.start_mark.index, self.end_of(node)
            if not isinstance(node, yaml.ScalarNode):
                raise self.refused(f"{key} is no number, expected one to edit", index)
            return self.replaced(start, end, value if end > start else f" {value}")
        end = self.end_of(item)
        if item.flow_style:
            last = item.value[-1][1]
            end = self.end_of(last)
            gap = " " if end == last.start_mark.index else ""  # the last key has no value: a blank after its colon
            return self.replaced(end, end, f"{gap}, {key}: {value}")
        return self.new_lines(end, [" " * item.start_mark.column + f"{key}: {value}"])

    def entry(self, index: int) -> Any:
        """The node of an entry."""
        self._check_index(index)
        item = self.items[index]
        if not isinstance(item, yaml.MappingNode) or not item.value:
            raise self.refused("expected keys such as rings, angle_deg, width_mm", index)
        return item

    def _check_index(self, index: int) -> None:
        if not 0 <= index < len(self.items):
            raise self.refused(f"got the number {index}, expected one of the {len(self.items)} {self.section}")

    def added(self, index: int, pairs: Pairs) -> str:
        """Add an entry at this index, in the style of its neighbour."""
        flow = "{" + ", ".join(f"{key}: {value}" for key, value in pairs) + "}"
        if not self.items:
            return self._added_first(flow)
        near = max(index - 1, 0)
        item = self.items[near]
        start, end = item.start_mark.index, self.end_of(item)
        if self.list.flow_style:
            return self.replaced(end, end, f", {flow}") if index else self.replaced(start, start, f"{flow}, ")
        rows = self._rows(near, flow, pairs)
        if index:
            return self.new_lines(end, rows)
        above = self.line_start(self.dash(0))
        return self.replaced(above, above, "".join(row + self.newline for row in rows))

    def _rows(self, near: int, flow: str, pairs: Pairs) -> list[str]:
        """The lines of a new entry, in the style of entry `near`."""
        dash, item = self.dash(near), self.items[near]
        indent = " " * self.column(dash)
        if item.flow_style or not isinstance(item, yaml.MappingNode):
            return [f"{indent}- {flow}"]
        same_line = self.line_start(dash) == self.line_start(item.start_mark.index)
        inner = " " * (item.start_mark.column - len(indent) - 1 if same_line else 1)
        rows = [f"{key}: {value}" for key, value in pairs]
        return [f"{indent}-{inner}{rows[0]}", *(f"{indent} {inner}{row}" for row in rows[1:])]

    def _added_first(self, flow: str) -> str:
        """Add the first entry of an empty or missing list, on a new line if the style of the file allows it."""
        if self.key is None:
            return self._with_list(flow)
        start, end = self.list.start_mark.index, self.list.end_mark.index
        row = " " * (self.key.start_mark.column + 2) + f"- {flow}"
        if not isinstance(self.list, yaml.SequenceNode):  # there is nothing after the colon
            return self.replaced(start, self.end_of(self.list), f" [{flow}]") if self.in_flow else self._below(row, "")
        if self.in_flow or self.text[start:end].strip("[] "):
            return self.replaced(start + 1, start + 1, flow)
        return self._below(row, self.text[start:end])

    def _with_list(self, flow: str) -> str:
        """Add the list with its first entry at the end of the file."""
        end = self.end_of(self.root.value[-1][1])
        if self.in_flow:
            return self.replaced(end, end, f", {self.section}: [{flow}]")
        kept, indent = self.text.rstrip(), " " * self.root.start_mark.column
        lines = ["", "", f"{indent}{self.section}:", f"{indent}  - {flow}", ""]
        return self.replaced(len(kept), len(self.text), self.newline.join(lines))

    def _below(self, row: str, instead_of: str) -> str:
        """Add the first line below the key, and remove the text `instead_of` beside the key."""
        start = self.list.start_mark.index
        end = start + len(instead_of) if instead_of else self.end_of(self.list)
        head = self.text[:start].rstrip(" ")
        rest = self.text[end:]
        stop = self.line_end(end) - end
        return self.bom + head + rest[:stop].rstrip() + self.newline + row + rest[stop:]

    def removed(self, index: int, called: str) -> str:
        """Remove an entry. Its comments stay as lines that say what was removed. called: the name of the entry."""
        self._check_index(index)
        if self.list.flow_style:
            return self._removed_from_flow(index)
        start, end = self.line_start(self.dash(index)), self.line_end(self.end_of(self.items[index]))
        kept = "".join(line + self.newline for line in self._kept(index, called))
        after = end + len(re.match(r"\r?\n|", self.text[end:])[0])  # pyright: ignore[reportOptionalSubscript]
        text = self.replaced(start, after, kept)
        if len(self.items) > 1:
            return text
        colon = len(self.bom) + self.next_mark(self.end_of(self.key)) + 1
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

    def _kept(self, index: int, called: str) -> Iterator[str]:
        """The lines that keep the comments of a removed entry."""
        for mark, stop in self.comments_of(index):
            first = self.line_start(mark)
            if not self.text[first:mark].strip():
                yield self.text[first:stop]
                continue
            indent, comment = " " * self.column(self.dash(index)), self.text[mark:stop].lstrip("# ")
            # a comment that begins with the name does not need it again
            yield f"{indent}# removed {comment if comment.startswith(called) else f'{called}: {comment}'}"


def _scalars(node: Any) -> Iterator[Any]:
    if isinstance(node, yaml.ScalarNode):
        yield node
    for child in node.value if not isinstance(node, yaml.ScalarNode) else ():
        for part in child if isinstance(child, tuple) else (child,):
            yield from _scalars(part)
