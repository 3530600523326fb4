"""Reads YAML files that people write, and keeps the line of every key.

The reader accepts a small part of YAML: mappings, lists, text, numbers, true/false, null. It refuses tags, anchors,
aliases, duplicate keys, deep nesting and a second document. `yes`, `no` and `1:30` are text. `MAX_BYTES`, `MAX_ENTRIES`
and `MAX_DEPTH` bound the work. PyYAML's compiled parser makes the nodes: that of ruamel.yaml takes 50 times as long.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from mazeplan.core import file_kinds
from mazeplan.core.errors import InputError
from mazeplan.core.file_kinds import format_problem

MAX_BYTES = 1 << 20
MAX_ENTRIES = 20_000  # scalars and containers in one file
MAX_DEPTH = 10
MAX_TEXT = 500  # characters in one scalar

Key = tuple[str | int, ...]

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_INTEGER = re.compile(r"[-+]?[0-9]{1,15}")
_NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.?(inf|infinity|nan)", re.IGNORECASE)


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
        size = path.stat().st_size
        if not path.is_file() or not size:
            raise error(file_kinds.refused(path, what), file=path)
        if size > MAX_BYTES:
            raise error(f"got {size} bytes, expected {what} of at most {MAX_BYTES}", file=path)
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as problem:
        line = problem.object.count(b"\n", 0, problem.start) + 1
        raise error(file_kinds.refused(path, what), file=path, line=line) from None
    except (OSError, ValueError):  # ValueError: a name with a zero byte
        named = shown(str(path)) if "\0" in str(path) else path
        raise error(file_kinds.refused(path, what), file=named) from None
    kind = file_kinds.got(path)
    if kind in ("XML", "an empty file"):
        raise error(f"got {kind}, expected {what}", file=path, line=1)
    return parse_yaml(text, file=path, error=error, language="JSON" if kind == "JSON" else "YAML")


def parse_yaml(text: str, *, file: str | Path, error: type[InputError] = InputError, language: str = "YAML") -> Tree:
    """Parse YAML text; file, language: names in messages. Raises `error` with the line."""
    lines: dict[Key, int] = {}
    try:
        _check_events(text)
        root = yaml.compose(text, Loader=_LOADER)
        data = None if root is None else _value(root, (), lines)
    except yaml.YAMLError as problem:
        mark = getattr(problem, "problem_mark", None)
        said = getattr(problem, "problem", None) or getattr(problem, "reason", None) or "cannot be parsed"
        at = len(text) if mark is None else mark.index
        if at >= len(text.rstrip()):  # what is open at the end of a file began earlier
            at = getattr(getattr(problem, "context_mark", None), "index", at)
        said = "got a tab, expected spaces" if text[at : at + 1] == "\t" else said
        line = text.count("\n", 0, getattr(problem, "position", at)) + 1
        raise error(f"not valid {language}: {' '.join(str(said).split())}", file=file, line=line) from None
    if data is None:
        raise error("the file is empty", file=file)
    return Tree(data, lines)


def check_format(tree: Tree, reads: int, *, file: str | Path, error: type[InputError] = InputError) -> None:
    """Refuse a file with a `format` other than `reads`. A file without `format` is accepted.

    Raises `error` with file and line."""
    if isinstance(tree.data, dict) and "format" in tree.data:
        problem = format_problem(tree.data["format"], reads, tree.data.get("version"))
        if problem is not None:
            raise error(problem, file=file, line=tree.line(("format",)), key="format")


def _refused(problem: str, mark: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=mark)


def _check_events(text: str) -> None:
    """Check before anything is built, so that no file takes long. Raises MarkedYAMLError."""
    depth = 0
    for entries, event in enumerate(yaml.parse(text, Loader=_LOADER)):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > MAX_DEPTH:
            raise _refused(f"nested more than {MAX_DEPTH} deep", event.start_mark)
        if entries > 2 * MAX_ENTRIES:
            raise _refused(f"got more than {MAX_ENTRIES} entries", event.start_mark)
        if isinstance(event, yaml.NodeEvent) and event.anchor is not None:
            raise _refused("anchors (&) and aliases (*) are not allowed: write the value out", event.start_mark)
        if isinstance(event, yaml.ScalarEvent) and len(event.value) > MAX_TEXT:
            raise _refused(f"got text of {len(event.value)} characters, expected at most {MAX_TEXT}", event.start_mark)
        if getattr(event, "tag", None) is not None:
            raise _refused("tags (!) are not allowed", event.start_mark)


def _value(node: yaml.Node, key: Key, lines: dict[Key, int]) -> Any:
    """The value of a node; notes the line of each key."""
    lines.setdefault(key, node.start_mark.line + 1)
    if isinstance(node, yaml.SequenceNode):
        return [_value(item, (*key, i), lines) for i, item in enumerate(node.value)]
    if isinstance(node, yaml.ScalarNode):
        return node.value if node.style else plain_value(node.value)
    data: dict[str, Any] = {}
    for name, item in node.value:
        if not isinstance(name, yaml.ScalarNode):
            raise _refused("got a key that is itself a list or mapping, expected a word", name.start_mark)
        if name.value in data:
            first = lines[(*key, name.value)]
            raise _refused(f"got the key {name.value} twice, first in line {first}", name.start_mark)
        lines[(*key, name.value)] = name.start_mark.line + 1
        data[name.value] = _value(item, (*key, name.value), lines)
    return data


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
