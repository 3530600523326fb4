"""Which rows are held out, and scores of a model on them.

nRMSE compares accelerations. The record measures positions, and a smoothing turns them into accelerations. A model must
go through the same smoothing. Otherwise a perfect model would seem wrong where the acceleration changes in a window.

matched     The record has a column theta_ddot, which is the Savitzky-Golay second derivative (window 7, order 2) of its
            theta. This column is the target. The model predicts the positions of each window along the measured tilt.
            It starts at the filter's state at the first sample of the window, which knows no later measurement. The
            predicted positions get the same weights as the measured ones:

                sum_j c_j theta_(k+j),   j = -3 .. 3

            This is the model's acceleration, averaged with `smoothing.acceleration_kernel`. It is exact if the
            acceleration is linear between samples. It is also right where the ball meets an opening or comes to rest.
smoothed    All other records. The target is the acceleration by a Rauch-Tung-Striebel smoother, which finds its noise
            from the record. The model's acceleration is computed in the state that the same smoother gives.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mazeplan.core.maths.angles import difference
from mazeplan.core.records import Array
from mazeplan.diagnosis.document import rounded
from mazeplan.diagnosis.record import RingRecord
from mazeplan.diagnosis.ring.fit import Fit, Likelihood
from mazeplan.diagnosis.ring.kalman import accelerations, roll_out
from mazeplan.diagnosis.ring.system import RingSystem
from mazeplan.learning.smoothing import Smoothing, derivatives, savgol_weights
from mazeplan.learning.split import block_split

AHEAD = (20, 40)  # samples ahead at which roll-outs are scored
EVERY = 10  # samples from one roll-out's start to the next
SETTLED = 30  # samples of a stretch before a roll-out may start
MATCHED = Smoothing(window=7, order=2)
SAME = 1e-2  # maximum difference between a matched column and `MATCHED` of theta, in standard deviations of the latter
KNOWN = 2  # samples of a stretch after which the filter knows the speed
SEEN = 0.7  # share of the record that search and fits see
BLOCK_S = 10.0  # s
GUARD = 8  # rows at a border that belong to neither set: windows of derivatives and states of the filter reach across
LONGEST = 0.5  # share of the record; with a longer stretch, the record counts as one piece
FAR_BEYOND = 2.0  # error over the noise floor; a larger error has further causes that were not found
LABELS = {"nrmse": "nRMSE of theta_dd", **{f"rollout{n}": f"theta error after {n} samples, rad" for n in AHEAD}}


@dataclass(frozen=True)
class RingScore:
    """Errors on some rows."""

    nrmse: float  # of theta_dd
    rollout20: float  # mean absolute error of theta after 20 samples, rad
    rollout40: float  # and after 40 samples
    floor: float  # noise floor of rollout40, rad; it includes the uncertainty of the start

    def document(self) -> dict[str, float | None]:
        """The errors, rounded; None if not finite."""
        return {name: rounded(getattr(self, name), 5) for name in LABELS}

    def nothing_found(self) -> str:
        """The sentence of a record in which no effect was found."""
        if not math.isfinite(self.rollout40):
            same = f"nRMSE of theta_dd {self.nrmse:.3f}; no stretch held out is long enough to look 40 samples ahead"
            return f"Nothing was found, which may be the record: {same}."
        same = f"40-step error {self.rollout40:.4f} rad, noise alone would cause {self.floor:.4f}"
        if self.rollout40 > FAR_BEYOND * self.floor:
            rest = "what causes the rest comes too seldom or too irregularly to be named"
            return f"Nothing that is missing was found: {same}; {rest}: a longer record would tell more."
        return f"Nothing is missing: {same}."

    def both(self, after: RingScore) -> str:
        """These errors and those after the effects were found, in words."""
        if not math.isfinite(self.rollout40):
            return f"nRMSE of theta_dd {self.nrmse:.3f} -> {after.nrmse:.3f}"
        return f"40-step error {self.rollout40:.4f} -> {after.rollout40:.4f} rad"


def seen_and_held(record: RingRecord) -> tuple[np.ndarray, np.ndarray, str]:
    """Seen rows and held-out rows (N,), and the held-out rows in words.

    The last part of an uninterrupted record is held out, because a model has to predict what comes later. A record in
    many pieces has no such order, so blocks all over the record are held out."""
    lengths = np.diff(np.append(np.flatnonzero(record.begins), len(record)))
    if record.u is None and lengths.max() < LONGEST * len(record):
        split = block_split(np.cumsum(record.begins), record.dt, block_s=BLOCK_S, test_share=1.0 - SEEN, guard=GUARD)
        return split.train, split.test, f"blocks of {BLOCK_S:g} s all over the record"
    seen = np.cumsum(np.isfinite(record.theta))  # samples of the ball: it may be elsewhere for most of the record
    rows = seen <= SEEN * seen[-1]
    return rows, ~rows, f"the last {1.0 - SEEN:.0%} of the record"


def score(likelihood: Likelihood, fitted: Fit, rows: np.ndarray) -> RingScore:
    """Scores on some rows (N,)."""
    target, predicted = acceleration_pairs(likelihood, fitted)
    system = likelihood.system
    starts = score_starts(rows, system.begins, np.isfinite(system.theta))
    theta, variances = _rolled_out(likelihood, fitted, starts, AHEAD[-1])
    errors = [np.abs(difference(theta[:, n], system.theta[starts + n])) for n in AHEAD]
    floor = np.sqrt(2.0 / math.pi) * fitted.noise * np.sqrt(variances + 1.0)
    means = [float(np.mean(e)) if len(starts) else math.nan for e in (*errors, floor)]
    return RingScore(nrmse(target, predicted, rows), *means)


def _rolled_out(likelihood: Likelihood, fitted: Fit, starts: np.ndarray, steps: int) -> tuple[Array, Array]:
    """Angles (W, steps + 1) that the camera sees in roll-outs from the filter's states in the rows `starts` (W,), and
    variances (W,) of the last angle, over that of a measurement."""
    _, states = likelihood.everywhere(fitted.values, fitted.q)
    problem, p = likelihood.system.build(likelihood.library, fitted.values)
    positions, variances = roll_out(problem, p, states, starts, steps)
    return likelihood.system.seen_at(fitted.values, positions), variances


def nrmse(target: Array, predicted: Array, rows: np.ndarray) -> float:
    """Root mean square error over the standard deviation of the target, on rows (N,) where both are known."""
    good = rows & np.isfinite(target) & np.isfinite(predicted)
    if good.sum() < 10:
        return math.nan
    spread = float(np.std(target[good]))
    return float(np.sqrt(np.mean((predicted - target)[good] ** 2)) / spread) if spread > 0.0 else math.nan


def acceleration_pairs(likelihood: Likelihood, fitted: Fit) -> tuple[Array, Array]:
    """Target (N,) and prediction (N,) of theta_dd, rad/s^2, with the same smoothing; NaN where unknown."""
    system = likelihood.system
    target = matched_target(system)
    if target is not None:
        return target, _matched(likelihood, fitted)
    smooth = derivatives(system.theta, system.dt, Smoothing("rts"), segment=np.cumsum(system.begins))
    problem, p = system.build(likelihood.library, fitted.values)
    value, rate = (np.ascontiguousarray(np.nan_to_num(part)) for part in (smooth.value, smooth.rate))
    model = accelerations(problem, p, value, rate)
    return np.where(np.isfinite(system.theta), smooth.acceleration, np.nan), model


def matched_target(system: RingSystem) -> Array | None:
    """Accelerations (N,) by `MATCHED`, if the record's column theta_ddot agrees with them; otherwise None."""
    if system.target is None:
        return None
    own = derivatives(system.theta, system.dt, MATCHED, segment=np.cumsum(system.begins)).acceleration
    both = np.isfinite(own) & np.isfinite(system.target)
    if not both.any() or np.max(np.abs(own - system.target)[both]) > SAME * np.std(own[both]):
        return None
    return np.where(both, own, np.nan)


def begun_at(begins: np.ndarray) -> np.ndarray:
    """The row (N,) at which the stretch of each row began."""
    return np.maximum.accumulate(np.where(begins, np.arange(len(begins)), 0))


def _matched(likelihood: Likelihood, fitted: Fit) -> Array:
    """Accelerations (N,) of the model: predicted positions of each window, with the weights of `MATCHED`."""
    system, half = likelihood.system, MATCHED.window // 2
    found, begun = np.full(len(system), np.nan), begun_at(system.begins)
    rows = np.arange(half, len(system) - half)
    rows = rows[(begun[rows - half] == begun[rows + half]) & (rows - half - begun[rows] >= KNOWN)]
    theta, _ = _rolled_out(likelihood, fitted, rows - half, MATCHED.window - 1)
    found[rows] = theta @ savgol_weights(MATCHED.window, MATCHED.order, 2, system.dt)
    return found


def score_starts(rows: np.ndarray, begins: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Start rows of roll-outs: the next samples are in the same stretch, and the compared samples were seen."""
    n, most = len(rows), AHEAD[-1]
    begun = begun_at(begins)
    ends = np.append(np.flatnonzero(begins)[1:], n)
    end = ends[np.searchsorted(ends, np.arange(n), side="right").clip(max=len(ends) - 1)]
    at = np.arange(0, n - most, EVERY)
    good = rows[at] & rows[at + most] & (at - begun[at] >= SETTLED) & (at + most < end[at]) & seen[at]
    for k in AHEAD:
        good &= seen[at + k]
    return at[good]
