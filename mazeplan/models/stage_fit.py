"""The fit of an axis of the stage (`physics.stage`) to a log, by output error.

The fit simulates the axis with the commands that were given (exactly, zero-order hold) and compares angles, so that
noise of the tilt sensor does not bias it. It starts from that axis of a grid of poles and dead times whose simulation,
with the gain and the offset that suit it best (least squares), is nearest to what was measured.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from mazeplan.physics.stage import StageAxis, simulate_axis
from mazeplan.records import Array

# where the search starts from: natural frequency in rad/s, damping, dead time in s
FREQUENCIES = (2.0, 3.0, 4.5, 7.0, 10.0, 14.0, 20.0, 28.0, 40.0)
DAMPINGS = (0.2, 0.4, 0.7, 1.2, 2.0)
DEAD_TIMES = (0.0, 1.0 / 30.0, 1.0 / 15.0, 0.1, 2.0 / 15.0, 1.0 / 6.0, 0.2, 0.25)
SETTLE_S = 0.5  # s at the beginning of a stretch that are left out: how it moved before is not known ...
SETTLE_TIMES = 3.5  # ... and as many time constants of the slowest pole (3 % left), up to a third of the stretch
LOW = (0.1, 0.5, 0.05, 0.0, -0.3)  # bounds of the fit: gain, natural frequency, damping, dead time, offset
HIGH = (10.0, 240.0, 7.0, 0.5, 0.3)


@dataclass(frozen=True)
class StageFit:
    """An axis fitted to a log. rms: rad, of measured minus simulated angle; samples used."""

    axis: StageAxis
    rms: float
    samples: int


def fit_axis(u: Array, angle: Array, dt: float, breaks: Array | None = None, near: StageAxis | None = None) -> StageFit:
    """Fit one axis to commands u (N,) and measured angle (N,), sampled every dt s. breaks: True where a new record
    begins; near: an axis that is like it, so that none has to be looked for, which is most of the time.

    Raises ValueError when there is nothing to fit: fewer than 60 samples, or a command that never moves."""
    from scipy.optimize import least_squares

    if len(u) < 60 or np.ptp(u) < 1e-3:
        raise ValueError(f"got {len(u)} samples with commands over {np.ptp(u) if len(u) else 0.0:.2g} rad")
    number = np.zeros(len(u)) if breaks is None else np.cumsum(breaks).astype(np.float64)
    edges = [0, *(int(i) + 1 for i in np.flatnonzero(np.diff(number))), len(u)]
    pieces = [(a, b) for a, b in itertools.pairwise(edges) if b - a >= 30]

    def error(x: Array, settled: float) -> Array:
        axis = StageAxis(x[0], math.exp(x[1]), math.exp(x[2]), x[3], x[4])
        late = (min(round(settled / dt), max((b - a) // 3, round(SETTLE_S / dt))) for a, b in pieces)
        simulated = ((simulate_axis(axis, u[a:b], dt) - angle[a:b])[n:] for (a, b), n in zip(pieces, late, strict=True))
        return np.concatenate(list(simulated))

    bounds = (_point(StageAxis(*LOW)), _point(StageAxis(*HIGH)))

    def fitted(start: Array, settled: float) -> Any:
        sizes = [0.1, 0.1, 0.1, 0.01, 0.01]
        return least_squares(error, start, bounds=bounds, x_scale=sizes, method="trf", args=(settled,))

    best = fitted(_point(near or _nearest(u, angle, dt, pieces)), SETTLE_S)
    slowest = max(pole.real for pole in StageAxis(1.0, math.exp(best.x[1]), math.exp(best.x[2])).poles())
    if -SETTLE_TIMES / slowest > SETTLE_S:
        best = fitted(best.x, -SETTLE_TIMES / slowest)
    n = len(best.fun)
    variance = 2.0 * best.cost / max(n - 5, 1)
    # not by pinv, which drops what the record says nothing about and so calls it certain
    _, sizes, turn = np.linalg.svd(best.jac, full_matrices=False)
    sigma = np.sqrt(variance) * np.linalg.norm(turn.T / np.maximum(sizes, 1e-12 * sizes[0]), axis=1)
    wn, zeta = math.exp(best.x[1]), math.exp(best.x[2])
    names = ("gain", "natural_frequency", "damping", "dead_time", "offset")
    scale = (1.0, wn, zeta, 1.0, 1.0)
    stderr = {name: float(s * k) for name, s, k in zip(names, sigma, scale, strict=True)}
    axis = StageAxis(float(best.x[0]), wn, zeta, float(best.x[3]), float(best.x[4]), stderr)
    return StageFit(axis, float(np.sqrt(variance)), n)


def _nearest(u: Array, angle: Array, dt: float, pieces: list[tuple[int, int]]) -> StageAxis:
    """The axis of the grid, with the best gain and offset for it, whose simulation is nearest to what was measured."""
    warm = round(SETTLE_S / dt)
    starts = [min(warm, (b - a) // 3) for a, b in pieces]
    measured = np.concatenate([angle[a + n : b] for (a, b), n in zip(pieces, starts, strict=True)])
    found = []
    for frequency, damping in itertools.product(FREQUENCIES, DAMPINGS):
        moved = [simulate_axis(StageAxis(1.0, frequency, damping), u[a:b], dt) for a, b in pieces]
        for dead_time in DEAD_TIMES:
            late = round(dead_time / dt)
            rows = [np.concatenate([np.full(late, w[0]), w])[n : len(w)] for w, n in zip(moved, starts, strict=True)]
            columns = np.stack([np.concatenate(rows), np.ones(len(measured))], axis=1)
            best = np.linalg.lstsq(columns, measured, rcond=None)[0]
            error = float(np.sum((columns @ best - measured) ** 2))
            found.append((error, float(best[0]), frequency, damping, late * dt, float(best[1])))
    return StageAxis(*(float(x) for x in np.clip(min(found)[1:], LOW, HIGH)))


def _point(axis: StageAxis) -> Array:
    """What is searched over: gain, log of natural frequency, log of damping, dead time, offset."""
    return np.array([axis.gain, math.log(axis.natural_frequency), math.log(axis.damping), axis.dead_time, axis.offset])
