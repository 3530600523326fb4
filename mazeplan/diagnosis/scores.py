"""How well a model does on rows that took no part in search or fit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from mazeplan.data.smoothing import Smoothing, derivatives
from mazeplan.diagnosis.fit import Fit, Likelihood
from mazeplan.diagnosis.kalman import accelerations, roll_out
from mazeplan.maths.angles import difference

AHEAD = (20, 40)  # samples
EVERY = 10  # samples from one roll-out's start to the next
SETTLED = 30  # samples of a stretch before a roll-out may start


@dataclass(frozen=True)
class Score:
    """nrmse of theta_dd; mean absolute error of theta (rad) after 20 and 40 samples; floor: that after 40 which noise,
    and what it leaves unknown of the start, would cause alone; windows."""

    nrmse: float
    rollout20: float
    rollout40: float
    floor: float
    windows: int
    labels: ClassVar[dict[str, str]] = {
        "nrmse": "nRMSE of theta_dd",
        "rollout20": "theta error after 20 samples, rad",
        "rollout40": "theta error after 40 samples, rad",
    }
    drawn: ClassVar[str] = "rollout40"
    axes: ClassVar[tuple[str, str]] = ("theta, rad", "theta_dot, rad/s")

    def document(self) -> dict[str, Any]:
        """Plain and rounded."""
        return {name: _plain(getattr(self, name)) for name in self.labels}


def _plain(value: float) -> float | None:
    return round(value, 5) if math.isfinite(value) else None


def score(likelihood: Likelihood, fitted: Fit, rows: np.ndarray) -> Score:
    """Scores on some rows (N,)."""
    system = likelihood.system
    states = likelihood.filtered(fitted.values, fitted.q)
    problem, p = system.build(likelihood.library, fitted.values)
    starts = score_starts(rows, system.first, problem.seen)
    most = AHEAD[-1]
    out = np.empty((len(starts), most + 2))
    roll_out(problem, p, states, starts, most, out)
    errors = [np.abs(difference(out[:, n], system.theta[starts + n])) for n in AHEAD]
    floor = np.sqrt(2.0 / math.pi) * fitted.noise * np.sqrt(out[:, most + 1] + 1.0)
    means = [float(np.mean(e)) if len(starts) else math.nan for e in errors]
    return Score(
        _nrmse(likelihood, fitted, rows),
        means[0],
        means[1],
        float(np.mean(floor)) if len(starts) else math.nan,
        len(starts),
    )


def score_starts(rows: np.ndarray, first: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Rows from which all of the next samples are in the same stretch, and those compared were seen."""
    n, most = len(rows), AHEAD[-1]
    begun = np.maximum.accumulate(np.where(first, np.arange(n), 0))
    ends = np.append(np.flatnonzero(first)[1:], n)
    end = ends[np.searchsorted(ends, np.arange(n), side="right").clip(max=len(ends) - 1)]
    at = np.arange(0, n - most, EVERY)
    good = rows[at] & rows[at + most] & (at - begun[at] >= SETTLED) & (at + most < end[at]) & seen[at]
    for k in AHEAD:
        good &= seen[at + k]
    return at[good]


def _nrmse(likelihood: Likelihood, fitted: Fit, rows: np.ndarray) -> float:
    """Of theta_dd against the smoothed measurement."""
    system = likelihood.system
    smooth = derivatives(system.theta, system.dt, Smoothing("rts"), segment=np.cumsum(system.first))
    problem, p = system.build(likelihood.library, fitted.values)
    model = np.empty(len(system))
    accelerations(problem, p, np.nan_to_num(smooth.value), np.nan_to_num(smooth.rate), model)
    good = rows & np.isfinite(smooth.acceleration) & np.isfinite(system.theta)
    if good.sum() < 10:
        return math.nan
    spread = float(np.std(smooth.acceleration[good]))
    return float(np.sqrt(np.mean((model - smooth.acceleration)[good] ** 2)) / spread) if spread > 0.0 else math.nan
