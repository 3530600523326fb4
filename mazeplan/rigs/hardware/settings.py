"""The YAML file of a rig on a table: read, checked, and written by the calibrations without touching the rest of it.

hardware.yaml (packaged) explains every key.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from pydantic import Field, ValidationError, field_validator, model_validator

from mazeplan.errors import SettingsError
from mazeplan.maze.yamltree import key_path, parse_yaml, read_yaml
from mazeplan.records import Latency
from mazeplan.rigs.hardware.tiltsensor import TiltSection
from mazeplan.rigs.hardware.yamlmerge import merged
from mazeplan.rigs.link.messages import HARD_SLEW, HARD_US
from mazeplan.rigs.settings import Section, as_tuples, sentence

SLOWEST = 100.0  # us/s
LIMITS = ("min_us", "max_us")


class ServoAxis(Section):
    """One servo. us_per_deg: negative where a longer pulse tilts the other way."""

    level_us: float = Field(default=1500.0, description="pulse at which it is level")
    us_per_deg: float = Field(default=40.0, ge=-400.0, le=400.0, description="of pulse for a degree of the plate")
    min_us: float = 1200.0
    max_us: float = 1800.0

    @field_validator("level_us", *LIMITS)
    @classmethod
    def _sent(cls, pulse: float) -> float:
        low, high = HARD_US
        if not low <= pulse <= high:
            raise ValueError(f"got {pulse:g} us, expected {low:g} to {high:g} us: the firmware sends nothing beyond")
        return pulse

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.min_us < self.level_us < self.max_us:
            got = f"min_us {self.min_us:g}, level_us {self.level_us:g}, max_us {self.max_us:g}"
            raise ValueError(f"got {got}, expected min_us < level_us < max_us")
        if abs(self.us_per_deg) < 1.0:
            raise ValueError(f"us_per_deg: got {self.us_per_deg:g}, expected at least 1 us per degree, either way")
        return self

    def pulse(self, u: float) -> float:
        """us for a tilt of u rad, within the limits."""
        return min(max(self.level_us + self.us_per_deg * math.degrees(u), self.min_us), self.max_us)

    def angle(self, pulse_us: float) -> float:
        """The tilt in rad that a pulse stands for."""
        return math.radians((pulse_us - self.level_us) / self.us_per_deg)


class Servo(Section):
    """`servo:` of the file."""

    beta: ServoAxis = ServoAxis()
    gamma: ServoAxis = ServoAxis()
    slew_us_per_s: float = Field(default=6000.0, description="fastest change of the pulses")

    @field_validator("slew_us_per_s")
    @classmethod
    def _kept(cls, slew: float) -> float:
        if not SLOWEST <= slew <= HARD_SLEW:
            wanted = f"{SLOWEST:g} to {HARD_SLEW:g} us/s, which is the firmware's fastest"
            raise ValueError(f"got {slew:g} us/s, expected {wanted}")
        return slew


class LatencySection(Section):
    """`latency:` of the file, as `mazeplan rig check` writes it."""

    command_ms: float = Field(ge=0.0, le=500.0, description="from a command to the first movement of the plate")
    camera_ms: float = Field(ge=0.0, le=500.0, description="age of a picture when its sample is taken")
    host_ms: float = Field(default=0.0, ge=0.0, le=200.0, description="from a sample to the command that answers it")
    date: str = ""

    def record(self) -> Latency:
        """As the estimator takes it."""
        return Latency(camera_s=1e-3 * self.camera_ms, command_s=1e-3 * (self.command_ms + self.host_ms))


class HardwareSettings(Section):
    """All keys of the file but `class`."""

    model: str | None = Field(default=None, description="model of ball and stage to navigate with: a name or folder")
    port: str = Field(default="auto", min_length=1, description="serial port of the board; auto: the only Arduino")
    rate_hz: float = Field(default=30.0, ge=5.0, le=120.0, description="pictures, samples and commands per second")
    servo: Servo = Servo()
    tilt: TiltSection | None = None
    camera: dict[str, Any] | None = None
    latency: LatencySection | None = None
    unseen_s: float = Field(default=2.0, ge=0.2, le=60.0, description="a run ends when the ball is unseen for so long")
    place_s: float = Field(default=120.0, ge=1.0, le=3600.0, description="time to place the ball")

    @property
    def source(self) -> int | str:
        """Where pictures come from: the number of a device, a URL, a file."""
        given = (self.camera or {}).get("source", 0)
        return given if isinstance(given, int | str) else 0

    @property
    def picture(self) -> tuple[int, int]:
        """Width and height that are asked for."""
        width, height = (self.camera or {}).get("size", (640, 480))
        return int(width), int(height)

    def check_limits(self) -> None:
        """Whether the file itself says how far each servo may go. Raises SettingsError: no linkage is the usual one."""
        for axis in ("beta", "gamma"):
            given = getattr(self.servo, axis).model_fields_set if axis in self.servo.model_fields_set else set()
            for name in LIMITS:
                if name not in given:
                    why = "is missing: no servo moves without limits, beyond which nothing is sent (docs/hardware.md)"
                    raise SettingsError(why, key=f"servo.{axis}.{name}")

    def missing(self) -> list[str]:
        """Commands that have to be given before it can drive."""
        out = ["mazeplan calibrate tilt"] if self.tilt is None else []
        return out + (["mazeplan calibrate camera"] if not self.calibrated_camera else [])

    @property
    def calibrated_camera(self) -> bool:
        """Whether `camera:` says more than where the pictures come from."""
        return self.camera is not None and "focal_px" in self.camera


class WorldSettings(Section):
    """`world:` of an emulated rig's file: the table that stands in for a real one. What its servos, diodes and camera
    are like is drawn by `seed`, and stands nowhere."""

    seed: int = Field(default=1, ge=0)
    physics: dict[str, Any] = Field(default_factory=dict, description="of the machine: keys of a simulated rig")
    camera_delay_ms: float = Field(default=50.0, ge=25.0, le=250.0, description="from the shutter to this program")
    diode_noise_mv: float = Field(default=4.0, ge=0.0, le=200.0, description="of each conversion")
    look: dict[str, Any] = Field(default_factory=dict, description="of the pictures: noise, blur, gloss, exposure ...")
    trace: str | None = Field(default=None, description="CSV file that gets pulses and true tilts")
    linger_s: float = Field(
        default=0.0, ge=0.0, le=60.0, description="it goes on for so long when the program has ended"
    )


class EmulatedSettings(HardwareSettings):
    """All keys of an emulated rig's file but `class`."""

    world: WorldSettings = WorldSettings()
    place_s: float = Field(default=20.0, ge=1.0, le=3600.0)


def check_section(kind: type[Section], data: Mapping[str, Any]) -> Any:
    """A section from plain data. Raises SettingsError, its key as in the file."""
    try:
        return kind.model_validate(as_tuples(data))
    except ValidationError as problem:
        first = problem.errors()[0]
        loc = tuple(first["loc"])
        if first["type"] == "extra_forbidden":
            known = ", ".join(_fields(kind, loc[:-1]))
            raise SettingsError(f"unknown key, expected one of {known}", key=key_path(loc)) from None
        raise SettingsError(sentence(first), key=key_path(loc) or None) from None


def _fields(kind: Any, loc: tuple[Any, ...]) -> list[str]:
    """Names of the keys of the section at a place."""
    for name in loc:
        info = kind.model_fields[name].annotation
        options = [info, *getattr(info, "__args__", ())]
        kind = next(option for option in options if hasattr(option, "model_fields"))
    return list(kind.model_fields)


def write_sections(path: Path, sections: Mapping[str, Any], *, base: Path | None = None) -> None:
    """Put sections (top-level keys) into a file in the place of those of their names; all other lines and all comments
    stay as they are.

    base: the file to begin with, where there is none yet. Raises SettingsError when it cannot be read or written."""
    source = path if path.exists() or base is None else base
    read_yaml(source, error=SettingsError)  # else it would be made worse
    text = source.read_text(encoding="utf-8-sig")
    for key, value in sections.items():
        text = merged(text, key, value, file=source)
    parse_yaml(text, file=path, error=SettingsError)
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        beside.write_text(text, encoding="utf-8")
        beside.replace(path)
    except OSError as problem:
        beside.unlink(missing_ok=True)
        raise SettingsError(f"cannot be written: {problem.strerror}", file=path) from None
