"""Reads YAML files that people write, and keeps the line of every key.

The reader accepts a small part of YAML: mappings with plain keys, lists, text, numbers, true/false, null. It refuses
tags, anchors and aliases, tabs, duplicate keys, deep nesting and a second document. `yes`, `no` and `1:30` are text. It
works on the parser's events, so it checks before it builds. `MAX_BYTES` and `MAX_ENTRIES` bound the work.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import yaml

from mazeplan.core import file_kinds
from mazeplan.core.errors import InputError
from mazeplan.core.file_format import format_problem

MAX_BYTES = 1 << 20
MAX_ENTRIES = 20_000  # scalars and containers in one file
MAX_DEPTH = 10
MAX_TEXT = 500  # characters in one scalar

Key = tuple[str | int, ...]

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_INTEGER = re.compile(r"[-+]?[0-9]{1,15}")
_DIGITS = re.compile(r"[0-9]{1,15}")
_NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.?(inf|infinity|nan)", re.IGNORECASE)
_GLUED = re.compile(r"(- )?[\w-]+:[^\s/]")  # a key without a blank after its colon; not an address
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")


@dataclass(frozen=True)
class Tree:
    """Content of a file (dict, list, str, int, float, bool, None) and the line, from 1, of every key path."""

    data: Any
    lines: dict[Key, int]

    def line(self, key: Key) -> int:
        """Line of a key, or of the nearest parent in the file."""
        while key and key not in self.lines:
            key = key[:-1]
        return self.lines.get(key, 1)


def key_path(key: Key) -> str:
    """Text of a key path: `openings[0].angle_deg` for `("openings", 0, "angle_deg")`."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += ("." if text else "") + (part if re.fullmatch(r"[\w-]{1,40}", part) else shown(part))
    return text


def shown(value: Any) -> str:
    """A value as short text for messages, on one line."""
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "nothing"}[value]
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list):
        return "a list"
    text = repr(value)
    return text if len(text) <= 50 else text[:45] + "...'"


def read_yaml(path: Path, *, error: type[InputError] = InputError, what: str = "a YAML file") -> Tree:
    """Read one file; what: the expected content. Raises `error` with file and line."""
    try:
        status = path.stat()
        if not path.is_file() or not status.st_size:
            raise error(file_kinds.refused(path, what), file=path)
        if status.st_size > MAX_BYTES:
            raise error(f"got {status.st_size} bytes, expected {what} of at most {MAX_BYTES}", file=path)
        with path.open("rb") as stream:
            content = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError):  # ValueError: a name with a zero byte
        named = shown(str(path)) if "\0" in str(path) else path
        raise error(file_kinds.refused(path, what), file=named) from None
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        line = content.count(b"\n", 0, problem.start) + 1
        raise error(file_kinds.refused(path, what), file=path, line=line) from None
    kind = file_kinds.got(path)
    if kind in ("XML", "HTML", "a file with nothing but blanks"):
        raise error(f"got {kind}, expected {what}", file=path, line=1)
    return parse_yaml(text, file=path, error=error, language="JSON" if kind == "JSON" else "YAML")


def parse_yaml(text: str, *, file: str | Path, error: type[InputError] = InputError, language: str = "YAML") -> Tree:
    """Parse YAML text; file, language: names in messages. Raises `error` with the line."""
    if bad := _CONTROL.search(text):
        line = text.count("\n", 0, bad.start()) + 1
        raise error(f"not a text file: holds the control character {ord(bad[0]):#04x}", file=file, line=line)
    for number, row in enumerate(text.split("\n") if "\t" in text else (), start=1):
        if "\t" in row.split("#", 1)[0]:
            raise error("got a tab, expected spaces", file=file, line=number)
    builder = _Builder(text, file, error)
    try:
        return builder.document()
    except yaml.YAMLError as problem:
        mark = getattr(problem, "problem_mark", None)
        said = getattr(problem, "problem", None) or getattr(problem, "reason", None) or "cannot be parsed"
        line = None if mark is None else mark.line + 1
        if glued := _glued(text.split("\n"), problem):
            raise error(f"{glued[1]}: a blank is missing after the colon", file=file, line=glued[0]) from None
        raise error(f"not valid {language}: {' '.join(str(said).split())}", file=file, line=line) from None


def _glued(rows: list[str], problem: Any) -> tuple[int, str] | None:
    """Line and text of a key without a blank after its colon, if such a key caused the parser's problem; else None."""
    begin = getattr(problem, "context_mark", None)  # where the parser expected a key
    said, found = str(getattr(problem, "problem", "")), None
    if begin is not None and "expected ':'" in said:
        places = [begin.line]
    elif said.startswith(("mapping values are not", "did not find expected key", "did not find expected <document")):
        places = range(problem.problem_mark.line, -1, -1)  # the parser reads all such rows before as one text
    else:
        return None
    for place in places:
        row = rows[place].split(" #", 1)[0].strip() if place < len(rows) else ""
        if _GLUED.match(row):
            found = place + 1, row.removeprefix("- ")[:MAX_TEXT]
        elif place < places[0]:
            break
    return found


def check_format(tree: Tree, reads: int, *, file: str | Path, error: type[InputError] = InputError) -> None:
    """Refuse a file with a `format` other than `reads`. A file without `format` is accepted.

    Raises `error` with file and line."""
    if isinstance(tree.data, dict) and "format" in tree.data:
        problem = format_problem(tree.data["format"], reads, tree.data.get("version"))
        if problem is not None:
            raise error(problem, file=file, line=tree.line(("format",)), key="format")


class _Builder:
    """Builds data and lines in one pass over the parser's events."""

    def __init__(self, text: str, file: str | Path, error: type[InputError]) -> None:
        self.file, self.error = file, error
        self.events: Iterator[Any] = yaml.parse(text, Loader=_LOADER)
        self.entries = 0
        self.lines: dict[Key, int] = {}

    def fail(self, problem: str, event: Any, key: Key = ()) -> NoReturn:
        raise self.error(problem, file=self.file, line=event.start_mark.line + 1, key=key_path(key) or None)

    def document(self) -> Tree:
        next(self.events)  # start of the stream
        event = next(self.events)
        if isinstance(event, yaml.StreamEndEvent):
            raise self.error("the file is empty", file=self.file)
        data = self.node(next(self.events), (), 0)
        if data is None:
            raise self.error("the file is empty", file=self.file)
        next(self.events)  # end of the document
        event = next(self.events)
        if not isinstance(event, yaml.StreamEndEvent):
            self.fail("got a second document, expected one", event)
        return Tree(data, self.lines)

    def node(self, event: Any, key: Key, depth: int) -> Any:
        self.entries += 1
        if self.entries > MAX_ENTRIES:
            self.fail(f"got more than {MAX_ENTRIES} entries", event)
        if depth > MAX_DEPTH:
            self.fail(f"nested more than {MAX_DEPTH} deep", event)
        if isinstance(event, yaml.AliasEvent) or event.anchor is not None:
            self.fail("anchors (&) and aliases (*) are not allowed: write the value out", event, key)
        if event.tag is not None:
            self.fail(f"tags ({shown(event.tag)}) are not allowed", event, key)
        self.lines.setdefault(key, event.start_mark.line + 1)
        if isinstance(event, yaml.MappingStartEvent):
            return self.mapping(key, depth, event.flow_style)
        if isinstance(event, yaml.SequenceStartEvent):
            return self.sequence(key, depth)
        return self.scalar(event, key)

    def mapping(self, key: Key, depth: int, flow: bool) -> dict[str, Any]:
        data: dict[str, Any] = {}
        after: Any = None
        while not isinstance(event := next(self.events), yaml.MappingEndEvent):
            if isinstance(event, yaml.AliasEvent):
                self.fail("anchors (&) and aliases (*) are not allowed: write the value out", event, key)
            if not isinstance(event, yaml.ScalarEvent):
                self.fail("got a key that is itself a list or mapping, expected a word", event, key)
            if event.anchor is not None or event.tag is not None:
                self.fail("tags (!) and anchors (&) are not allowed", event, key)
            if len(event.value) > MAX_TEXT:
                self.fail(f"got a key of {len(event.value)} characters, expected at most {MAX_TEXT}", event, key)
            path = (*key, event.value)
            if event.value in data:
                self.fail(f"got the same key twice, first in line {self.lines[path]}", event, path)
            self.lines[path] = event.start_mark.line + 1
            before, after = after, next(self.events)
            if flow and _halves_of_number(before, event, after):
                got = f"{before.value},{event.value}"
                self.fail(
                    f"got {got}, expected a number with a point: {got.replace(',', '.')}",
                    event,
                    (*key, next(reversed(data))),
                )
            data[event.value] = self.node(after, path, depth + 1)
        return data

    def sequence(self, key: Key, depth: int) -> list[Any]:
        data: list[Any] = []
        while not isinstance(event := next(self.events), yaml.SequenceEndEvent):
            data.append(self.node(event, (*key, len(data)), depth + 1))
        return data

    def scalar(self, event: Any, key: Key) -> str | int | float | bool | None:
        text = event.value
        if len(text) > MAX_TEXT:
            self.fail(f"got text of {len(text)} characters, expected at most {MAX_TEXT}", event, key)
        return text if event.style else plain_value(text)


def _halves_of_number(before: Any, key: Any, after: Any) -> bool:
    """Whether a value and the next key, which has no value, are a number with a decimal comma: {width: 15,3}."""
    number = isinstance(before, yaml.ScalarEvent) and _INTEGER.fullmatch(before.value)
    return bool(number and _DIGITS.fullmatch(key.value) and isinstance(after, yaml.ScalarEvent) and not after.value)


def plain_value(text: str) -> str | int | float | bool | None:
    """Value of an unquoted scalar."""
    if text in ("", "~") or text.lower() == "null":
        return None
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    if _INTEGER.fullmatch(text):
        return int(text)
    if _NUMBER.fullmatch(text):
        return float(text)
    if _NOT_FINITE.fullmatch(text):
        return float(text.replace(".", ""))
    return text
