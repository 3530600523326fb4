"""How far a model is off after 20 and 40 samples: roll-outs from causal estimates along the measured tilt.

Each window begins with angle and rate as a filter knew them at that moment, without a look at what came after, goes on
by the model alone along the measured tilt, and is compared with the measured angle. Windows end in front of an opening
where openings are known (where a good prediction counts most), else they are spread evenly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mazeplan.maths.angles import difference
from mazeplan.models.samples import LAG, RingSamples, pick
from mazeplan.physics.arrays import RingKinematics
from mazeplan.records import Array, IntArray

STEPS = 40
CHECKED = (20, 40)
MOST = 400  # windows of a ring
FEWEST = 10  # windows in front of openings, below which evenly spaced ones are taken
NEAR = np.radians(12.0)  # rad between the end of a window and the opening in front of it


@dataclass(frozen=True)
class Windows:
    """First rows (W,) of windows of STEPS + 1 samples, and how they were chosen."""

    start: IntArray
    chosen: str

    def __len__(self) -> int:
        return len(self.start)


@dataclass(frozen=True)
class Rollout:
    """angle (W, STEPS + 1), rad: predicted; error (W, STEPS + 1), rad: absolute, against the measured angle."""

    angle: Array
    error: Array

    def after(self, steps: int) -> float:
        """Mean absolute error after so many samples, rad."""
        return float(np.mean(self.error[:, steps]))

    def bands(self) -> dict[str, list[float]]:
        """Mean and deciles 1, 5 and 9 of the error over the windows, after 0 to STEPS samples, rad."""
        low, middle, high = np.quantile(self.error, [0.1, 0.5, 0.9], axis=0)
        parts = {"mean": self.error.mean(axis=0), "p10": low, "p50": middle, "p90": high}
        return {name: part.tolist() for name, part in parts.items()}


def choose_windows(samples: RingSamples, allowed: np.ndarray, openings: Array | None = None) -> Windows:
    """Windows whose rows are all allowed (N,) and good, not overlapping by more than three quarters.

    openings: angles (rad) of the openings of this ring, where they are known."""
    usable = allowed & samples.good
    run = np.concatenate([[0], np.cumsum(~usable)])
    first = np.arange(max(len(samples) - STEPS, 0))
    whole = (run[first + STEPS + 1] - run[first] == 0) & (samples.segment[first] == samples.segment[first + STEPS])
    first = first[whole]
    if openings is not None and len(openings):
        end = first + STEPS
        theta, rate = samples.k.theta[end], samples.k.theta_dot[end]
        ahead = difference(np.asarray(openings)[None, :], theta[:, None]) * np.sign(rate)[:, None]
        near = first[((ahead > 0.0) & (ahead < NEAR)).any(axis=1)]
        near = _thinned(near, STEPS // 4)
        if len(near) >= FEWEST:
            return Windows(near, "before openings")
    return Windows(_thinned(first, STEPS // 4), "evenly spaced")


def _thinned(first: IntArray, apart: int) -> IntArray:
    """At most MOST of them, at least `apart` rows from one to the next."""
    kept: list[int] = []
    for row in first.tolist():
        if not kept or row - kept[-1] >= apart:
            kept.append(row)
    every = max(1, -(-len(kept) // MOST))
    return np.array(kept[::every], dtype=np.int64)


def roll_out(
    accelerate: Callable[[RingKinematics], Array],
    samples: RingSamples,
    start: IntArray,
    theta: Array,
    theta_dot: Array,
    push: Array | None = None,
) -> Rollout:
    """Roll theta_dd = accelerate(state) out from (theta, theta_dot) (W,) at rows `start`, by Heun's method.

    push (W, STEPS + 1): rad/s^2 besides, at each sample. A prediction that leaves all bounds stays where it left them,
    so that one window cannot make a mean infinite."""
    dt, angle = samples.dt, np.empty((len(start), STEPS + 1))
    push = np.zeros((1, STEPS + 1)) if push is None else push
    angle[:, 0], rate = theta, theta_dot.copy()
    before = accelerate(_state(samples, start, angle[:, 0], rate)) + push[:, 0]
    for i in range(STEPS):
        ahead = angle[:, i] + dt * rate + 0.5 * dt * dt * before
        after = accelerate(_state(samples, start + i + 1, ahead, rate + dt * before)) + push[:, i + 1]
        angle[:, i + 1] = angle[:, i] + dt * rate + dt * dt * (before / 3.0 + after / 6.0)
        rate = np.clip(rate + 0.5 * dt * (before + after), -30.0, 30.0)
        before = accelerate(_state(samples, start + i + 1, angle[:, i + 1], rate)) + push[:, i + 1]
    rows = start[:, None] + np.arange(STEPS + 1)
    return Rollout(angle, np.abs(angle - samples.k.theta[rows]))


def roll_out_delayed(
    accelerate: Callable[[RingKinematics], Array],
    samples: RingSamples,
    start: IntArray,
    theta: Array,
    theta_dot: Array,
    push: Array | None = None,
) -> Rollout:
    """The same for a model that takes the rate of LAG samples ago: it is given that of the angles rolled out, and at
    first of those measured. Angles go by differences, theta_{k+1} = theta_k + dt v_{k+1/2}."""
    dt, n = samples.dt, len(start)
    push = np.zeros((1, STEPS + 1)) if push is None else push
    past = samples.measured[start[:, None] + np.arange(-LAG - 1, 0)]
    angle = np.concatenate([past, theta[:, None], np.empty((n, STEPS))], axis=1)
    rate, now = theta_dot.copy(), LAG + 1
    for i in range(STEPS):
        late = (angle[:, now - LAG] - angle[:, now - LAG - 1]) / dt
        felt = accelerate(_state(samples, start + i, angle[:, now], late)) + push[:, i]
        rate = np.clip(rate + (0.5 if i == 0 else 1.0) * dt * felt, -30.0, 30.0)  # half a step to v_{1/2}
        angle[:, now + 1] = angle[:, now] + dt * rate
        now += 1
    out = angle[:, LAG + 1 :]
    rows = start[:, None] + np.arange(STEPS + 1)
    return Rollout(out, np.abs(out - samples.k.theta[rows]))


def _state(samples: RingSamples, rows: IntArray, theta: Array, theta_dot: Array) -> RingKinematics:
    return replace(pick(samples.k, rows), theta=theta, theta_dot=theta_dot)
