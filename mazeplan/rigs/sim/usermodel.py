"""A rig simulated on a user's own MuJoCo model: `class: mazeplan.rigs.sim.usermodel:ModelRig` in a rig's YAML file.

The model, in MuJoCo's own format (MJCF), has a plate on two joints, a position actuator for each joint, and a ball with
a free joint. The rig's file gives the names of these parts, and `usergimbal` checks the parts. Camera, delays and play
are simulated as for any simulated rig.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mazeplan.core.errors import SettingsError
from mazeplan.core.name_hints import one_of
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.files import FileSettings, validated
from mazeplan.rigs.sim.machine import CHUNKS
from mazeplan.rigs.sim.settings import (
    CameraGeometry,
    CameraNoise,
    Fault,
    RigSetup,
    ServoSettings,
    SimulatedSettings,
    settings_from,
)
from mazeplan.rigs.sim.simulated import SimulatedRig
from mazeplan.rigs.sim.usergimbal import ModelSection, UserGimbal, read_model

SHARED = [  # keys of a simulated rig that do not describe the generated machine
    name
    for group in (RigSetup, CameraNoise, CameraGeometry, ServoSettings)
    for name in group.model_fields
    if name != "map" and not name.startswith(("servo_frequency", "servo_damping", "servo_gamma"))
] + ["tilt_noise_deg", "tilt_scale", "faults"]


class ModelRig(SimulatedRig):
    """See `interface.Rig`. Raises SettingsError for keys and names that do not fit the model.

    cannot: kinds of faults for which the model has no parts."""

    cannot = ("blocked",)

    def __init__(self, maze: Maze, settings: Mapping[str, Any]) -> None:
        keys = ModelSection.model_fields
        names = validated(ModelSection, {key: value for key, value in settings.items() if key in keys})
        rest = {key: value for key, value in settings.items() if key not in keys}
        for key in rest:
            if key not in SHARED:
                what = "belongs to the generated machine" if key in SimulatedSettings.model_fields else "unknown key"
                raise SettingsError(f"{what}, expected {one_of((*keys, *SHARED), key)}", key=key)
        chosen = settings_from(rest)
        for i, fault in enumerate(chosen.faults):
            self._check(fault, f"faults[{i}].kind")
        gimbal = UserGimbal(read_model(_path(names.mjcf, settings)), names, maze, chosen.rate_hz * CHUNKS)
        super().__init__(maze, chosen, lambda: gimbal)

    def inject(self, fault: Fault) -> None:
        """See `Machine.inject`. Raises SettingsError for a fault that the model cannot have."""
        self._check(fault, "fault.kind")
        super().inject(fault)

    def _check(self, fault: Fault, key: str) -> None:
        if fault.kind in self.cannot:
            raise SettingsError(f"got {fault.kind}, expected another: this model has no plugs", key=key)


def _path(name: str, settings: Mapping[str, Any]) -> Path:
    """The model's file: beside the rig's file if it exists there, else relative to the current folder."""
    beside = settings.file.parent / name if isinstance(settings, FileSettings) else Path(name)
    return beside if beside.exists() else Path(name)
