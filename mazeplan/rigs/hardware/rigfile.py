"""The file of a rig on a table, which calibrations read and write. Writing replaces sections and keeps the comments.

The file to write is the user's file, or a copy of a packaged file in the current folder. In a section, new values
replace old ones. New keys come last, and keys that the new section lacks are removed. Spacing may change.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

from mazeplan.core.errors import SettingsError
from mazeplan.core.whole_file import write_text
from mazeplan.maze.yamltree import parse_yaml, shown
from mazeplan.rigs.files import read_rig_file, validated
from mazeplan.rigs.hardware.settings import HardwareSettings
from mazeplan.rigs.registry import PACKAGED, rig_class, rig_file

CLASS = "mazeplan.rigs.hardware:HardwareRig"
WIDTH = 120


@dataclass(frozen=True)
class RigFile:
    """A rig's file."""

    path: Path  # file to read
    target: Path  # file to write
    settings: HardwareSettings
    data: Mapping[str, Any]  # sections of the file

    def write(self, sections: Mapping[str, Any]) -> Path:
        """Replace sections of the file, or of a copy of the packaged one, and return the path of the written file.

        For invalid sections, raises SettingsError and writes nothing."""
        try:
            validated(type(self.settings), {**self.data, **sections})
        except SettingsError as problem:
            raise SettingsError(f"not written: {problem.problem}", file=self.target, key=problem.key) from None
        write_sections(self.target, sections, base=self.path)
        return self.target


def is_hardware(spec: str) -> bool:
    """Whether `spec` names a rig on a table, real or emulated. Raises SettingsError for a file that cannot be read."""
    path = rig_file(spec)
    return path is not None and _settings_kind(path) is not None


def hardware_file(spec: str) -> RigFile:
    """The file of the rig on a table that `spec` names. Raises SettingsError with file, line and key."""
    path = rig_file(spec)
    settings_kind = None if path is None else _settings_kind(path)
    if path is None or settings_kind is None:
        raise SettingsError(f"got rig {shown(spec)}, expected one on a table: its file has class: {CLASS}")
    packaged = path.resolve().parent == PACKAGED
    given = read_rig_file(path)[1]
    return RigFile(path, Path(path.name) if packaged else path, validated(settings_kind, given), given)


def _settings_kind(path: Path) -> type[HardwareSettings] | None:
    """What validates the settings of a rig on a table; None for another rig's file."""
    kind, settings = read_rig_file(path)
    if kind is None or ":" not in kind:
        return None
    if kind == CLASS:  # without OpenCV, which the class needs
        return HardwareSettings
    found = getattr(rig_class(kind, {"file": path, "line": settings.tree.line(("class",))}), "settings_kind", None)
    return found if isinstance(found, type) and issubclass(found, HardwareSettings) else None


def write_sections(path: Path, sections: Mapping[str, Any], *, base: Path | None = None) -> None:
    """Replace sections (top-level keys) of a file. Raises InputError if it cannot be read or written.

    base: file whose text a new file starts with."""
    source = path if path.exists() or base is None else base
    text = source.read_text(encoding="utf-8-sig")
    for key, value in sections.items():
        text = merged(text, key, value, file=source)
    parse_yaml(text, file=path, error=SettingsError)
    write_text(path, text)


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
    return out.getvalue()


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
