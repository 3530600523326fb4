"""A rig simulated on a MuJoCo model of the user's own: `class: mazeplan.rigs.usermodel:ModelRig` in a rig's YAML file.

The model, in MuJoCo's own format (MJCF), has a plate that two joints tilt, each with a position actuator, and a
ball with a free joint. Which is which says the file; `usergimbal` looks whether it can be so. Camera, delays and
servo's play are those of any simulated rig.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from mazeplan.errors import SettingsError
from mazeplan.maze.geometry import Maze
from mazeplan.maze.yamltree import key_path
from mazeplan.rigs.machine import CHUNKS
from mazeplan.rigs.settings import Fault, FileSettings, Section, SimulatedSettings, as_tuples, sentence, settings_from
from mazeplan.rigs.simulated import SimulatedRig
from mazeplan.rigs.usergimbal import Axis, Described, UserGimbal, read_model

SHARED = (  # keys of a simulated rig that are not about the generated machine
    "model", "rate_hz", "camera_noise_mm", "camera_delay_frames", "camera_late_ms", "ball_lost_probability",
    "ball_lost_frames", "outlier_probability", "outlier_mm", "camera_offset_mm", "camera_rotation_deg", "camera_scale",
    "lens_per_m2", "lens_mm", "tilt_noise_deg", "tilt_scale", "servo_gain", "servo_coupling", "servo_slew_deg_s",
    "command_delay_ms", "backlash_deg", "backlash_axis", "deadband_deg", "faults",
)  # fmt: skip


class AxisSection(Section):
    """Which joint is an axis, and how its servo is told an angle."""

    joint: str
    actuator: str | None = None
    sign: int = Field(default=1, ge=-1, le=1)
    scale: float | None = Field(default=None, gt=0.0)
    zero_deg: float = Field(default=0.0, ge=-90.0, le=90.0)

    def axis(self) -> Axis:
        """The same for the model."""
        return Axis(self.joint, self.actuator, self.sign, self.scale, self.zero_deg)


class ModelSection(Section):
    """The keys that describe a model of one's own."""

    mjcf: str
    beta: AxisSection
    gamma: AxisSection
    ball: str
    plate: str
    floor_mm: float = Field(default=0.0, ge=-1000.0, le=1000.0)


class ModelRig(SimulatedRig):
    """See `interface.Rig`. Raises SettingsError for keys and names that do not fit the model. cannot: kinds of faults
    that it has no parts for."""

    cannot = ("blocked",)

    def __init__(self, maze: Maze, settings: Mapping[str, Any]) -> None:
        keys = ModelSection.model_fields
        described = _section({key: value for key, value in settings.items() if key in keys})
        rest = {key: value for key, value in settings.items() if key not in keys}
        for key in rest:
            if key not in SHARED:
                allowed = ", ".join((*keys, *SHARED))
                what = "belongs to the generated machine" if key in SimulatedSettings.model_fields else "unknown key"
                raise SettingsError(f"{what}, expected one of {allowed}", key=key)
        chosen = settings_from(rest)
        for i, fault in enumerate(chosen.faults):
            if fault.kind in self.cannot:
                what = f"got {fault.kind}, expected another: this model has no plugs"
                raise SettingsError(what, key=f"faults[{i}].kind")
        model = read_model(_path(described.mjcf, settings))
        plan = Described(
            described.beta.axis(), described.gamma.axis(), described.ball, described.plate, 1e-3 * described.floor_mm
        )
        gimbal = UserGimbal(model, plan, maze, chosen.rate_hz * CHUNKS)
        super().__init__(maze, chosen, lambda: gimbal)

    def inject(self, fault: Fault) -> None:
        """See `Machine.inject`. Raises SettingsError for what it cannot have, too."""
        if fault.kind in self.cannot:
            raise SettingsError(f"got {fault.kind}, expected another: this model has no plugs", key="fault.kind")
        super().inject(fault)


def _section(data: Mapping[str, Any]) -> ModelSection:
    try:
        return ModelSection.model_validate(as_tuples(data))
    except ValidationError as problem:
        first = problem.errors()[0]
        key = tuple(first["loc"])
        fields = AxisSection.model_fields if len(key) > 1 else ModelSection.model_fields
        unknown = first["type"] == "extra_forbidden"
        said = f"unknown key, expected one of {', '.join(fields)}" if unknown else sentence(first)
        raise SettingsError(said, key=key_path(key) or None) from None


def _path(name: str, settings: Mapping[str, Any]) -> Path:
    """The model's file: from the folder of the rig's file, or from where one works."""
    path = Path(name)
    if isinstance(settings, FileSettings):
        beside = settings.file.parent / path
        return beside if beside.exists() else path
    return path
