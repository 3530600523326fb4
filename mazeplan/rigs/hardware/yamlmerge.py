"""Replaces a section in the text of a YAML file. Every comment stays; spacing may change.

New values replace old ones. New keys come last, and keys that the new section lacks are removed. A comment that
stood in a removed or replaced value moves above the section.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from io import StringIO
from pathlib import Path
from typing import Any

import yaml

from mazeplan.core.errors import SettingsError
from mazeplan.maze.yamltree import parse_yaml

WIDTH = 120
_COMMENT = re.compile(r"(?:^|(?<=\s))#[^\n]*", re.MULTILINE)


def merged(text: str, key: str, value: Any, *, file: str | Path) -> str:
    """The text with `key: value` at its top level. Raises SettingsError for text that is no mapping in YAML."""
    from ruamel.yaml import YAML

    if not isinstance(parse_yaml(text, file=file, error=SettingsError).data, dict):
        raise SettingsError(f"cannot be written: {key} needs a file with `key: value` lines", file=file)
    editor, out = YAML(), StringIO()
    editor.preserve_quotes, editor.width = True, WIDTH
    data = editor.load(text)
    _put(data, key, value)
    editor.dump(data, out)
    new = out.getvalue()
    lost = Counter(_comments(text)) - Counter(_comments(new))
    above = "".join(f"{comment}\n" for comment in _comments(text) if lost[comment] > 0)
    return re.sub(rf"^(?=[\"']?{re.escape(key)}[\"']?:)", lambda _: above, new, count=1, flags=re.MULTILINE)


def _put(section: Any, key: str, value: Any) -> None:
    """Set a key of a mapping. Mappings in it are merged, so that their comments stay in their places."""
    old = section.get(key)
    if isinstance(old, Mapping) and isinstance(value, Mapping) and any(name in value for name in old):
        for name in [name for name in old if name not in value]:
            del section[key][name]
        for name, item in value.items():
            _put(old, name, item)
    elif key not in section or old != value:
        section[key] = _node(value)


def _node(value: Any) -> Any:
    """A value for the editor: lists, and mappings without further collections, are written on one line."""
    from ruamel.yaml.comments import CommentedMap, CommentedSeq

    if isinstance(value, Mapping):
        node: Any = CommentedMap({name: _node(item) for name, item in value.items()})
        flat = not any(isinstance(item, Mapping | list | tuple) for item in value.values())
    elif isinstance(value, list | tuple):
        node, flat = CommentedSeq([_node(item) for item in value]), True
    else:
        return value
    if flat:
        node.fa.set_flow_style()
    return node


def _comments(text: str) -> list[str]:
    """The comments of a text: from a # after a blank or at the start of a line, outside scalars."""
    bare = list(text)
    for token in yaml.scan(text, Loader=yaml.SafeLoader):
        if isinstance(token, yaml.ScalarToken):
            begin, end = token.start_mark.index, token.end_mark.index
            bare[begin:end] = "x" * (end - begin)
    return [found[0].rstrip() for found in _COMMENT.finditer("".join(bare))]
