"""Which file a calibration reads and writes: the rig's own; for a packaged one a copy in the folder where one works."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mazeplan.errors import SettingsError
from mazeplan.maze.yamltree import shown
from mazeplan.rigs.hardware.settings import EmulatedSettings, HardwareSettings, check_section, write_sections
from mazeplan.rigs.registry import HARDWARE, PACKAGED, rig_file
from mazeplan.rigs.settings import FileSettings, read_rig_file

KINDS = {"HardwareRig": HardwareSettings, "EmulatedRig": EmulatedSettings}


@dataclass(frozen=True)
class RigFile:
    """path: where it is read; target: where it is written; settings, and the sections as they stand there."""

    path: Path
    target: Path
    settings: HardwareSettings
    data: Mapping[str, Any]

    @property
    def keeps(self) -> bool:
        """Whether what is measured belongs into it: not so of a packaged one that is no template."""
        return self.target == self.path or self.path.stem == HARDWARE

    def write(self, sections: Mapping[str, Any], target: Path | None = None) -> Path:
        """Put sections in the place of those of their names; the file that was written. Raises SettingsError, the file
        being as it was, where they could not be read again."""
        try:
            check_section(type(self.settings), {**self.data, **sections})
        except SettingsError as problem:
            found = f"what was found cannot be: {problem.problem}; the file stays as it is"
            raise SettingsError(found, file=target or self.target, key=problem.key) from None
        write_sections(target or self.target, sections, base=self.path)
        return target or self.target


def is_hardware(spec: str) -> bool:
    """Whether it is a rig on a table, emulated or not. Raises SettingsError for a file that cannot be read."""
    path = rig_file(spec)
    kind = None if path is None else read_rig_file(path)[0]
    return kind is not None and kind.partition(":")[0] == "mazeplan.rigs.hardware"


def hardware_file(spec: str) -> RigFile:
    """The file of a rig on a table. Raises SettingsError with file, line and key."""
    path = rig_file(spec)
    if path is None or not is_hardware(spec):
        raise SettingsError(
            f"got rig {shown(spec)}, expected one on a table: its file has class: mazeplan.rigs.hardware:HardwareRig"
        )
    kind, data, tree = read_rig_file(path)
    model = KINDS.get((kind or "").partition(":")[2], HardwareSettings)
    try:
        settings = check_section(model, data)
    except SettingsError as problem:
        line = tree.line(tuple((problem.key or "").split(".")))
        raise SettingsError(problem.problem, file=path, line=line, key=problem.key) from None
    target = Path(path.name) if path.resolve().parent == PACKAGED else path
    return RigFile(path, target, settings, FileSettings(data, path))
