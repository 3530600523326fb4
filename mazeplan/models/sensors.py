"""What is off with the rig's own senses, and measurements put right: camera and tilt sensor.

measured position = R(angle) true position + offset        measured tilt = gain x true tilt
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Camera:
    """offset_x, offset_y: m, where it sees the middle of the plate; angle: rad, by which its picture is turned against
    the tilt axes."""

    offset_x: float = 0.0
    offset_y: float = 0.0
    angle: float = 0.0
    stderr: dict[str, float] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        for name, limit, unit in (("offset_x", 0.05, "m"), ("offset_y", 0.05, "m"), ("angle", 0.8, "rad")):
            if not abs(getattr(self, name)) <= limit:  # also refuses NaN
                raise ValueError(f"{name}: got {getattr(self, name)}, expected {-limit} to {limit} {unit}")

    def true(self, x: float, y: float) -> tuple[float, float]:
        """The position that was measured as (x, y), m."""
        if self.offset_x == self.offset_y == self.angle == 0.0:
            return x, y
        c, s = math.cos(self.angle), math.sin(self.angle)
        x, y = x - self.offset_x, y - self.offset_y
        return c * x + s * y, c * y - s * x


@dataclass(frozen=True)
class TiltSensor:
    """gain_beta, gain_gamma: what it says over what is."""

    gain_beta: float = 1.0
    gain_gamma: float = 1.0
    stderr: dict[str, float] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        for name in ("gain_beta", "gain_gamma"):
            if not 0.3 <= getattr(self, name) <= 3.0:
                raise ValueError(f"{name}: got {getattr(self, name)}, expected 0.3 to 3.0")

    def true(self, beta: float, gamma: float) -> tuple[float, float]:
        """The tilts that were measured as (beta, gamma), rad."""
        return beta / self.gain_beta, gamma / self.gain_gamma
