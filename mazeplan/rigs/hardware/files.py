"""The file that a calibration reads and writes: the user's file, or a copy of a packaged file in the current folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mazeplan.core.errors import SettingsError
from mazeplan.core.whole_file import read_only
from mazeplan.maze.yamltree import shown
from mazeplan.rigs.files import read_rig_file, validated
from mazeplan.rigs.hardware.settings import HardwareSettings, write_sections
from mazeplan.rigs.registry import PACKAGED, rig_class, rig_file


@dataclass(frozen=True)
class RigFile:
    """A rig's file.

    path: file to read.
    target: file to write.
    settings: validated settings.
    data: sections of the file."""

    path: Path
    target: Path
    settings: HardwareSettings
    data: Mapping[str, Any]

    def check_writable(self) -> None:
        """Raises SettingsError if the file to write is read-only."""
        if read_only(self.target):
            raise SettingsError("is read-only; expected a file that may be written to", file=self.target)

    def write(self, sections: Mapping[str, Any]) -> Path:
        """Replace sections of the file, and return the path of the written file.

        A new file starts as a copy of the packaged one. For invalid sections, raises SettingsError and writes nothing.
        """
        try:
            validated(type(self.settings), {**self.data, **sections})
        except SettingsError as problem:
            found = f"the result is not valid: {problem.problem}; the file stays as it is"
            raise SettingsError(found, file=self.target, key=problem.key) from None
        write_sections(self.target, sections, base=self.path)
        return self.target


def background_of(target: Path) -> str:
    """Name of the background's file, which lies beside the rig's file."""
    return f"{target.stem}-background.png"


def is_hardware(spec: str) -> bool:
    """Whether `spec` names a rig on a table, real or emulated. Raises SettingsError for a file that cannot be read."""
    path = rig_file(spec)
    return path is not None and _settings_kind(path) is not None


def _settings_kind(path: Path) -> type[HardwareSettings] | None:
    """What validates the settings of a rig on a table; None for another rig's file."""
    kind, settings = read_rig_file(path)
    if kind is None or ":" not in kind:
        return None
    if kind == "mazeplan.rigs.hardware:HardwareRig":  # without OpenCV, which the class needs
        return HardwareSettings
    found = getattr(rig_class(kind, {"file": path, "line": settings.tree.line(("class",))}), "settings_kind", None)
    return found if isinstance(found, type) and issubclass(found, HardwareSettings) else None


def hardware_file(spec: str) -> RigFile:
    """The file of the rig on a table that `spec` names. Raises SettingsError with file, line and key."""
    path = rig_file(spec)
    settings_kind = None if path is None else _settings_kind(path)
    if path is None or settings_kind is None:
        own = path is not None and path.resolve().parent != PACKAGED
        raise SettingsError(
            f"got rig {shown(spec)}, expected one on a table: its file has class: mazeplan.rigs.hardware:HardwareRig",
            file=path if own else None,
        )
    given = read_rig_file(path)[1]
    settings = validated(settings_kind, given)
    target = Path(path.name) if path.resolve().parent == PACKAGED else path
    return RigFile(path, target, settings, given)
