"""Scores of a model of the ball in a ring: positions some samples ahead, and accelerations.

A roll-out starts from a state that was fitted to the samples before, and sees no later measurement.

nRMSE compares accelerations. A record measures positions, and a smoothing turns them into accelerations. If the record
has a column theta_ddot that is the Savitzky-Golay second derivative (window 7, order 2) of its theta, this column is
the target, and the predicted positions of each window go through the same smoothing. Otherwise the target is the
acceleration by a Rauch-Tung-Striebel smoother, and the model's acceleration is that in the smoothed state.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import savgol_coeffs

from mazeplan.core.maths.angles import difference
from mazeplan.core.records import Array, IntArray
from mazeplan.diagnosis.effect_entry import Values
from mazeplan.diagnosis.engine.windows import Model, Windows
from mazeplan.diagnosis.excess import TOO_SELDOM, more_than_noise
from mazeplan.diagnosis.record import RingRecord
from mazeplan.learning.smoothing import Smoothing, derivatives

AHEAD = (20, 40)  # samples ahead at which roll-outs are scored
EVERY = 10  # samples from one roll-out's start to the next
BEFORE = (3, 7, 15, 30, 60)  # samples to which the state at the start may be fitted
SETTLED = 30  # samples of a stretch before a roll-out may start
MATCHED = Smoothing(window=7, order=2)
SAME = 1e-2  # maximum difference between a matched column and `MATCHED` of theta, in standard deviations of the latter


@dataclass(frozen=True)
class RingScore:
    """Errors on some rows.

    nrmse: of theta_dd
    rollout20, rollout40: mean absolute error of theta after 20 and 40 samples, rad
    floor: noise floor of rollout40, rad; it includes the uncertainty of the start"""

    nrmse: float
    rollout20: float
    rollout40: float
    floor: float
    unit: str = "rad"
    drawn: str = "rollout40"

    def labels(self) -> dict[str, str]:
        """Words with the unit for each error."""
        ahead = {f"rollout{n}": f"theta error after {n} samples, rad" for n in AHEAD}
        return {"nrmse": "nRMSE of theta_dd", **ahead}

    def document(self) -> dict[str, float | None]:
        """The errors, rounded; None if not finite."""
        pairs = ((name, getattr(self, name)) for name in self.labels())
        return {name: round(value, 5) if math.isfinite(value) else None for name, value in pairs}

    def nothing_found(self) -> str:
        """The sentence of a record in which no effect was found."""
        if not math.isfinite(self.rollout40):
            same = f"nRMSE of theta_dd {self.nrmse:.3f}; no stretch held out is long enough to look 40 samples ahead"
            return f"Nothing was found, which may be the record: {same}."
        same = f"40-step error {self.rollout40:.4f} rad, noise alone would cause {self.floor:.4f}"
        if more_than_noise(self.rollout40, self.floor):
            return f"Nothing that is missing was found: {same}; {TOO_SELDOM}."
        return f"Nothing is missing: {same}."

    def both(self, after: Any) -> str:
        """These errors and those after the effects were found, in words."""
        if not math.isfinite(self.rollout40):
            return f"nRMSE of theta_dd {self.nrmse:.3f} -> {after.nrmse:.3f}"
        worse = " where it was held out, which is no better: a longer record would tell more"
        changed = f"40-step error {self.rollout40:.4f} -> {after.rollout40:.4f} rad"
        return changed + worse * (after.rollout40 > self.rollout40)


class RingScores:
    """Scores of models on some rows (N,) of a record."""

    def __init__(self, model: Model, record: RingRecord, rows: np.ndarray) -> None:
        """model: of the whole record, held-out rows included"""
        self.model, self.record, self.rows = model, record, rows
        self.seen = np.isfinite(model.record.y[:, 0])
        self.begun = np.zeros(len(record), dtype=np.int64)
        self.end = np.zeros(len(record), dtype=np.int64)
        for a, b in model.record.stretches:
            self.begun[a:b], self.end[a:b] = a, b
        self.own = matched_target(record)
        self.before: int | None = None

    def score(self, values: Values) -> RingScore:
        """All errors of a model."""
        if self.before is None:
            self.before = min(BEFORE, key=lambda n: self._ahead(values, n, 4)[1])
        ahead = self._ahead(values, self.before)
        return RingScore(self._nrmse(values), *ahead)

    def far(self, values: Values) -> float:
        """The error after 40 samples alone."""
        before = min(BEFORE, key=lambda n: self._ahead(values, n, 4)[1])
        return self._ahead(values, before)[1]

    def _ahead(self, values: Values, before: int, every: int = 1) -> tuple[float, float, float]:
        """Errors after AHEAD samples, and the noise floor of the last one."""
        n, most = len(self.rows), AHEAD[-1]
        at = np.arange(0, n - most, EVERY * every)
        inside = (at - self.begun[at] >= max(before, SETTLED)) & (at + most < self.end[at])
        good = self.rows[at] & self.rows[at + most] & inside
        for k in (0, *AHEAD):
            good &= self.seen[at + k]
        at = at[good]
        if not len(at):
            return math.nan, math.nan, math.nan
        places, spread = roll_outs(self.model, values, at, before, most)
        errors = [np.abs(difference(places[:, k], self.model.record.y[at + k, 0])) for k in AHEAD]
        floor = math.sqrt(2.0 / math.pi) * float(self.model.noise[0]) * np.sqrt(spread + 1.0)
        one, two, least = (float(np.mean(e)) for e in (*errors, floor))
        return one, two, least

    def _nrmse(self, values: Values) -> float:
        """Error of the acceleration over the standard deviation of its target."""
        target, predicted = self._smoothed(values) if self.own is None else self._matched(values)
        good = self.rows & np.isfinite(target) & np.isfinite(predicted)
        if good.sum() < 10 or not np.std(target[good]) > 0.0:
            return math.nan
        return float(np.sqrt(np.mean((predicted - target)[good] ** 2)) / np.std(target[good]))

    def _smoothed(self, values: Values) -> tuple[Array, Array]:
        record = self.record
        smooth = derivatives(record.theta, record.dt, Smoothing("rts"), segment=np.cumsum(record.begins))
        there = accelerations(self.model, values, np.nan_to_num(smooth.value), np.nan_to_num(smooth.rate))
        return np.where(self.seen, smooth.acceleration, np.nan), there

    def _matched(self, values: Values) -> tuple[Array, Array]:
        assert self.own is not None
        half, least = MATCHED.window // 2, BEFORE[0]
        at = np.flatnonzero(self.rows & np.isfinite(self.own))
        at = at[(at - half - self.begun[at] >= least) & (at + half < self.end[at])]
        at = at[self.seen[at - half] & self.seen[at - half - 1]]
        best = np.full(len(self.rows), np.nan), math.inf
        weights = savgol_coeffs(MATCHED.window, MATCHED.order, deriv=2, delta=self.record.dt, use="dot")
        for before in BEFORE[:2]:
            rows = at[at - half - self.begun[at] >= before]
            places, _ = roll_outs(self.model, values, rows - half, before, MATCHED.window - 1)
            found = np.full(len(self.rows), np.nan)
            found[rows] = places @ weights
            error = float(np.nanmean((found - self.own) ** 2))
            best = min(best, (found, error), key=lambda pair: pair[1])
        return self.own, best[0]


def matched_target(record: RingRecord) -> Array | None:
    """Accelerations (N,) by `MATCHED`, if the record's column theta_ddot agrees with them; otherwise None."""
    if record.theta_ddot is None:
        return None
    own = derivatives(record.theta, record.dt, MATCHED, segment=np.cumsum(record.begins)).acceleration
    both = np.isfinite(own) & np.isfinite(record.theta_ddot)
    if not both.any() or np.max(np.abs(own - record.theta_ddot)[both]) > SAME * np.std(own[both]):
        return None
    return np.where(both, own, np.nan)


def roll_outs(model: Model, values: Values, starts: IntArray, before: int, ahead: int) -> tuple[Array, Array]:
    """Roll-outs from the rows `starts` (M,), from states fitted to `before` samples up to the start.

    Returns the angles as the camera sees them (M, ahead + 1), and the variances (M,) of the last one over that of the
    noise."""
    places, spread = np.empty((len(starts), ahead + 1)), np.empty(len(starts))
    apart = before + ahead + 1
    first = np.full(len(starts), -1)
    ends: list[int] = []  # groups of roll-outs that do not overlap
    for m, start in enumerate(starts.tolist()):
        free = next((g for g, end in enumerate(ends) if start - before >= end), len(ends))
        ends = [*ends, 0] if free == len(ends) else ends
        ends[free], first[m] = start - before + apart, free
    for g in range(len(ends)):
        own = np.flatnonzero(first == g)
        windows = Windows(model, np.column_stack([starts[own] - before, starts[own] + ahead + 1]), counted=before)
        states, r = windows.settled(values)
        rows = starts[own][:, None] + np.arange(ahead + 1)
        places[own] = model.seen(values, model.simulate(values, windows.windows, states))[:, 0][rows]
        _, by_s = windows.columns(values, states, r, ())
        gram = windows.sums(by_s[:, :, None] * by_s[:, None, :])
        slope = np.empty((len(own), 2))
        for j, step in enumerate(windows.state_steps):
            moved = states.copy()
            moved[:, j] += step
            there = model.simulate(values, windows.windows, moved)[rows[:, -1], 0]
            slope[:, j] = (there - model.simulate(values, windows.windows, states)[rows[:, -1], 0]) / step
        solved = np.linalg.solve(
            gram + 1e-12 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(2), slope[:, :, None]
        )
        spread[own] = np.einsum("mi,mi->m", slope, solved[:, :, 0]) / model.noise[0] ** 2
    return places, spread


def accelerations(model: Model, values: Values, x: Array, v: Array) -> Array:
    """Accelerations (N,) in the states (x, v) at the samples."""
    w = list(model.inputs(values)[:, 0].T)
    total = np.zeros(len(x))
    for name, numbers in values.items():
        effect = model.effects[name]
        for term in model.system.terms[name]:
            if term.loss:
                continue
            plain = term.code.vectorised(np)
            kind = "hold" if term.held else "base" if "base" in plain else "term"
            size = np.broadcast_to(plain[kind](x, v, model.record.t, w, effect.numbers(numbers)), x.shape)
            total += -np.sign(v) * size if term.held else size
    return total
