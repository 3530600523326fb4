"""Delay of the camera, by prediction: with the true delay, the tilt predicts the later position of the ball best.

Predictions start in short stretches of a log, from a position and velocity smoothed over START_S. The planar
model, walls and openings included, predicts the ball under the tilt measured `delay` earlier. A wrong delay makes the
ball turn too early or too late. The true delay minimises the error after AHEAD samples, capped at CAP so that impacts
do not decide. A parabola through the best points of a grid refines the delay. A bootstrap over blocks of the record
gives its standard error.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from mazeplan.core.logs.table import Table
from mazeplan.core.records import Array, IntArray
from mazeplan.core.side_by_side import in_processes
from mazeplan.learning.smoothing import smoothed
from mazeplan.physics.dynamics.planar import PlanarModel, predict_given_tilt

STEP, MOST = 1.0 / 120.0, 0.175  # s, of the grid
START_S, STARTS = 0.25, (5, 7)  # s, samples: these give position and velocity at their middle
AHEAD = 8  # samples from this middle to the predicted position; 0.27 s at 30 Hz
CAP = 3e-3  # m; larger errors count as this
HISTORY_S = 0.25  # s of tilt before a start and after a prediction: more than the longest delay
RESAMPLES = 200


def _spans(dt: float) -> tuple[int, int]:
    """Samples of HISTORY_S, and of START_S (an odd number)."""
    return math.ceil(HISTORY_S / dt), min(max(int(START_S / dt) | 1, STARTS[0]), STARTS[1])


def usable_starts(table: Table, starts: IntArray) -> IntArray:
    """The starts from which the samples of START_S and AHEAD follow without a gap."""
    seen, segment, around, first = np.isfinite(table["x"]), table.segment, *_spans(table.dt)
    last = first + AHEAD + around
    starts = starts[(starts >= around) & (starts + last < len(table))]
    whole = np.lib.stride_tricks.sliding_window_view(seen, 2 * (first // 2) + AHEAD + 1)[starts].all(axis=1)
    return starts[whole & (segment[starts - around] == segment[starts + last])]


def prediction_errors(table: Table, starts: IntArray, model: PlanarModel, delay: float, dt: float) -> Array:
    """Distance (K,) between prediction and measurement after AHEAD samples, m."""
    grid, (around, first) = np.arange(len(table)) * dt, _spans(dt)
    tilts = np.ascontiguousarray(np.stack([smoothed(table[axis], 5) for axis in ("beta", "gamma")], axis=1))
    tau = (np.arange(first) - first // 2) * dt
    smoother = np.linalg.pinv(np.stack([np.ones(first), tau, tau**2], axis=1))[:2]  # position and velocity at tau = 0
    rows = starts[:, None] + np.arange(first)
    x, y = table["x"][rows] @ smoother.T, table["y"][rows] @ smoother.T
    errors = np.empty(len(starts))
    for i, start in enumerate(starts):
        k = int(start) + first // 2
        z = np.array([x[i, 0], y[i, 0], x[i, 1], y[i, 1], 0.0, 0.0, 0.0, 0.0])
        window = slice(max(k - around, 0), k + AHEAD + around)
        predict_given_tilt(
            z, grid[k] - delay, grid[k + AHEAD] - delay, grid[window], tilts[window],
            model.scalars, model.rings, model.walls, model.gaps,
        )  # fmt: skip
        errors[i] = np.hypot(z[0] - table["x"][k + AHEAD], z[1] - table["y"][k + AHEAD])
    return errors


def best_delay(
    table: Table, starts: IntArray, blocks: IntArray, model_at: Callable[[float], PlanarModel | None], dt: float,
    least: float = 0.0, seed: int = 0,
) -> tuple[float, float]:  # fmt: skip
    """Delay and its standard error, s.

    starts (K,):  first samples of the stretches
    blocks (K,):  block of each start
    model_at:     model_at(delay) gives the planar model fitted with this delay; None: no ball moves like that
    least:        smallest possible delay, s: no picture shows the ball before it was there"""
    delays = np.arange(least, MOST + 1e-9, STEP)

    def loss(delay: float) -> Array:
        model = model_at(delay)
        if model is None:
            return np.full(len(starts), CAP)
        return np.minimum(prediction_errors(table, starts, model, delay, dt), CAP)

    losses = np.array(in_processes(loss, delays.tolist()))
    names, at = np.unique(blocks, return_inverse=True)
    sums = np.stack([np.bincount(at, weights=row, minlength=len(names)) for row in losses])
    counts = np.bincount(at, minlength=len(names)).astype(float)
    rng = np.random.default_rng(seed)
    draws = [rng.integers(0, len(names), len(names)) for _ in range(RESAMPLES)]
    again = [vertex(delays, sums[:, d].sum(axis=1) / counts[d].sum()) for d in draws]
    return vertex(delays, losses.mean(axis=1)), float(np.std(again))


def vertex(grid: Sequence[float] | Array, values: Array) -> float:
    """Place of the minimum: the vertex of a parabola around the smallest value, within two points on either side."""
    grid = np.asarray(grid)
    i = int(np.argmin(values))
    near = slice(max(i - 2, 0), min(i + 3, len(grid)))
    curvature, slope, _ = np.polyfit(grid[near] - grid[i], values[near], 2)
    if curvature <= 0.0:
        return float(grid[i])
    return float(np.clip(grid[i] - slope / (2.0 * curvature), grid[near][0], grid[near][-1]))
