"""Fit an axis of the stage (`physics.stage`) to a log, by output error.

The fit simulates the axis under the recorded commands (exactly, zero-order hold) and compares angles, so that noise of
the tilt sensor causes no bias. It starts from the best axes of a coarse grid, with gain and offset by least squares.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from mazeplan.core.records import Array
from mazeplan.physics.rig.stage import StageAxis
from mazeplan.physics.rig.stage_simulation import simulate_axis

GRID = (  # starts: natural frequencies in rad/s, dampings, dead times in s
    (2.0, 4.0, 8.0, 16.0, 32.0, 64.0), (0.2, 0.5, 1.0, 2.0), (0.0, 1.0 / 30.0, 1.0 / 15.0, 0.1, 0.15, 0.2, 0.3),
)  # fmt: skip
LOOKED_AT = 3000  # maximum number of samples for the choice among these
STARTS = 3  # number of starts: a fast axis with a dead time resembles a slow axis without
FEWEST = 60  # minimum number of samples
SHORTEST = 30  # minimum number of samples of a stretch; shorter ones are left out
LEAST_RANGE = 1e-3  # rad; minimum range of the commands
LOW = (0.1, 0.5, 0.05, 0.0, -0.3)  # bounds of the fit: gain, natural frequency, damping, dead time, offset
HIGH = (10.0, 240.0, 7.0, 0.5, 0.3)
SETTLE_S = 0.5  # minimum s left out at the beginning of a stretch, because the motion before it is unknown
SETTLE_TIMES = 3.5  # time constants of the slowest pole left out there (3 % remain), up to a third of the stretch


@dataclass(frozen=True)
class StageFit:
    """An axis fitted to a log.

    rms:      of measured minus simulated angle, rad
    samples:  number of samples used"""

    axis: StageAxis
    rms: float
    samples: int


def fit_axis(u: Array, angle: Array, dt: float, breaks: Array | None = None, near: StageAxis | None = None) -> StageFit:
    """Fit one axis to commands u (N,) and measured angles (N,), sampled every dt s.

    breaks:  True where a new record begins
    near:    a similar axis to start from, in place of the grid

    Raises ValueError for fewer than FEWEST samples or a constant command."""
    if len(u) < FEWEST:
        raise ValueError(f"got {len(u)} samples, expected at least {FEWEST}: record for longer")
    if np.ptp(u) < LEAST_RANGE:
        got = f"commands within {np.ptp(u):.2g} rad"
        raise ValueError(f"got {got}, expected at least {LEAST_RANGE:g} rad: tilt the plate, as `collect` does")
    firsts = np.array([0, *(np.flatnonzero(breaks[1:]) + 1 if breaks is not None else ())], dtype=np.int64)
    pieces = [(a, b) for a, b in itertools.pairwise([*firsts.tolist(), len(u)]) if b - a >= SHORTEST]
    starts = _on_grid(u, angle, dt, pieces) if near is None else [near]
    settled = max(SETTLE_S, -SETTLE_TIMES / max(pole.real for pole in starts[0].poles()))
    used = np.zeros(len(u), dtype=bool)
    for a, b in pieces:
        used[a + min(round(settled / dt), max((b - a) // 3, round(SETTLE_S / dt))) : b] = True

    def error(x: Array) -> Array:
        axis = StageAxis(x[0], math.exp(x[1]), math.exp(x[2]), x[3], x[4])
        return (simulate_axis(axis, u, dt, firsts) - angle)[used]

    bounds = (_point(StageAxis(*LOW)), _point(StageAxis(*HIGH)))
    how: dict[str, Any] = {"bounds": bounds, "x_scale": [0.1, 0.1, 0.1, 0.01, 0.01]}
    best = min((least_squares(error, _point(start), **how) for start in starts), key=lambda found: found.cost)
    n = len(best.fun)
    variance = 2.0 * best.cost / max(n - 5, 1)
    # pinv would drop directions without information, so that they would seem certain
    _, sizes, turn = np.linalg.svd(best.jac, full_matrices=False)
    sigma = np.sqrt(variance) * np.linalg.norm(turn.T / np.maximum(sizes, 1e-12 * sizes[0]), axis=1)
    wn, zeta = math.exp(best.x[1]), math.exp(best.x[2])
    names = ("gain", "natural_frequency", "damping", "dead_time", "offset")
    scale = (1.0, wn, zeta, 1.0, 1.0)
    stderr = {name: float(s * k) for name, s, k in zip(names, sigma, scale, strict=True)}
    axis = StageAxis(float(best.x[0]), wn, zeta, float(best.x[3]), float(best.x[4]), stderr)
    return StageFit(axis, float(np.sqrt(variance)), n)


def _on_grid(u: Array, angle: Array, dt: float, pieces: list[tuple[int, int]]) -> list[StageAxis]:
    """The STARTS best axes of GRID with different frequencies, the best first; gain and offset by least squares."""
    skip, left = round(SETTLE_S / dt), LOOKED_AT
    best: dict[float, tuple[float, StageAxis]] = {}
    chosen: list[tuple[int, int]] = []
    for a, b in pieces:
        if left > 0:
            chosen.append((a, min(b, a + left)))
            left -= b - a
    rows = np.concatenate([np.arange(a, b) for a, b in chosen])
    firsts = np.flatnonzero(np.isin(rows, [a for a, _ in chosen]))
    used = np.concatenate([np.arange(b - a) >= skip for a, b in chosen])
    commands, target = u[rows], angle[rows][used]
    for frequency, damping, dead in itertools.product(*GRID):
        axis = StageAxis(1.0, frequency, damping, dead)
        moved = simulate_axis(axis, commands, dt, firsts)[used]
        basis = np.column_stack([moved, np.ones(len(moved))])
        (gain, offset), *_ = np.linalg.lstsq(basis, target, rcond=None)
        gain, offset = float(np.clip(gain, LOW[0], HIGH[0])), float(np.clip(offset, LOW[4], HIGH[4]))
        rest = float(np.sum((basis @ [gain, offset] - target) ** 2))
        if frequency not in best or rest < best[frequency][0]:
            best[frequency] = rest, StageAxis(gain, frequency, damping, dead, offset)
    return [axis for _, axis in sorted(best.values(), key=lambda found: found[0])[:STARTS]]


def _point(axis: StageAxis) -> Array:
    """Coordinates of the fit: gain, log of natural frequency, log of damping, dead time, offset."""
    return np.array([axis.gain, math.log(axis.natural_frequency), math.log(axis.damping), axis.dead_time, axis.offset])
