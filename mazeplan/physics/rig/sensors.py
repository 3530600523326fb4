"""Calibration of camera and tilt sensor, and the correction of their measurements.

p = scale R(angle) true position + offset,    measured position = c + (p - c) (1 + k |p - c|^2)
measured tilt = gain x true tilt
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

ROUNDS = 20  # iterations that correct the lens (fixed point); each leaves a share k |p - c|^2 of the error
LIMITS = (
    ("offset_x", -0.05, 0.05, "m"), ("offset_y", -0.05, 0.05, "m"), ("angle", -0.8, 0.8, "rad"),
    ("scale", 0.5, 2.0, ""), ("distortion", -30.0, 30.0, "1/m^2"), ("distortion_x", -0.1, 0.1, "m"),
    ("distortion_y", -0.1, 0.1, "m"),
)  # fmt: skip


@dataclass(frozen=True)
class Camera:
    """Calibration of the camera.

    offset_x, offset_y: measured middle of the plate, m
    angle:              rotation of the picture relative to the tilt axes, rad
    scale:              measured over true
    distortion:         of the lens, 1/m^2
    distortion_x, distortion_y: centre of the distortion, m
    stderr:             standard errors by field
    """

    offset_x: float = 0.0
    offset_y: float = 0.0
    angle: float = 0.0
    scale: float = 1.0
    distortion: float = 0.0
    distortion_x: float = 0.0
    distortion_y: float = 0.0
    stderr: dict[str, float] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        for name, low, high, unit in LIMITS:
            value = getattr(self, name)
            if not low <= value <= high:  # also refuses NaN
                raise ValueError(f"{name}: got {value}, expected {low} to {high} {unit}".strip())

    def true(self, x: float, y: float) -> tuple[float, float]:
        """True position, m, of a ball that is measured at (x, y)."""
        if self == PLAIN:
            return x, y
        x, y = self._without_lens(x, y)
        c, s = math.cos(self.angle) / self.scale, math.sin(self.angle) / self.scale
        x, y = x - self.offset_x, y - self.offset_y
        return c * x + s * y, c * y - s * x

    def seen(self, x: float, y: float) -> tuple[float, float]:
        """Measured position of a ball at (x, y), m."""
        c, s = self.scale * math.cos(self.angle), self.scale * math.sin(self.angle)
        x, y = c * x - s * y + self.offset_x, s * x + c * y + self.offset_y
        dx, dy = x - self.distortion_x, y - self.distortion_y
        more = self.distortion * (dx * dx + dy * dy)
        return x + more * dx, y + more * dy

    def _without_lens(self, x: float, y: float) -> tuple[float, float]:
        """The position without lens distortion."""
        if self.distortion == 0.0:
            return x, y
        x, y = x - self.distortion_x, y - self.distortion_y
        px, py = x, y
        for _ in range(ROUNDS):
            over = 1.0 + self.distortion * (px * px + py * py)
            px, py = x / over, y / over
        return px + self.distortion_x, py + self.distortion_y


PLAIN = Camera()  # measures places as they are


@dataclass(frozen=True)
class TiltSensor:
    """Calibration of the tilt sensor. gain_beta, gain_gamma: measured over true tilt."""

    gain_beta: float = 1.0
    gain_gamma: float = 1.0
    stderr: dict[str, float] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        for name in ("gain_beta", "gain_gamma"):
            if not 0.3 <= getattr(self, name) <= 3.0:
                raise ValueError(f"{name}: got {getattr(self, name)}, expected 0.3 to 3.0")

    def true(self, beta: float, gamma: float) -> tuple[float, float]:
        """True tilts, rad, for measured tilts (beta, gamma)."""
        return beta / self.gain_beta, gamma / self.gain_gamma
