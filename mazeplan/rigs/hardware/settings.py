"""Settings of a rig on a table. The packaged hardware.yaml explains every key; calibrations write their sections."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from mazeplan.core.errors import SettingsError
from mazeplan.maze.sections import Section
from mazeplan.rigs.camera.section import CameraSection
from mazeplan.rigs.files import placed
from mazeplan.rigs.link.protocol import HARD_SLEW, HARD_US, AxisLimits, ServoLimits

SLOWEST = 100.0  # us/s, smallest slew rate
POWERS = {  # of a and b in each term of the tilt sensor's polynomials
    "one": (0, 0), "a": (1, 0), "b": (0, 1), "ab": (1, 1), "aa": (2, 0), "bb": (0, 2),
    "aaa": (3, 0), "aab": (2, 1), "abb": (1, 2), "bbb": (0, 3),
}  # fmt: skip
REACH = 1.3  # times the calibrated half range: farther out the polynomial is not valid
Term = Literal["one", "a", "b", "ab", "aa", "bb", "aaa", "aab", "abb", "bbb"]
Terms = Annotated[dict[Term, float], Field(min_length=1)]
Volts = Annotated[float, Field(gt=0.0)]
Pulse = Annotated[float, Field(ge=HARD_US[0], le=HARD_US[1])]  # us; the firmware sends nothing beyond


class TiltSensor(Section):
    """The section `tilt:`: converts the voltages of the tilt sensor's diode to the tilt of the plate.

        beta = sum_k c_k a^i b^j,   a = (v0 - centre0) / scale0,   b = (v1 - centre1) / scale1,   gamma alike

    The plate turns a laser. The laser's spot on the diode moves nearly in proportion to both tilts. Products and powers
    correct for a diode that is turned, not flat, and not linear. `tiltcalibration` finds the coefficients."""

    centre_v: tuple[float, float]  # of the two channels
    scale_v: tuple[Volts, Volts]
    beta_deg: Terms  # coefficients by the name of their term
    gamma_deg: Terms
    error_deg: float = Field(default=0.0, ge=0.0)  # of the calibration
    readings: int = Field(default=0, ge=0)
    date: str = ""

    def tilt(self, v0: float, v1: float) -> tuple[float, float]:
        """beta, gamma, rad, at these voltages. Voltages beyond REACH are clamped."""
        pairs = zip((v0, v1), self.centre_v, self.scale_v, strict=True)
        a, b = (min(max((v - c) / s, -REACH), REACH) for v, c, s in pairs)

        def value(terms: dict[Term, float]) -> float:
            return math.radians(sum(k * a ** POWERS[name][0] * b ** POWERS[name][1] for name, k in terms.items()))

        return value(self.beta_deg), value(self.gamma_deg)

    def reaches(self, v0: float, v1: float) -> bool:
        """Whether the voltages are within REACH. If not, the laser's spot has left the diode."""
        pairs = zip((v0, v1), self.centre_v, self.scale_v, strict=True)
        return all(abs(v - c) <= REACH * s for v, c, s in pairs)


class ServoAxis(Section):
    """One servo. us_per_deg is negative if a longer pulse tilts the plate in the negative direction."""

    level_us: Pulse = Field(default=1500.0, description="pulse of a level plate")
    us_per_deg: float = Field(default=40.0, ge=-400.0, le=400.0, description="of pulse for a degree of the plate")
    min_us: Pulse = 1200.0
    max_us: Pulse = 1800.0

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


class Servo(Section):
    """The section `servo:` of the file."""

    beta: ServoAxis = ServoAxis()
    gamma: ServoAxis = ServoAxis()
    slew_us_per_s: float = Field(default=6000.0, ge=SLOWEST, le=HARD_SLEW, description="fastest change of the pulses")

    def limits(self) -> ServoLimits:
        """The limits of the pulses that go to the board."""
        beta, gamma = (AxisLimits(a.min_us, a.max_us, a.level_us, self.slew_us_per_s) for a in (self.beta, self.gamma))
        return beta, gamma


class LatencySection(Section):
    """The section `latency:` of the file, with delays that a person knows."""

    command_ms: float = Field(ge=0.0, le=500.0, description="from a command to the first movement of the plate")
    camera_ms: float = Field(ge=0.0, le=500.0, description="age of a picture when its sample is taken")
    host_ms: float = Field(default=0.0, ge=0.0, le=200.0, description="from a sample to the command that answers it")
    date: str = ""


class HardwareSettings(Section):
    """All keys of the file except `class`."""

    model: str | None = Field(default=None, description="model of ball and stage for navigation: a name or folder")
    port: str = Field(default="auto", min_length=1, description="serial port of the board; auto: the only Arduino")
    rate_hz: float = Field(default=30.0, ge=5.0, le=120.0, description="pictures, samples and commands per second")
    servo: Servo = Servo()
    tilt: TiltSensor | None = None
    camera: CameraSection = CameraSection()
    latency: LatencySection | None = None
    unseen_s: float = Field(default=2.0, ge=0.2, le=60.0, description="a run ends after so long without the ball")
    place_s: float = Field(default=120.0, ge=1.0, le=3600.0, description="time to place the ball")

    def check_limits(self, file: Mapping[str, Any]) -> None:
        """Raises SettingsError if the file has no limits for a servo, because no default fits every linkage."""
        for axis in ("beta", "gamma"):
            given = getattr(self.servo, axis).model_fields_set if axis in self.servo.model_fields_set else set()
            for name in ("min_us", "max_us"):
                if name not in given:
                    why = "is missing: no servo moves without limits, beyond which nothing is sent (docs/hardware.md)"
                    raise placed(SettingsError(why, key=f"servo.{axis}.{name}"), file)
