"""Replaces a section in the text of a YAML file. Comments and everything else stay in their places.

    camera:                # the old one        camera:                # the old one
      source: 0            # by the window  ->    source: 0            # by the window
      size: [640, 480]     # large                size: [1280, 720]    # large
                                                  focal_px: [...]

New values replace old ones. New keys come last, and keys that the new section lacks are removed. A comment inside a
replaced or removed value stays, above the place of the value. The marks of the YAML parser say where to cut the text.
The result is parsed again and must have the new values.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from mazeplan.core.errors import SettingsError
from mazeplan.maze.yamltree import parse_yaml

WIDTH = 100
Cut = tuple[int, int, str]  # start and end in characters of the text, replacement


def merged(text: str, key: str, value: Any, *, file: str | Path) -> str:
    """The text with `key: value` at its top level.

    Raises SettingsError for text that is no YAML, or whose form this module cannot edit."""
    before = parse_yaml(text, file=file, error=SettingsError).data
    wanted = dict(before) | parse_yaml("\n".join(_dumped({key: value})), file=file, error=SettingsError).data
    edit = _Edit(text)
    for attempt in (edit.within, edit.whole):
        try:
            new = attempt(key, value)
            if parse_yaml(new, file=file, error=SettingsError).data == wanted:
                return new
        except (SettingsError, LookupError):
            continue
    raise SettingsError(f"cannot be written: {key} is in a form that this program does not know", file=file)


def _dumped(data: Mapping[str, Any], indent: int = 0, width: int = WIDTH) -> list[str]:
    """Lines of YAML for a mapping, as a block. The innermost collections are on one line each."""
    lines: list[str] = []
    for key, value in data.items():
        style = None if isinstance(value, Mapping | list | tuple) else False
        text = yaml.safe_dump({key: value}, sort_keys=False, default_flow_style=style, width=width, allow_unicode=True)
        lines += text.rstrip("\n").split("\n")
    return [" " * indent + line if line else line for line in lines]


class _Edit:
    """A text, its nodes and its comments."""

    def __init__(self, text: str) -> None:
        self.text = text if text.endswith("\n") else text + "\n"
        self.root = yaml.compose(self.text, Loader=yaml.SafeLoader)
        self._comments = _comments(self.text)
        self._cuts: list[Cut] = []

    def within(self, key: str, value: Any) -> str:
        """The text with each value of the section replaced in its place. Adds the section if it is missing."""
        self._cuts = []
        found = self._found(key)
        if found is None:
            return "".join((self.text, *(f"{line}\n" for line in _dumped({key: value}))))
        self._put(*found, key, value)
        return self._result()

    def whole(self, key: str, value: Any) -> str:
        """The text with the whole section replaced; the comments of the section move above it."""
        self._cuts = []
        found = self._found(key)
        if found is None:
            raise LookupError(key)
        begin, end = self._line(found[0].start_mark.index), self._end(found[1])
        lines = [*self._rescued(begin, self._line_end(end), ""), *_dumped({key: value})]
        self._cuts.append((begin, self._line_end(end), "\n".join(lines)))
        return self._result()

    def _found(self, key: str) -> tuple[yaml.Node, yaml.Node] | None:
        if not isinstance(self.root, yaml.MappingNode) or self.root.flow_style:
            raise LookupError(key)
        return next((pair for pair in self.root.value if pair[0].value == key), None)

    def _put(self, name: yaml.Node, node: yaml.Node, key: str, value: Any) -> None:
        indent = name.start_mark.column
        if isinstance(value, Mapping) and isinstance(node, yaml.MappingNode) and not node.flow_style:
            kept = [(k, v) for k, v in node.value if k.value in value]
            if kept:
                self._merge(node, kept, value)
                return
        start, end = name.start_mark.index, self._end(node)
        if self._said(start, end) == {key: value}:
            return
        tail = self.text[end : self._line_end(end)]
        lines = _dumped({key: value}, indent)
        if tail.strip() and not lines[0].rstrip().endswith(":"):
            lines = _dumped({key: value}, indent, 10_000)  # a comment follows: one line, if possible
        above = "".join(f"{line.lstrip()}\n{' ' * indent}" for line in self._rescued(start, end, ""))
        self._cuts.append((start, end, above + lines[0].lstrip()))
        if lines[1:]:
            self._cuts.append((self._line_end(end), self._line_end(end), "".join(f"\n{line}" for line in lines[1:])))

    def _merge(self, node: yaml.MappingNode, kept: list[tuple[yaml.Node, yaml.Node]], value: Mapping[str, Any]) -> None:
        indent = node.value[0][0].start_mark.column
        for name, old in node.value:
            if name.value in value:
                self._put(name, old, name.value, value[name.value])
            else:
                self._take_out(name.start_mark.index, self._end(old), indent)
        new = {k: v for k, v in value.items() if k not in {name.value for name, _ in kept}}
        if new:
            at = self._line_end(self._end(kept[-1][1]))
            self._cuts.append((at, at, "".join(f"\n{line}" for line in _dumped(new, indent))))

    def _take_out(self, start: int, end: int, indent: int) -> None:
        stop = self._line_end(end)
        rescued = self._rescued(start, stop, " " * indent)
        self._cuts.append((self._line(start), stop + 1, "".join(f"{line}\n" for line in rescued)))

    def _result(self) -> str:
        out, at = [], 0
        for begin, end, new in sorted(self._cuts, key=lambda cut: cut[:2]):  # stable: in the order of their creation
            if begin < at:
                raise LookupError("cuts overlap")
            out += [self.text[at:begin], new]
            at = end
        return "".join([*out, self.text[at:]])

    def _said(self, begin: int, end: int) -> Any:
        try:
            return parse_yaml(self.text[begin:end], file="", error=SettingsError).data
        except SettingsError:
            return None

    def _rescued(self, begin: int, end: int, indent: str) -> list[str]:
        """The comments between two places in the text, as lines."""
        return [f"{indent}{comment}" for at, comment in self._comments if begin <= at < end]

    def _end(self, node: yaml.Node) -> int:
        """End of a node's text. For a block this is the end of its last value, not the start of the next key."""
        if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
            last = node.value[-1]
            return self._end(last[1] if isinstance(last, tuple) else last)
        return max(node.start_mark.index, len(self.text[: node.end_mark.index].rstrip()))

    def _line(self, at: int) -> int:
        return self.text.rfind("\n", 0, at) + 1

    def _line_end(self, at: int) -> int:
        return self.text.index("\n", at)


def _comments(text: str) -> list[tuple[int, str]]:
    """(place, comment) of each comment: from a # after a blank or at the start of a line, outside scalars."""
    spans = [
        (token.start_mark.index, token.end_mark.index)
        for token in yaml.scan(text, Loader=yaml.SafeLoader)
        if isinstance(token, yaml.ScalarToken)
    ]
    starts, found, at = [begin for begin, _ in spans], [], 0
    pattern = re.compile(r"(?:^|(?<=\s))#[^\n]*", re.MULTILINE)
    while (match := pattern.search(text, at)) is not None:
        k = bisect_right(starts, match.start()) - 1
        if k >= 0 and match.start() < spans[k][1]:
            at = spans[k][1]
            at = max(at, match.start() + 1)
            continue
        found.append((match.start(), match[0].rstrip()))
        at = match.end()
    return found
