"""Roll-outs of a ball model from causal estimates along the measured tilt, scored by the error of theta.

A window begins with the angle and the rate that a filter knew at its first sample. From there the model runs alone. If
the openings are known, windows end in front of an opening, because a good prediction counts most there. Otherwise they
are evenly spread.

The filter is an extended Kalman filter over the last PAST samples, for all windows side by side: the model gives the
acceleration, the camera the position.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mazeplan.core.maths.angles import difference
from mazeplan.core.records import Array, IntArray
from mazeplan.learning.samples import LAG, RingSamples, pick
from mazeplan.physics.ball_model import RingKinematics

STEPS = 40  # samples of a roll-out
CHECKED = (20, 40)  # samples after which errors are reported
MAX_WINDOWS = 400  # maximum number of windows of a ring
MIN_WINDOWS = 10  # windows in front of openings; with fewer, evenly spread windows are used
MAX_OPENING_ANGLE = np.radians(12.0)  # rad; maximum angle from the end of a window to the opening in front of the ball
FASTEST = 30.0  # rad/s; bounds a roll-out that diverges
PAST = 45  # samples of the filter; 1.5 s at 30 Hz
FIRST = 4  # the difference of two angles so many samples apart gives the first guess of the rate
MEMORY = 0.1  # s; correlation time of the errors of a model

Accelerate = Callable[[RingKinematics], Array]  # theta_dd (N,), rad/s^2, of a batch of states


@dataclass(frozen=True)
class Windows:
    """First rows (W,) of windows of STEPS + 1 samples, and the rule that chose them."""

    start: IntArray
    chosen: str

    def __len__(self) -> int:
        return len(self.start)


@dataclass(frozen=True)
class Rollout:
    """Roll-outs of W windows.

    angle (W, STEPS + 1):  predicted, rad
    error (W, STEPS + 1):  absolute error against the measured angle, rad"""

    angle: Array
    error: Array

    @classmethod
    def against(cls, angle: Array, measured: Array, start: IntArray) -> Rollout:
        """Predicted angles (W, STEPS + 1) against a measured signal (N,) from rows `start` on."""
        return cls(angle, np.abs(angle - measured[start[:, None] + np.arange(STEPS + 1)]))

    def after(self, steps: int) -> float:
        """Mean absolute error after so many samples, rad."""
        return float(np.mean(self.error[:, steps]))


def choose_windows(samples: RingSamples, allowed: np.ndarray, openings: Array | None = None) -> Windows:
    """Windows of rows that are all allowed (N,) and good; two windows share at most three quarters.

    openings: angles of the openings of this ring, rad, if known."""
    bad, segment = np.concatenate([[0], np.cumsum(~(allowed & samples.good))]), samples.segment
    first = np.arange(max(len(samples) - STEPS, 0))
    first = first[(bad[first + STEPS + 1] == bad[first]) & (segment[first] == segment[first + STEPS])]
    if openings is not None and len(openings):
        end = first + STEPS
        theta, rate = samples.k.theta[end], samples.k.theta_dot[end]
        ahead = difference(np.asarray(openings)[None, :], theta[:, None]) * np.sign(rate)[:, None]
        near = _thinned(first[((ahead > 0.0) & (ahead < MAX_OPENING_ANGLE)).any(axis=1)])
        if len(near) >= MIN_WINDOWS:
            return Windows(near, "before openings")
    return Windows(_thinned(first), "evenly spaced")


def _thinned(first: IntArray) -> IntArray:
    """At most MAX_WINDOWS of these rows, at least a quarter of a window from one to the next."""
    kept: list[int] = []
    for row in first.tolist():
        if not kept or row - kept[-1] >= STEPS // 4:
            kept.append(row)
    every = max(1, -(-len(kept) // MAX_WINDOWS))
    return np.array(kept[::every], dtype=np.int64)


def roll_out(accelerate: Accelerate, samples: RingSamples, start: IntArray, theta: Array, theta_dot: Array) -> Rollout:
    """Roll theta_dd = accelerate(state) out from (theta, theta_dot) (W,) at rows `start`, by Heun's method."""
    dt, angle = samples.dt, np.empty((len(start), STEPS + 1))
    angle[:, 0], rate = theta, theta_dot.copy()
    before = accelerate(_state(samples, start, angle[:, 0], rate))
    for i in range(STEPS):
        ahead = angle[:, i] + dt * rate + 0.5 * dt * dt * before
        after = accelerate(_state(samples, start + i + 1, ahead, rate + dt * before))
        angle[:, i + 1] = angle[:, i] + dt * rate + dt * dt * (before / 3.0 + after / 6.0)
        rate = np.clip(rate + 0.5 * dt * (before + after), -FASTEST, FASTEST)
        before = accelerate(_state(samples, start + i + 1, angle[:, i + 1], rate))
    return Rollout.against(angle, samples.k.theta, start)


def roll_out_delayed(
    accelerate: Accelerate, samples: RingSamples, start: IntArray, theta: Array, theta_dot: Array
) -> Rollout:
    """`roll_out` for a model whose input is the rate LAG samples ago.

    This rate comes from the rolled-out angles, at the beginning from the measured angles. Angles advance by
    theta_{k+1} = theta_k + dt v_{k+1/2}."""
    dt, n = samples.dt, len(start)
    past = samples.measured[start[:, None] + np.arange(-LAG - 1, 0)]
    angle = np.concatenate([past, theta[:, None], np.empty((n, STEPS))], axis=1)
    rate, now = theta_dot.copy(), LAG + 1
    for i in range(STEPS):
        late = (angle[:, now - LAG] - angle[:, now - LAG - 1]) / dt
        felt = accelerate(_state(samples, start + i, angle[:, now], late))
        rate = np.clip(rate + (0.5 if i == 0 else 1.0) * dt * felt, -FASTEST, FASTEST)  # half a step to v_{1/2}
        angle[:, now + 1] = angle[:, now] + dt * rate
        now += 1
    return Rollout.against(angle[:, LAG + 1 :], samples.k.theta, start)


def _state(samples: RingSamples, rows: IntArray, theta: Array, theta_dot: Array) -> RingKinematics:
    return replace(pick(samples.k, rows), theta=theta, theta_dot=theta_dot)


def angle_noise(samples: RingSamples) -> float:
    """Standard deviation of a measured angle, rad, from third differences; robust against impacts."""
    rough = np.diff(samples.measured, n=3)[np.diff(samples.segment)[2:] == 0] if len(samples) > 3 else np.zeros(0)
    rough = rough[np.isfinite(rough)]
    return 1.4826 * float(np.median(np.abs(rough))) / math.sqrt(20.0) if len(rough) else 0.0  # 1, 3, 3, 1


def causal_start(
    accelerate: Accelerate, samples: RingSamples, start: IntArray, noise: float, misfit: float
) -> tuple[Array, Array]:
    """Filtered angle (W,) and rate (W,) at rows `start`.

    noise:   standard deviation of a measured angle, rad
    misfit:  rms error of the model, rad/s^2"""
    dt, R = samples.dt, max(noise, 1e-5) ** 2
    first = np.maximum(start - PAST, np.searchsorted(samples.segment, samples.segment[start]))
    ahead = np.minimum(first + FIRST, start)
    theta = samples.measured[first].copy()
    rate = (samples.measured[ahead] - theta) / (dt * np.maximum(ahead - first, 1))
    P = np.zeros((len(start), 2, 2))
    P[:, 0, 0], P[:, 1, 1] = R, 2.0 * R / (FIRST * dt) ** 2 + (misfit * FIRST * dt) ** 2
    F = np.array([[1.0, dt], [0.0, 1.0]])
    Q = 2.0 * MEMORY * misfit**2 * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    for i in range(PAST):
        row = first + i
        on = row < start
        if not on.any():
            break
        now, following = np.minimum(row, start), np.minimum(row + 1, start)
        push = accelerate(_state(samples, now, theta, rate))
        predicted, faster = theta + dt * rate + 0.5 * dt * dt * push, rate + dt * push
        P_ahead = F @ P @ F.T + Q
        gain = P_ahead[:, :, 0] / (P_ahead[:, 0, 0] + R)[:, None]
        innovation = samples.measured[following] - predicted
        theta = np.where(on, predicted + gain[:, 0] * innovation, theta)
        rate = np.where(on, faster + gain[:, 1] * innovation, rate)
        P = np.where(on[:, None, None], P_ahead - gain[:, :, None] * P_ahead[:, :1, :], P)
    return theta, rate
