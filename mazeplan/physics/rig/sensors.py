"""Calibration of camera and tilt sensor, and the correction of their measurements.

p = scale R(angle) true position + offset,    measured position = c + (p - c) (1 + k |p - c|^2)
measured tilt = gain x true tilt
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

ROUNDS = 20  # iterations that correct the lens (fixed point); each leaves a share k |p - c|^2 of the error
RANGES = {
    "offset_x": (-0.05, 0.05, "m"), "offset_y": (-0.05, 0.05, "m"), "angle": (-0.8, 0.8, "rad"),
    "scale": (0.5, 2.0, ""), "distortion": (-30.0, 30.0, "1/m^2"), "distortion_x": (-0.1, 0.1, "m"),
    "distortion_y": (-0.1, 0.1, "m"),
}  # fmt: skip


def check_ranges(numbers: Any, ranges: Mapping[str, tuple[float, float, str]]) -> None:
    """Raises ValueError for a number outside its range (minimum, maximum, unit), also for NaN."""
    for name, (low, high, unit) in ranges.items():
        if not low <= (value := getattr(numbers, name)) <= high:
            raise ValueError(f"{name}: got {value}, expected {low} to {high} {unit}".strip())


@dataclass(frozen=True)
class Camera:
    """Calibration of the camera.

    offset_x, offset_y: measured middle of the plate, m
    distortion_x, distortion_y: centre of the distortion, m"""

    offset_x: float = 0.0
    offset_y: float = 0.0
    angle: float = 0.0  # rotation of the picture relative to the tilt axes, rad
    scale: float = 1.0  # measured over true
    distortion: float = 0.0  # of the lens, 1/m^2
    distortion_x: float = 0.0
    distortion_y: float = 0.0
    stderr: dict[str, float] = field(default_factory=dict, compare=False)  # standard errors by field

    def __post_init__(self) -> None:
        check_ranges(self, RANGES)

    def true(self, x: float, y: float) -> tuple[float, float]:
        """True position, m, of a ball that is measured at (x, y)."""
        if self == IDEAL_CAMERA:
            return x, y
        if self.distortion != 0.0:
            px, py = dx, dy = x - self.distortion_x, y - self.distortion_y
            for _ in range(ROUNDS):
                over = 1.0 + self.distortion * (px * px + py * py)
                px, py = dx / over, dy / over
            x, y = px + self.distortion_x, py + self.distortion_y
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


IDEAL_CAMERA = Camera()  # measures places as they are


@dataclass(frozen=True)
class TiltSensor:
    """Calibration of the tilt sensor. gain_beta, gain_gamma: measured over true tilt."""

    gain_beta: float = 1.0
    gain_gamma: float = 1.0
    stderr: dict[str, float] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        check_ranges(self, dict.fromkeys(("gain_beta", "gain_gamma"), (0.3, 3.0, "")))

    def true(self, beta: float, gamma: float) -> tuple[float, float]:
        """True tilts, rad, for measured tilts (beta, gamma)."""
        return beta / self.gain_beta, gamma / self.gain_gamma
