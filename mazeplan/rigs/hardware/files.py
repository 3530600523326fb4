"""Which file a calibration reads and writes: the rig's own; for a packaged one a copy in the folder where one works."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mazeplan.errors import SettingsError
from mazeplan.maze.yamltree import shown
from mazeplan.rigs.hardware.settings import EmulatedSettings, HardwareSettings, check_section, write_sections
from mazeplan.rigs.registry import HARDWARE, PACKAGED, rig_file
from mazeplan.rigs.settings import FileSettings, placed, read_rig_file

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
        being as it was, where they could not be read again.

        A file that was not there yet begins as a copy of this one, with what it names beside it."""
        target = target or self.target
        try:
            check_section(type(self.settings), {**self.data, **sections})
        except SettingsError as problem:
            found = f"what was found cannot be: {problem.problem}; the file stays as it is"
            raise SettingsError(found, file=target, key=problem.key) from None
        if not target.exists():
            sections = {**self._moved(target, sections), **sections}
        write_sections(target, sections, base=self.path)
        return target

    def _moved(self, target: Path, sections: Mapping[str, Any]) -> dict[str, Any]:
        """What names files relative to this one, for a copy in another folder: the picture of the floor goes along, a
        model of one's own stays where it is."""
        if target.parent.resolve() == self.path.parent.resolve():
            return {}
        out: dict[str, Any] = {}
        camera = self.data.get("camera")
        name = camera.get("background") if isinstance(camera, dict) else None
        if isinstance(name, str) and "camera" not in sections:
            copy = background_of(target)
            try:
                shutil.copyfile(self.path.parent / name, target.parent / copy)
            except OSError as problem:
                why = f"{shown(name)} cannot be copied to {target.parent / copy}: {problem.strerror}"
                raise placed(SettingsError(why, key="camera.background"), self.data) from None
            out["camera"] = {**dict(camera or {}), "background": copy}
        model = self.data.get("model")
        if isinstance(model, str) and (self.path.parent / model).exists():
            out["model"] = os.path.relpath(self.path.parent / model, target.parent)
        return out


def background_of(target: Path) -> str:
    """Name of the picture of the empty floor beside a rig's file."""
    return f"{target.stem}-background.png"


def is_hardware(spec: str) -> bool:
    """Whether it is a rig on a table, emulated or not. Raises SettingsError for a file that cannot be read."""
    path = rig_file(spec)
    kind = None if path is None else read_rig_file(path)[0]
    return kind is not None and kind.partition(":")[0] == "mazeplan.rigs.hardware"


def hardware_file(spec: str) -> RigFile:
    """The file of a rig on a table. Raises SettingsError with file, line and key."""
    path = rig_file(spec)
    if path is None or not is_hardware(spec):
        own = path is not None and path.resolve().parent != PACKAGED
        raise SettingsError(
            f"got rig {shown(spec)}, expected one on a table: its file has class: mazeplan.rigs.hardware:HardwareRig",
            file=path if own else None,
        )
    kind, data, tree = read_rig_file(path)
    model = KINDS.get((kind or "").partition(":")[2], HardwareSettings)
    given = FileSettings(data, path, tree)
    try:
        settings = check_section(model, given)
    except SettingsError as problem:
        raise placed(problem, given) from None
    target = Path(path.name) if path.resolve().parent == PACKAGED else path
    return RigFile(path, target, settings, given)
