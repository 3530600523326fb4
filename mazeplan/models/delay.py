"""How late the camera is, by prediction: the delay whose tilt history explains best where the ball went.

From short stretches of a log the ball is started with a position and velocity smoothed over `START` samples and
played forward by the
planar model, walls and openings included, under the tilt that was measured `delay` earlier. The wrong delay makes
the ball turn too early or too late. The
error after `AHEAD` samples, capped at `CAP` so that impacts do not decide, is smallest at the true delay; a
parabola through the best three of a grid
refines it, and a bootstrap over blocks of the record gives its standard error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mazeplan.data.smoothing import smoothed
from mazeplan.data.table import Table
from mazeplan.physics.planar import PlanarModel, predict_given_tilt
from mazeplan.records import Array, IntArray

GRID = np.arange(0.0, 0.1751, 1.0 / 120.0)  # s
START = 7  # samples that give position and velocity at their middle
AHEAD = 8  # samples from there; 0.27 s at 30 Hz
CAP = 3e-3  # m
HISTORY = 8  # samples of tilt that are kept before a start: more than the longest delay of the grid
RESAMPLES = 200


def usable_starts(table: Table, starts: IntArray) -> IntArray:
    """Of the first samples given, those from which START and AHEAD samples follow without a gap."""
    seen, segment = np.isfinite(table["x"]), table.segment
    need = START // 2 + AHEAD
    starts = starts[(starts >= HISTORY) & (starts + START + AHEAD + HISTORY < len(table))]
    whole = np.lib.stride_tricks.sliding_window_view(seen, need + START // 2 + 1)[starts].all(axis=1)
    return starts[whole & (segment[starts - HISTORY] == segment[starts + START + AHEAD + HISTORY])]


def prediction_errors(table: Table, starts: IntArray, model: PlanarModel, delay: float, dt: float) -> Array:
    """Distance in m between prediction and measurement AHEAD samples on, shape (K,)."""
    grid = np.arange(len(table)) * dt
    tilts = np.ascontiguousarray(np.stack([smoothed(table[axis], 5) for axis in ("beta", "gamma")], axis=1))
    tau = (np.arange(START) - START // 2) * dt
    smoother = np.linalg.pinv(np.stack([np.ones(START), tau, tau**2], axis=1))[:2]  # position and velocity at tau = 0
    rows = starts[:, None] + np.arange(START)
    x, y = table["x"][rows] @ smoother.T, table["y"][rows] @ smoother.T
    errors = np.empty(len(starts))
    for i, start in enumerate(starts):
        k = int(start) + START // 2
        z = np.array([x[i, 0], y[i, 0], x[i, 1], y[i, 1], 0.0, 0.0, 0.0, 0.0])
        window = slice(k - HISTORY, k + AHEAD + 2)
        predict_given_tilt(
            z, grid[k] - delay, grid[k + AHEAD] - delay, grid[window], tilts[window],
            model.scalars, model.rings, model.walls, model.gaps,
        )  # fmt: skip
        errors[i] = np.hypot(z[0] - table["x"][k + AHEAD], z[1] - table["y"][k + AHEAD])
    return errors


def best_delay(
    table: Table, starts: IntArray, blocks: IntArray, model_at: Callable[[float], PlanarModel], dt: float, seed: int = 0
) -> tuple[float, float]:
    """(delay, standard error) in s. model_at(delay): the planar model fitted with that delay; blocks (K,): block of
    each start."""
    losses = np.array(
        [np.minimum(prediction_errors(table, starts, model_at(float(d)), float(d), dt), CAP) for d in GRID]
    )
    names, at = np.unique(blocks, return_inverse=True)
    sums = np.stack([np.bincount(at, weights=row, minlength=len(names)) for row in losses])
    counts = np.bincount(at, minlength=len(names)).astype(float)
    rng = np.random.default_rng(seed)
    draws = [rng.integers(0, len(names), len(names)) for _ in range(RESAMPLES)]
    again = [vertex(GRID, sums[:, d].sum(axis=1) / counts[d].sum()) for d in draws]
    return vertex(GRID, losses.mean(axis=1)), float(np.std(again))


def vertex(grid: Sequence[float] | Array, values: Array) -> float:
    """Place of the minimum: vertex of the parabola through the smallest value and two neighbours on either side,
    within the grid."""
    grid = np.asarray(grid)
    i = int(np.argmin(values))
    near = slice(max(i - 2, 0), min(i + 3, len(grid)))
    curvature, slope, _ = np.polyfit(grid[near] - grid[i], values[near], 2)
    if curvature <= 0.0:
        return float(grid[i])
    return float(np.clip(grid[i] - slope / (2.0 * curvature), grid[near][0], grid[near][-1]))
