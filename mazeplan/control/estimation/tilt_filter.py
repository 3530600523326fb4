"""The motion of the plate, from the tilt sensor and the commands.

In a run, a Kalman filter estimates angle and rate of each axis. Model: the servo of the stage, driven by the acting
command, with noise on the rate. Measurement: the angle, without delay.

In a record, the stage is simulated. A simulated stage starts at rest, the real stage in motion. Both obey the same
linear equation, so they differ by a free motion, angle'' = -wn^2 angle - 2 zeta wn angle' (`with_true_starts`).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise

import numpy as np

from mazeplan.core.records import Array, Command, Observation
from mazeplan.learning.modelfile import RigModel
from mazeplan.physics.dynamics.plate import PlateMotion
from mazeplan.physics.rig.stage import SUBSTEP, StageAxis

NEAR = math.radians(2.5)  # rad; a servo of 60 deg/s turns less in one sample
AGREE = 4  # outliers in a row that agree
MAX_TILT_MISMATCH = math.radians(1.5)  # rad; allowed difference from the tilt predicted from the commands alone
MISMATCHED_SAMPLES = 5  # larger differences in this many samples in a row mean that the plate does not follow
HISTORY_S = 1.0  # s of tilt and commands kept; more than any controllable delay
LOOKED_AT = 0.4  # s of samples that show the start of a record
SETTLED = 1.5  # s until the free motion has died away
SENSOR = 1.0e-3  # rad; noise of one sample, 1 sigma: 0.05 deg of the toy's diode, a little wider
UNEXPLAINED = 4.0  # rad/s^2; acceleration that the servo model does not explain: 1/10 of what it does at a full step
Piece = tuple[float, float, tuple[float, float]]  # from, to, and the command (rad) that acts then


@dataclass
class AxisFilter:
    """Angle and rate of one axis; `mean` (2,) rad, rad/s, `covariance` (2, 2)."""

    axis: StageAxis
    mean: Array = field(default_factory=lambda: np.zeros(2))
    covariance: Array = field(default_factory=lambda: np.diag([1e-4, 1e-2]))

    def predict(self, command: float, dt: float) -> None:
        """Advance by dt, s, with `command` acting all the time."""
        transition = self.axis.transition(dt)
        self.mean = servo_step(self.axis, self.mean, command, dt)
        spread = shaken(dt, UNEXPLAINED)
        self.covariance = transition @ self.covariance @ transition.T + spread

    def update(self, angle: float) -> None:
        """Take in one measured angle."""
        innovation_variance = self.covariance[0, 0] + SENSOR**2
        gain = self.covariance[:, 0] / innovation_variance
        self.mean = self.mean + gain * (angle - self.mean[0])
        self.covariance = self.covariance - gain[:, None] * self.covariance[0]


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


@lru_cache(1024)
def unforced(dt: float) -> Array:
    """Transition (2, 2) of place and rate over dt s without acceleration."""
    return np.array([[1.0, dt], [0.0, 1.0]])


@lru_cache(1024)
def shaken(dt: float, acceleration: float) -> Array:
    """Covariance (2, 2) of place and rate after dt s of a constant acceleration of this standard deviation."""
    return np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]]) * acceleration**2


def servo_step(axis: StageAxis, state: Array, command: float, dt: float) -> Array:
    """Angle and rate (2,) of an axis dt s later, `command` acting all the time."""
    target = axis.gain * command + axis.offset
    limit, away = axis.rate_limit, state.copy()
    if math.isinf(limit):
        away[0] -= target
        new = axis.transition(dt) @ away
        new[0] += target
        return new
    count = max(math.ceil(dt / SUBSTEP - 1e-9), 1)
    h, M = dt / count, axis.transition(dt / count)
    for _ in range(count):
        away[0], away[1] = state[0] - target, state[1]
        new = M @ away
        new[0] += target
        turn = min(max(float(new[0] - state[0]), -limit * h), limit * h)
        rate = turn / h if axis.order == 0 else float(new[1])
        state = np.array([state[0] + turn, min(max(rate, -limit), limit)])
    return state


class PlateFilter:
    """Both axes of the plate in one run. `sent` takes each command, `update` each sample.

    before:   `means` before the last sample
    tilts:    filtered (t, beta, gamma) of the last HISTORY_S
    commands: (t from which a command acts, its two values, rad)"""

    def __init__(self, model: RigModel) -> None:
        self.stage, self._sensor = model.true_stage, model.tilt_sensor
        self._axes = (AxisFilter(self.stage.beta), AxisFilter(self.stage.gamma))
        self._by_commands = self.means  # follow the commands alone
        self._checks = (TiltCheck(), TiltCheck())
        self._mismatched = 0
        self._blind = True  # no tilt was measured yet
        self.before = self.means
        self.tilts: deque[tuple[float, float, float]] = deque()
        self.commands: deque[tuple[float, float, float]] = deque([(-math.inf, 0.0, 0.0)])
        self._history: tuple[Array, Array] | None = None  # arrays of what was asked for since the last change
        self._queue: tuple[Array, Array] | None = None

    @property
    def means(self) -> list[Array]:
        """Filtered angle and rate (2,) of each axis."""
        return [axis.mean for axis in self._axes]

    def sent(self, command: Command, t: float) -> None:
        """Record a command given to the rig at time t, s."""
        self.commands.append((t + self.stage.dead_time, command.u_beta, command.u_gamma))
        while len(self.commands) > 2 and self.commands[1][0] < t - HISTORY_S:
            self.commands.popleft()
        self._queue = None

    def update(self, observation: Observation) -> set[str]:
        """Filter both axes to the time of a sample. Returns words of `records.Doubt` for what was left out."""
        t, doubts = observation.t, set[str]()
        self.before = self.means
        for start, end, u in self.acting(self.tilts[-1][0], t) if self.tilts else ():
            for axis, value in zip(self._axes, self.stage.mixed(*u), strict=True):
                axis.predict(value, end - start)
            self._by_commands = self.turned(self._by_commands, u, end - start)
        angles = self._sensor.true(observation.beta, observation.gamma)
        self._blind = self._blind and not any(map(math.isfinite, angles))
        for axis, check, angle in zip(self._axes, self._checks, angles, strict=True):
            if check.admit(angle, float(axis.mean[0])):
                axis.update(angle)
            else:
                doubts.add("no_tilt" if self._blind else "tilt")
        apart = max(abs(a.mean[0] - o[0]) for a, o in zip(self._axes, self._by_commands, strict=True))
        self._mismatched = self._mismatched + 1 if apart > MAX_TILT_MISMATCH else 0
        if self._mismatched >= MISMATCHED_SAMPLES:
            doubts.add("plate")
        beta, gamma = self.means
        self.tilts.append((t, float(beta[0]), float(gamma[0])))
        while self.tilts[0][0] < t - HISTORY_S:
            self.tilts.popleft()
        self._history = None
        return doubts

    @property
    def history(self) -> tuple[Array, Array]:
        """`tilts` as arrays: times (N,), values (N, 2)."""
        if self._history is None:
            self._history = _split(self.tilts)
        return self._history

    @property
    def queue(self) -> tuple[Array, Array]:
        """`commands` as arrays: times (N,), values (N, 2)."""
        if self._queue is None:
            self._queue = _split([c for c in self.commands if math.isfinite(c[0])])
        return self._queue

    def until(self, start: float, end: float) -> list[tuple[float, list[Array]]]:
        """Angle and rate (2,) of each axis from the filtered ones at start up to end, at the ends of pieces."""
        plate, out = self.means, []
        for a, b, u in self.acting(start, end):
            plate = self.turned(plate, u, b - a)
            out.append((b, plate))
        return out

    def turned(self, plate: Sequence[Array], u: tuple[float, float], dt: float) -> list[Array]:
        """Angle and rate (2,) of each axis dt s later, with the command u acting."""
        reached = zip((self.stage.beta, self.stage.gamma), plate, self.stage.mixed(*u), strict=True)
        return [servo_step(axis, state, command, dt) for axis, state, command in reached]

    def acting(self, start: float, end: float) -> list[Piece]:
        """Pieces of the time between start and end, each with the command that acted."""
        pieces, until = list[Piece](), math.inf
        for since, ub, ug in reversed(self.commands):  # most are older than the start
            if since >= end:
                until = since
                continue
            a, b = max(since, start), min(until, end)
            if b > a:
                pieces.append((a, b, (ub, ug)))
            until = since
            if since <= start:
                break
        pieces.reverse()
        return pieces


def _split(rows: Iterable[tuple[float, float, float]]) -> tuple[Array, Array]:
    """Times (N,) and values (N, 2) of rows of three numbers."""
    table = np.array([*rows]).reshape(-1, 3)
    return np.ascontiguousarray(table[:, 0]), np.ascontiguousarray(table[:, 1:])


def with_true_starts(
    plate: PlateMotion, tilts: Array, begins: np.ndarray, dt: float, axes: Sequence[StageAxis]
) -> PlateMotion:
    """The simulated motion plus the free motion of each stretch, by least squares from its first tilt samples.

    plate:         simulated motion; its grid begins with the first row
    tilts (N, 2):  measured beta and gamma, rad
    begins (N,):   whether a stretch begins
    dt:            time from row to row, s
    axes:          axes of beta and gamma"""
    per, motion = round(dt / plate.step), plate.motion.copy()
    rows, fine = max(round(LOOKED_AT / dt), 3), round(SETTLED / plate.step)
    whole = [_free(axis, plate.step, min(fine, len(motion))) for axis in axes]
    for a, b in pairwise([*np.flatnonzero(begins).tolist(), len(tilts)]):
        for i, free in enumerate(free[: (b - a) * per] for free in whole):
            n = min(rows, b - a, -(-len(free) // per))  # rows that the free motion reaches
            gap = tilts[a : a + n, i] - plate.motion[a * per : (a + n) * per : per, 3 * i]
            looked = free[: n * per : per, 0]
            good = np.isfinite(gap)
            if good.sum() < 3:
                continue
            start = np.linalg.lstsq(looked[good], gap[good], rcond=1e-6)[0]
            motion[a * per : a * per + len(free), 3 * i : 3 * i + 3] += free @ start
    return PlateMotion(plate.start, plate.step, motion)


@lru_cache(2)
def _free(axis: StageAxis, step: float, count: int) -> Array:
    """Free motion (count, 3, 2) of an axis: angle, rate, acceleration, for a start at angle 1 and for one at rate 1."""
    M, now = axis.transition(step), np.eye(2)
    out = np.empty((count, 3, 2))
    for i in range(count):
        out[i, :2] = now
        out[i, 2] = [axis.acceleration(*start) for start in now.T]
        now = M @ now
    return out
