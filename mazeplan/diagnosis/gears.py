"""Play between servo and plate, seen in commands and measured tilt: the plate follows only when the gears have turned
through it.

    passed on_k = clip(passed on_(k-1), u_k - b/2, u_k + b/2)

The axis is fitted to what the gears pass on, for a b that makes it fit best.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from mazeplan.models.stage import StageFit, fit_axis, played, simulate_axis
from mazeplan.records import Array

TRIED = 0.005  # rad, with which the first look is taken
MOST = 0.08  # rad
SMALLEST = 2e-3  # rad; play worth a word
SURE = 15.0  # of -2 log L


def fit_with_play(u: Array, angle: Array, dt: float, first: np.ndarray, rows: np.ndarray) -> StageFit:
    """The axis with the play that its record shows, if any: commands u and angle (N,), rows (N,) to look at. Raises
    ValueError as `fit_axis`."""

    def fitted(backlash: float) -> StageFit:
        return fit_axis(played(u, backlash)[rows], angle[rows], dt, first[rows].astype(float))

    plain = fitted(0.0)
    left = (angle - simulate_axis(plain.axis, u, dt))[rows]
    late = (simulate_axis(plain.axis, played(u, TRIED), dt) - simulate_axis(plain.axis, u, dt))[rows]
    fits = float(left @ late) / max(float(np.linalg.norm(left) * np.linalg.norm(late)), 1e-300)
    if fits <= 0.0 or -plain.samples * math.log1p(-min(fits * fits, 0.999)) < SURE:
        return plain
    found: Any = minimize_scalar(lambda b: fitted(b).rms, bounds=(0.0, MOST), method="bounded", options={"xatol": 1e-4})
    best = float(found.x)
    with_play = fitted(best)
    gain = 2.0 * plain.samples * math.log(plain.rms / with_play.rms)
    if best < SMALLEST or gain < SURE:
        return plain
    slope = (
        simulate_axis(with_play.axis, played(u, best + 1e-4), dt) - simulate_axis(with_play.axis, played(u, best), dt)
    ) / 1e-4
    sigma = with_play.rms / max(float(np.linalg.norm(slope[rows])), 1e-300)
    stderr = {**with_play.axis.stderr, "backlash": sigma}
    return replace(with_play, axis=replace(with_play.axis, backlash=best, stderr=stderr))
