"""The stage of a rig without a tilt sensor, by the ball: which lag between command and tilt explains its motion best.

For each kind of axis on a grid, the tilt follows from the commands. The weak form of the ball's equation
(`weak_form`) is linear in its unknowns then, so its residual is found at once for each delay of the picture. The
axis with the smallest residual is the stage; its tilt takes the place of the measured one in the table.

The ball is slow, so springy axes look like damped ones with another delay. Only damped ones are tried: a plan on a
springy axis that is none swings.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from mazeplan.core.logs.table import Table
from mazeplan.core.records import Array
from mazeplan.learning.weak_form import WeakWindows, find_windows, hardly_moving, per_radius, smooth_tilt, weak_rows
from mazeplan.maze.geometry import Maze
from mazeplan.physics.rig.stage import StageAxis, StageModel, simulate_axis

FIRST, SECOND, DAMPINGS = (6.0, 9.0, 13.0, 19.0, 28.0, 42.0), (8.0, 11.0, 15.0, 20.0, 26.0, 36.0), (0.7, 1.0)
RATE = 30.0  # Hz, of the rows that are compared; more would only take time
RATIO = 1.45  # of neighbours in these grids of rad/s
DELAYS = np.arange(0.0, 0.21, 1.0 / 60.0)  # s
COARSE_DELAYS = slice(0, None, 3)  # of the delays: those between are tried near the best of them
SIMPLER_LOSS = 1.01  # a simpler axis is taken if its loss is within this factor of the smallest one
ROUNDS = 3  # of weighted least squares
CAPPED = 3.0  # a residual counts at most as this many typical ones: impacts do not decide


def tilt_is_measured(table: Table) -> bool:
    """Whether any row of a table has a tilt."""
    return bool(np.isfinite(table["beta"]).any() or np.isfinite(table["gamma"]).any())


def with_tilt_by_commands(table: Table, stage: StageModel) -> Table:
    """The table with the tilt of a stage under its commands."""
    firsts = np.array([0, *(np.flatnonzero(np.diff(table.segment)) + 1)], dtype=np.int64)
    axes = (("beta", stage.beta), ("gamma", stage.gamma))
    tilts = {name: simulate_axis(axis, table[f"u_{name}"], table.dt, firsts) for name, axis in axes}
    return replace(table, columns={**table.columns, **tilts})


def stage_by_ball(table: Table, maze: Maze) -> StageModel:
    """The stage by which the ball of a table without tilt moves as it does. Both axes are alike.

    Raises ValueError if the ball hardly moves freely."""
    every = max(round(1.0 / (RATE * table.dt)), 1)
    few = _each(table, every)
    found = [w for w in find_windows(few, maze) if len(w.start)]
    windows = [replace(w, start=w.start[::2], block=w.block[::2]) for w in found]  # they overlap
    if not windows:
        raise hardly_moving(few, 0)
    tables = ((axis, with_tilt_by_commands(table, StageModel(axis, axis))) for axis in _axes())
    losses = [(axis, _loss(_each(tilted, every), windows)) for axis, tilted in tables]
    least = min(loss for _, loss in losses)
    order = min(axis.order for axis, loss in losses if loss <= SIMPLER_LOSS * least)
    best, _ = min((found for found in losses if found[0].order == order), key=lambda found: found[1])
    if best.order:
        best = replace(best, stderr={"natural_frequency": best.natural_frequency * (RATIO - 1.0) / 2.0})
    return StageModel(best, best)


def _each(table: Table, every: int) -> Table:
    """Every few rows of a table."""
    return replace(table, columns={name: column[::every] for name, column in table.columns.items()})


def finer_axes() -> Iterator[StageAxis]:
    """Axes on a finer grid, for a sharper measure than the weak form."""
    yield StageAxis.prompt()
    for rate in np.geomspace(0.35, 2.0, 10):  # rad/s, as of stepper motors
        yield replace(StageAxis.prompt(), rate_limit=float(rate))
    for pole in np.geomspace(5.0, 60.0, 13):
        yield StageAxis(1.0, float(pole), 1.0, order=1)
    for frequency, damping in product(np.geomspace(8.0, 45.0, 9), (0.7, 0.95, 1.3)):
        yield StageAxis(1.0, float(frequency), damping)


def _axes() -> Iterator[StageAxis]:
    """The axes that are tried, the simplest first."""
    yield StageAxis.prompt()
    for pole in FIRST:
        yield StageAxis(1.0, pole, 1.0, order=1)
    for frequency, damping in product(SECOND, DAMPINGS):
        yield StageAxis(1.0, frequency, damping)


def _loss(table: Table, windows: Sequence[WeakWindows]) -> float:
    """Smallest robust residual of the weak form over the delays, (m/s^2)^2 in its units."""
    tilts = smooth_tilt(table)
    coarse = [_at_delay(table, tilts, windows, float(delay)) for delay in DELAYS[COARSE_DELAYS]]
    best = COARSE_DELAYS.step * int(np.argmin(coarse))
    between = DELAYS[max(best - COARSE_DELAYS.step + 1, 0) : best + COARSE_DELAYS.step]
    return min(*coarse, *(_at_delay(table, tilts, windows, float(d)) for d in between if d != DELAYS[best]))


def _at_delay(table: Table, tilts: dict[str, Array], windows: Sequence[WeakWindows], delay: float) -> float:
    rows: list[tuple[Array, Array]] = []
    for w in windows:
        target, features = weak_rows(table, tilts, w, delay)
        rows.append((w.radius * target, features * per_radius(w.radius)))
    y, X = np.concatenate([t for t, _ in rows]), np.concatenate([f for _, f in rows])
    weights, loss = np.ones(len(y)), math.inf
    for _ in range(ROUNDS):
        w, *_ = np.linalg.lstsq(X * weights[:, None], y * weights, rcond=None)
        left = np.abs(y - X @ w)
        scale = CAPPED * float(np.median(left)) + 1e-12
        weights, loss = np.sqrt(np.minimum(1.0, scale / np.maximum(left, 1e-12))), np.mean(np.minimum(left, scale) ** 2)
    return float(loss)
