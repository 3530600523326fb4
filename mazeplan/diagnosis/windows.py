"""Fits to accelerations that a record brings, smoothed: by predicting the positions of each window of the smoothing.

A filter that predicts one sample ahead weighs errors by what it takes for noise. Where a ball hits the edges of gates,
those blows pass for white noise in the acceleration, so strong that nothing slower than a sample counts any more. Here
the residual is what is to be explained,

    e_k = sum_j c_j theta_(k+j) - sum_j c_j theta^_(k+j),    j = -3 .. 3

with the weights c of a Savitzky-Golay second derivative and positions theta^ predicted from the first sample of the
window on (`scores`, matched). Neighbouring windows share samples: for white noise in the acceleration, which the
smoothing averages with weights w, n of them are worth n sum(w^2), and

    -2 log L = n sum(w^2) log mean(e^2)

Midpoint rule in two steps a sample; friction and gates as in `kalman.advance`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit
from scipy.signal import savgol_coeffs

from mazeplan.data.smoothing import acceleration_kernel
from mazeplan.diagnosis.fit import Likelihood
from mazeplan.diagnosis.kalman import SUBSTEPS, passed, resistance, total
from mazeplan.diagnosis.library import Candidate
from mazeplan.diagnosis.ringsystem import RingSystem, Values
from mazeplan.diagnosis.scores import KNOWN, MATCHED, matched_target
from mazeplan.diagnosis.wallterms import against, pressing
from mazeplan.records import Array, IntArray

KEPT = 400  # residuals kept, so that the same values are not tried twice


@njit(cache=True, error_model="numpy")
def _coast(problem, p, k, x, v):
    """Position and speed one sample after sample k."""
    h = problem.dt / SUBSTEPS
    for i in range(SUBSTEPS):
        w = problem.w[k, 2 * i + 1]
        middle = x + 0.5 * h * v
        free = v + h * total(problem, p, middle, v, problem.t[k] + (i + 0.5) * h, w)
        new = free
        if problem.dry >= 0 or problem.wall >= 0:
            most = h * resistance(problem, p, middle, free, w)
            new = 0.0 if abs(free) <= most else free - math.copysign(most, free)
        before = x
        x += 0.5 * h * (v + new)
        v = new
        for g in range(len(problem.gates)):
            if passed(p[problem.gates[g, 0]] + problem.gate_at[g, 0], before, x):
                share = against(pressing(before, v, w, problem.pull), problem.pull, problem.gate_at[g, 1])
                v *= 1.0 - share * p[problem.gates[g, 1]]
    return x, v


@njit(cache=True, error_model="numpy")
def coasts(problem, p, starts, out):
    """Positions (W, steps + 1) from measured samples on into out; the speed at first by the last difference."""
    half = 0.5 * problem.dt
    for j in range(len(starts)):
        k = starts[j]
        x = problem.y[k]
        v = (x - problem.y[k - 1]) / problem.dt
        v += half * total(problem, p, x, v, problem.t[k], problem.w[k, 0])
        out[j, 0] = x
        for i in range(out.shape[1] - 1):
            x, v = _coast(problem, p, k + i, x, v)
            out[j, i + 1] = x


class WindowLikelihood(Likelihood):
    """-2 log L of smoothed accelerations on some rows; the process noise plays no part in it."""

    noisy = False

    def __init__(self, system: RingSystem, library: Sequence[Candidate], rows: np.ndarray) -> None:
        """rows (N,): which count. Raises ValueError for a record without accelerations of its own."""
        super().__init__(system, library, rows)
        target = matched_target(system)
        if target is None:
            raise ValueError("the record brings no accelerations by the smoothing that is known")
        half = MATCHED.window // 2
        begun = np.maximum.accumulate(np.where(system.first, np.arange(len(system)), 0))
        at = np.flatnonzero(rows & np.isfinite(target))
        self.windows: IntArray = at[at - half - begun[at] >= KNOWN]
        self.target: Array = target[self.windows]
        self.weights = savgol_coeffs(MATCHED.window, MATCHED.order, deriv=2, delta=system.dt, use="dot")
        self.worth = float(np.sum(acceleration_kernel(MATCHED.window, MATCHED.order) ** 2))
        self.repeats = 1.0 / self.worth
        self._kept: dict[str, Array] = {}

    def whitened(self, values: Values, q: float) -> tuple[Array, float, float]:
        """Residuals, rad/s^2; 0; and how many independent ones they are worth."""
        key = repr(values)
        if key not in self._kept:
            if len(self._kept) >= KEPT:
                del self._kept[next(iter(self._kept))]
            problem, p = self.system.build(self.library, values)
            out = np.empty((len(self.windows), MATCHED.window))
            coasts(problem, p, self.windows - MATCHED.window // 2, out)
            self._kept[key] = self.target - self.system.seen_at(values, out) @ self.weights
        e = self._kept[key]
        return e, 0.0, len(e) * self.worth

    def volume(self, values: Values) -> float:
        """None: what is compared is in the camera's angles."""
        return 0.0
