"""What a report shows of the residual: innovations against what they may depend on, before and after, and whether they
are white."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mazeplan.diagnosis.fit import Fit, Likelihood
from mazeplan.records import Array

BINS = 24
FEWEST = 12  # samples of a bin that is shown
LAGS = 30  # samples


@dataclass(frozen=True)
class Curve:
    """Mean of the residual in bins of a variable: at (K,), mean (K,), stderr (K,), all residuals in standard deviations
    of an innovation."""

    at: Array
    mean: Array
    stderr: Array


@dataclass(frozen=True)
class Evidence:
    """Of one model: residual (N,), whitened innovations with NaN where there are none; position, speed, time (N,)."""

    residual: Array
    position: Array
    speed: Array
    time: Array

    def against(self, variable: Array, *, braking: bool = False) -> Curve:
        """The residual by bins of a variable with equally many samples; braking: counted against the motion."""
        e = -self.residual * np.sign(self.speed) if braking else self.residual
        good = np.isfinite(e) & np.isfinite(variable)
        e, x = e[good], variable[good]
        edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, BINS + 1))) if len(x) else np.zeros(1)
        bins = np.digitize(x, edges[1:-1])
        parts = [(x[bins == i], e[bins == i]) for i in range(max(len(edges) - 1, 0))]
        parts = [(at, left) for at, left in parts if len(left) >= FEWEST]
        return Curve(
            np.array([at.mean() for at, _ in parts]),
            np.array([left.mean() for _, left in parts]),
            np.array([left.std() / np.sqrt(len(left)) for _, left in parts]),
        )

    def correlations(self) -> Array:
        """Of residuals 1 to LAGS samples apart, (LAGS,); of white ones 95 % are within `white`."""
        e = self.residual - np.nanmean(self.residual)
        power = float(np.nanmean(e * e))
        return np.array([float(np.nanmean(e[lag:] * e[:-lag])) / max(power, 1e-300) for lag in range(1, LAGS + 1)])

    @property
    def white(self) -> float:
        """Two standard errors of a correlation of white residuals."""
        return 2.0 / float(np.sqrt(max(np.isfinite(self.residual).sum(), 1)))


def evidence_of(likelihood: Likelihood, found: Fit) -> Evidence:
    """The residual of a fit on all rows of its record, those held out included."""
    system = likelihood.system
    residual, states = likelihood.everywhere(found.values, found.q)
    position = states[:, 0]
    problem, _ = system.build(likelihood.library, found.values)
    if problem.turn > 0.0:
        position = (position + 0.5 * problem.turn) % problem.turn - 0.5 * problem.turn
    time = np.asarray(system.dt * np.arange(len(states)), dtype=np.float64)
    return Evidence(np.asarray(residual / max(found.noise, 1e-300)), position, states[:, 1].copy(), time)
