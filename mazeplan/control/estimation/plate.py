"""Kalman filter for the plate: angle and rate of one axis from the tilt sensor and the commands.

Model: the second-order servo of the stage, driven by the acting command, with noise on the rate. Measurement: the
angle, without delay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from mazeplan.core.records import Array
from mazeplan.physics.rig.stage import StageAxis

NEAR = math.radians(2.5)  # rad; a servo of 60 deg/s turns less in one sample
AGREE = 4  # outliers in a row that agree


@dataclass(frozen=True)
class PlateNoise:
    """1-sigma figures of the noise.

    sensor:        noise of one sample, rad
    acceleration:  acceleration that the servo model does not explain, rad/s^2"""

    sensor: float = 1.0e-3  # rad; 0.05 deg of the toy's diode, a little wider
    acceleration: float = 4.0  # rad/s^2; 1/10 of what the servo does at a full step


@dataclass
class AxisFilter:
    """Angle and rate of one axis; `mean` (2,) rad, rad/s, `covariance` (2, 2)."""

    axis: StageAxis
    noise: PlateNoise
    mean: Array = field(default_factory=lambda: np.zeros(2))
    covariance: Array = field(default_factory=lambda: np.diag([1e-4, 1e-2]))

    def predict(self, command: float, dt: float) -> None:
        """Advance by dt, s, with `command` acting all the time."""
        transition = servo_transition(self.axis.natural_frequency, self.axis.damping, dt)
        self.mean = servo_step(self.axis, self.mean, command, dt)
        q = self.noise.acceleration**2
        spread = np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]]) * q
        self.covariance = transition @ self.covariance @ transition.T + spread

    def update(self, angle: float) -> None:
        """Take in one measured angle."""
        innovation_variance = self.covariance[0, 0] + self.noise.sensor**2
        gain = self.covariance[:, 0] / innovation_variance
        self.mean = self.mean + gain * (angle - self.mean[0])
        self.covariance = self.covariance - np.outer(gain, self.covariance[0])


@dataclass
class TiltCheck:
    """Outlier check of the measured angles of one axis.

    It accepts an angle near the last accepted one or near the prediction. The plate cannot jump, so other angles are
    outliers, unless AGREE of them in a row agree with one another."""

    last: float | None = None
    _rejected: list[float] = field(default_factory=list)

    def admit(self, angle: float, predicted: float) -> bool:
        """Whether to use the angle, rad; False for NaN or infinity."""
        if not math.isfinite(angle):
            return False
        if self.last is None or min(abs(angle - self.last), abs(angle - predicted)) <= NEAR:
            self._rejected.clear()
            self.last = angle
            return True
        self._rejected = [old for old in self._rejected if abs(old - angle) <= NEAR] + [angle]
        if len(self._rejected) < AGREE:
            return False
        self._rejected.clear()
        self.last = angle
        return True


def servo_step(axis: StageAxis, state: Array, command: float, dt: float) -> Array:
    """Angle and rate (2,) of an axis dt s later, `command` acting all the time."""
    target = np.array([axis.gain * command + axis.offset, 0.0])
    return target + servo_transition(axis.natural_frequency, axis.damping, dt) @ (state - target)


def servo_transition(natural_frequency: float, damping: float, dt: float) -> Array:
    """Exact transition (2, 2) of (angle error, rate) of x_dd + 2 z w x_d + w^2 x = 0 over dt, for any damping >= 0."""
    w, z = natural_frequency, damping
    decay = math.exp(-z * w * dt)
    if abs(z - 1.0) < 1e-6:
        c, s = 1.0, dt
    elif z < 1.0:
        wd = w * math.sqrt(1.0 - z * z)
        c, s = math.cos(wd * dt), math.sin(wd * dt) / wd
    else:
        wd = w * math.sqrt(z * z - 1.0)
        c, s = math.cosh(wd * dt), math.sinh(wd * dt) / wd
    return decay * np.array([[c + z * w * s, s], [-w * w * s, c - z * w * s]])
