"""Fits to accelerations that a record brings, smoothed: by predicting the positions of each window of the smoothing.

A filter that predicts one sample ahead weighs errors by what it takes for noise. Where a ball hits the edges of gates,
those blows pass for white noise in the acceleration, so strong that nothing slower than a sample counts any more. Here
the residual is what is to be explained,

    e_k = sum_j c_j theta_(k+j) - sum_j c_j theta^_(k+j),    j = -3 .. 3

with the weights c of a Savitzky-Golay second derivative and positions theta^ predicted from the first sample of the
window on (`scores`, matched). Neighbouring windows share samples: for white noise in the acceleration, which the
smoothing averages with weights w, n of them are worth n sum(w^2), and

    -2 log L = n sum(w^2) log mean(e^2)

Derivatives are numeric: a gate that is passed a sample later makes a step, over which a difference averages.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import savgol_coeffs

from mazeplan.data.smoothing import acceleration_kernel
from mazeplan.diagnosis.fit import Likelihood
from mazeplan.diagnosis.kalman import coasts
from mazeplan.diagnosis.library import Candidate
from mazeplan.diagnosis.ringsystem import RingSystem, Values
from mazeplan.diagnosis.scores import KNOWN, MATCHED, matched_target
from mazeplan.records import Array, IntArray

KEPT = 400  # residuals kept, so that the same values are not tried twice


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

    def jacobian(self, values: Values, q: float, steps: Sequence[tuple[str, str, float]]) -> tuple[Array, Array]:
        """Residuals e (n,) and their derivatives (n, J) by parameters (effect, name, step to move by)."""
        e = self.whitened(values, q)[0]
        J = np.empty((len(e), len(steps)))
        for j, (effect, name, step) in enumerate(steps):
            moved = {**values, effect: {**values[effect], name: values[effect][name] + step}}
            J[:, j] = (self.whitened(moved, q)[0] - e) / step
        return e, J

    def volume(self, values: Values) -> float:
        """None: what is compared is in the camera's angles."""
        return 0.0
