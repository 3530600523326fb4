"""Settings of a rig on a table. Calibrations write their sections into the rig's file and keep the rest of it.

The packaged hardware.yaml explains every key.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from pydantic import Field, field_validator, model_validator

from mazeplan.core.errors import SettingsError
from mazeplan.core.records import Latency
from mazeplan.core.whole_file import whole_file
from mazeplan.maze.sections import Section
from mazeplan.maze.yamltree import parse_yaml, read_yaml
from mazeplan.rigs.hardware.tiltsensor import TiltSection
from mazeplan.rigs.hardware.yamlmerge import merged
from mazeplan.rigs.link.messages import HARD_SLEW, HARD_US

SLOWEST = 100.0  # us/s, smallest slew rate
LIMITS = ("min_us", "max_us")


class ServoAxis(Section):
    """One servo. us_per_deg is negative if a longer pulse tilts the plate in the negative direction."""

    level_us: float = Field(default=1500.0, description="pulse of a level plate")
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
        """Pulse for a tilt of u rad, us, within the limits."""
        return min(max(self.level_us + self.us_per_deg * math.degrees(u), self.min_us), self.max_us)

    def angle(self, pulse_us: float) -> float:
        """Tilt for a pulse, rad."""
        return math.radians((pulse_us - self.level_us) / self.us_per_deg)


class Servo(Section):
    """The section `servo:` of the file."""

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
    """The section `latency:` of the file, with delays that a person knows."""

    command_ms: float = Field(ge=0.0, le=500.0, description="from a command to the first movement of the plate")
    camera_ms: float = Field(ge=0.0, le=500.0, description="age of a picture when its sample is taken")
    host_ms: float = Field(default=0.0, ge=0.0, le=200.0, description="from a sample to the command that answers it")
    date: str = ""

    def record(self) -> Latency:
        """The delays as a record for the estimator."""
        return Latency(camera_s=1e-3 * self.camera_ms, command_s=1e-3 * (self.command_ms + self.host_ms))


class HardwareSettings(Section):
    """All keys of the file except `class`."""

    model: str | None = Field(default=None, description="model of ball and stage for navigation: a name or folder")
    port: str = Field(default="auto", min_length=1, description="serial port of the board; auto: the only Arduino")
    rate_hz: float = Field(default=30.0, ge=5.0, le=120.0, description="pictures, samples and commands per second")
    servo: Servo = Servo()
    tilt: TiltSection | None = None
    camera: dict[str, Any] | None = None
    latency: LatencySection | None = None
    unseen_s: float = Field(default=2.0, ge=0.2, le=60.0, description="a run ends after so long without the ball")
    place_s: float = Field(default=120.0, ge=1.0, le=3600.0, description="time to place the ball")

    @property
    def source(self) -> int | str:
        """Source of pictures: the number of a device, a URL, a file."""
        given = (self.camera or {}).get("source", 0)
        return given if isinstance(given, int | str) else 0

    @property
    def picture(self) -> tuple[int, int]:
        """Width and height of the pictures to request from the camera, px."""
        width, height = (self.camera or {}).get("size", (640, 480))
        return int(width), int(height)

    def check_limits(self) -> None:
        """Raises SettingsError if the file has no limits for a servo, because no default fits every linkage."""
        for axis in ("beta", "gamma"):
            given = getattr(self.servo, axis).model_fields_set if axis in self.servo.model_fields_set else set()
            for name in LIMITS:
                if name not in given:
                    why = "is missing: no servo moves without limits, beyond which nothing is sent (docs/hardware.md)"
                    raise SettingsError(why, key=f"servo.{axis}.{name}")

    def missing(self) -> list[str]:
        """Calibration commands that are still needed."""
        out = ["mazeplan calibrate tilt"] if self.tilt is None else []
        return out + (["mazeplan calibrate camera"] if not self.calibrated_camera else [])

    @property
    def calibrated_camera(self) -> bool:
        """Whether `camera:` has a calibration."""
        return self.camera is not None and "focal_px" in self.camera


def write_sections(path: Path, sections: Mapping[str, Any], *, base: Path | None = None) -> None:
    """Replace sections (top-level keys) of a file. All other lines and all comments stay.

    base: file whose text a new file starts with.

    Raises SettingsError if a file cannot be read or written, also for a read-only file."""
    source = path if path.exists() or base is None else base
    read_yaml(source, error=SettingsError)  # never write into a broken file
    text = source.read_text(encoding="utf-8-sig")
    for key, value in sections.items():
        text = merged(text, key, value, file=source)
    parse_yaml(text, file=path, error=SettingsError)
    try:
        with whole_file(path) as beside:
            beside.write_text(text, encoding="utf-8")
    except OSError as problem:
        raise SettingsError(f"cannot be written: {problem.strerror}", file=path) from None
