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
from mazeplan.physics.rig.stage_simulation import SUBSTEP

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
        transition = self.axis.transition(dt)
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
    limit = axis.rate_limit
    if math.isinf(limit):
        return target + axis.transition(dt) @ (state - target)
    count = max(math.ceil(dt / SUBSTEP - 1e-9), 1)
    h, M = dt / count, axis.transition(dt / count)
    for _ in range(count):
        new = target + M @ (state - target)
        turn = min(max(float(new[0] - state[0]), -limit * h), limit * h)
        rate = turn / h if axis.order == 0 else float(new[1])
        state = np.array([state[0] + turn, min(max(rate, -limit), limit)])
    return state
