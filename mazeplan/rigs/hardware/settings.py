"""The YAML file of a rig on a table: read, checked, and written by the calibrations without touching the rest of it.

hardware.yaml (packaged) explains every key.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import yaml
from pydantic import Field, ValidationError, model_validator

from mazeplan.errors import SettingsError
from mazeplan.maze.yamltree import key_path, parse_yaml, read_yaml
from mazeplan.records import Latency
from mazeplan.rigs.hardware.tiltsensor import TiltSection
from mazeplan.rigs.settings import Section, as_tuples, sentence

PULSE_US = (500.0, 2500.0)  # what hobby servos take


class ServoAxis(Section):
    """One servo. us_per_deg: negative where a longer pulse tilts the other way."""

    level_us: float = Field(default=1500.0, ge=PULSE_US[0], le=PULSE_US[1], description="pulse at which it is level")
    us_per_deg: float = Field(default=40.0, ge=-400.0, le=400.0, description="of pulse for a degree of the plate")
    min_us: float = Field(default=1200.0, ge=PULSE_US[0], le=PULSE_US[1])
    max_us: float = Field(default=1800.0, ge=PULSE_US[0], le=PULSE_US[1])

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.min_us < self.level_us < self.max_us:
            raise ValueError("expected min_us < level_us < max_us")
        if abs(self.us_per_deg) < 1.0:
            raise ValueError("us_per_deg: expected at least 1 us per degree, either way")
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
    slew_us_per_s: float = Field(default=6000.0, ge=100.0, le=60000.0, description="fastest change of the pulses")


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
    """Put sections (top-level keys) into a file in the place of those of their names; all other lines stay as they are.

    base: the file to begin with, where there is none yet. Raises SettingsError when it cannot be read or written."""
    source = path if path.exists() or base is None else base
    read_yaml(source, error=SettingsError)  # else it would be made worse
    text = source.read_text(encoding="utf-8-sig")
    for key, value in sections.items():
        text = replaced(text, key, value)
    parse_yaml(text, file=path, error=SettingsError)
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        beside.write_text(text, encoding="utf-8")
        beside.replace(path)
    except OSError as problem:
        beside.unlink(missing_ok=True)
        raise SettingsError(f"cannot be written: {problem.strerror}", file=path) from None


def replaced(text: str, key: str, value: Any) -> str:
    """The text of a YAML file with `key: value` at its top level in the place of the old one, or at the end."""
    new = yaml.safe_dump({key: value}, sort_keys=False, default_flow_style=None, width=100).rstrip("\n").split("\n")
    lines = text.rstrip("\n").split("\n")
    begin = next((i for i, line in enumerate(lines) if re.match(rf"['\"]?{re.escape(key)}['\"]?\s*:", line)), None)
    if begin is None:
        return "\n".join([*lines, *new]) + "\n"
    end = begin + 1
    while end < len(lines) and (not lines[end].strip() or re.match(r"\s|-\s", lines[end])):
        end += 1
    while not lines[end - 1].strip():  # blank lines belong to what follows
        end -= 1
    return "\n".join(lines[:begin] + new + lines[end:]) + "\n"
