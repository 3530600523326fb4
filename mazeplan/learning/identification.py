"""Fit a rig's model to a log: stage by output error, ball by the weak form, camera delay by prediction (`delay`).

The weak form (`weak_form`) is linear in the unknowns of each ring for a given tilt of the table, which all rings share.
The fit alternates between the unknowns of the rings and the tilt of the table. The unknowns of a ring have a Gaussian
prior around the pooled fit of all rings (PRIOR_SIGMA), so that a ring with few windows gets the pooled values.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mazeplan.core.constants import FREE_ROLLING, WALL_ROLLING
from mazeplan.core.errors import guess
from mazeplan.core.logs.table import Table
from mazeplan.core.progress import Words, no_words
from mazeplan.core.records import Array
from mazeplan.learning.delay import best_delay, usable_starts
from mazeplan.learning.features import EFFECTS
from mazeplan.learning.rig_model import RigModel
from mazeplan.learning.samples import rings_of
from mazeplan.learning.stage_fit import StageFit, check_axes, fit_axes
from mazeplan.learning.weak_form import (
    FEWEST_WINDOWS,
    WeakWindows,
    find_windows,
    hardly_moving,
    per_radius,
    ridge,
    smooth_tilt,
    weak_rows,
    window_of,
)
from mazeplan.maze.geometry import Maze, Ring
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.dynamics.planar import PlanarModel
from mazeplan.physics.effects.ball import dry_friction, rolling_inertia, tilt_offset, viscous_friction
from mazeplan.physics.rig.stage import StageModel

PRIOR_SIGMA = np.array([0.03, 0.15, 0.02])  # of a ring around the pooled fit: factor, viscous 1/s, dry m/s^2
POOLED_SIGMA = np.array([2.0, 0.5])  # of the friction of the pooled fit, around 0
TEST_SHARE = 0.3  # the last part of the record, for scores only
MIN_WINDOWS = 20
FRICTION = ("viscous_friction", "dry_friction")  # a ring without it does not have the effect
USUAL_DELAY_S = 0.06  # s, of the camera: sharp enough to tell whether the ball follows the tilt


@dataclass(frozen=True)
class BallPrior:
    """What is known of the ball before the fit of the beads.

    factor:  rolling factor of a ball that rolls along walls, and its standard deviation
    tilt:    tilt of the table (2,), rad, and its standard deviation
    late:    camera delay and its standard error, s; None: it is fitted"""

    factor: tuple[float, float] = (WALL_ROLLING, 0.3)
    tilt: tuple[Array, float] = field(default_factory=lambda: (np.zeros(2), 0.1))
    late: tuple[float, float] | None = None


@dataclass(frozen=True)
class RigFit:
    """Result of `fit_rig`: the model, the fits of both axes, the number of windows by ring."""

    model: RigModel
    stage: tuple[StageFit, StageFit]
    windows: dict[int, int]


def effect_ball(values: Iterable[float], sigma: Iterable[float], asymmetry: float = 0.0) -> BallModel:
    """A ball from the values of the parameters `EFFECTS`.

    sigma:      their standard errors
    asymmetry:  of dry friction"""
    factor, viscous, dry, *offset = (float(value) for value in values)
    effects = (rolling_inertia(factor), viscous_friction(viscous), dry_friction(dry, asymmetry), tilt_offset(*offset))
    stderr: dict[str, dict[str, float]] = {}
    for name, error in zip(EFFECTS, sigma, strict=True):
        effect, parameter = name.split(".")
        stderr.setdefault(effect, {})[parameter] = float(error)
    return BallModel(effects, stderr)


@dataclass(frozen=True)
class _BallFit:
    """The ball of all rings.

    weights, sigma:        rolling factor, viscous and dry friction by ring, and their standard errors
    offset, offset_sigma:  tilt of the table (2,), rad, and its standard errors"""

    weights: dict[int, Array]
    sigma: dict[int, Array]
    offset: Array
    offset_sigma: Array

    def check(self) -> None:
        """Raise ValueError if the ball does not follow the tilt as a ball should."""
        allowed = rolling_inertia.parameters["factor"]
        for ring, (factor, *_) in self.weights.items():
            if not allowed.low <= factor <= allowed.high:
                raise ValueError(
                    f"ring {ring}: the ball does not follow the tilt: its acceleration is {factor:.2g} times that of a "
                    f"sliding point, expected {allowed.low:g} to {allowed.high:g}; are x and y, or beta and gamma, "
                    "swapped, a sign or a unit wrong?"
                )

    def ball(self, ring: Ring) -> BallModel:
        """The ball of a ring, or of the nearest ring with data. In the disc the ball rolls on the floor alone."""
        nearest = min(self.weights, key=lambda number: abs(number - ring.number))
        values = np.concatenate([self.weights[nearest], self.offset])
        if ring.is_disc:
            values[0] = FREE_ROLLING
        ball = effect_ball(values, np.concatenate([self.sigma[nearest], self.offset_sigma]))
        return replace(
            ball, effects=tuple(term for term in ball.effects if term.name not in FRICTION or any(term.numbers))
        )


def _fit_balls(table: Table, windows: list[WeakWindows], delay: float, prior: BallPrior) -> _BallFit:
    """All rings at one delay: first pooled, then each ring around the pooled fit, with a common tilt of the table."""
    tilts = smooth_tilt(table)
    data = {w.ring: weak_rows(table, tilts, w, delay) for w in windows}
    blocks = {w.ring: w.block for w in windows}
    radius = {w.ring: w.radius for w in windows}
    # pooled along the channel, in m/s^2: noise, impacts and dry friction are then alike in all rings
    y = np.concatenate([radius[ring] * target for ring, (target, _) in data.items()])
    X = np.concatenate([F * per_radius(radius[ring]) for ring, (_, F) in data.items()])
    block = np.concatenate([blocks[ring] for ring in data])
    (factor, factor_sigma), (tilt, tilt_sigma) = prior.factor, prior.tilt
    mean = np.array([factor, 0.0, 0.0, *(factor * tilt)])
    pooled, variance, _ = ridge(X, y, mean, np.array([factor_sigma, *POOLED_SIGMA, tilt_sigma, tilt_sigma]), block)
    offset, offset_variance = pooled[3:] / pooled[0], variance[3:] / pooled[0] ** 2
    weights, sigma = {}, {}
    for _ in range(3):
        tilt_y, tilt_X, tilt_b = [], [], []
        for ring, (target, F) in data.items():
            corrected = np.column_stack([F[:, 0] + F[:, 3:] @ offset, F[:, 1:3]])
            mean = np.array([pooled[0], max(pooled[1], 0.0), max(pooled[2], 0.0) / radius[ring]])
            width = PRIOR_SIGMA / np.array([1.0, 1.0, radius[ring]])
            weights[ring], variance, _ = ridge(corrected, target, mean, width, blocks[ring])
            weights[ring] = np.concatenate([weights[ring][:1], np.maximum(weights[ring][1:], 0.0)])
            sigma[ring] = np.sqrt(variance)
            tilt_y.append(target - np.column_stack([F[:, 0], F[:, 1:3]]) @ weights[ring])
            tilt_X.append(weights[ring][0] * F[:, 3:])
            tilt_b.append(blocks[ring])
        offset, offset_variance, _ = ridge(
            np.concatenate(tilt_X), np.concatenate(tilt_y), tilt, np.full(2, tilt_sigma), np.concatenate(tilt_b)
        )
    return _BallFit(weights, sigma, offset, np.sqrt(offset_variance))


def check_record(table: Table, maze: Maze | None) -> None:
    """Raise ValueError if the tilts do not follow their commands, or the ball does not follow the tilts.

    What the table does not show is not checked. maze: None if the ball is not to be checked"""
    if "u_beta" in table and "u_gamma" in table:
        check_axes(table)
    if maze is None or len(table) < window_of(table.dt) or "r" not in table or "theta" not in table:
        return
    enough = [w for w in find_windows(table, maze) if len(w.start) >= MIN_WINDOWS]
    if enough:
        _fit_balls(table, enough, USUAL_DELAY_S, BallPrior()).check()


def _best_delay(
    table: Table, windows: list[WeakWindows], maze: Maze, dt: float, stage: StageModel, prior: BallPrior
) -> tuple[float, float]:
    """Delay of the camera and its standard error, s, with the ball fitted anew at each delay."""
    starts = np.concatenate([w.start for w in windows])
    blocks = np.concatenate([w.block for w in windows])
    usable = np.isin(starts, usable_starts(table, starts))

    def model_at(delay: float) -> PlanarModel | None:
        fit = _fit_balls(table, windows, delay, prior)
        try:
            fit.check()
        except ValueError:  # far from the true delay
            return None
        return PlanarModel.build(maze, StageModel(), {ring.number: fit.ball(ring) for ring in maze.rings})

    return best_delay(table, starts[usable], blocks[usable], model_at, dt, -stage.dead_time)


def _score(table: Table, windows: list[WeakWindows], fit: _BallFit, delay: float) -> dict[str, float]:
    """Residual of the weak form over the spread of its target, by ring."""
    out, tilts = {}, smooth_tilt(table)
    for w in windows:
        if len(w.start) >= MIN_WINDOWS:
            target, F = weak_rows(table, tilts, w, delay)
            predicted = np.column_stack([F[:, 0] + F[:, 3:] @ fit.offset, F[:, 1:3]]) @ fit.weights[w.ring]
            out[f"ring{w.ring}"] = round(float(np.sqrt(np.mean((target - predicted) ** 2)) / np.std(target)), 4)
    return out


def fit_rig(
    table: Table, maze: Maze, sources: tuple[dict[str, str], ...] = (), *, stage: StageModel | None = None,
    prior: BallPrior | None = None, progress: Words = no_words,
) -> RigFit:  # fmt: skip
    """Fit stage, ball and camera delay to a table.

    sources:   files of the table, for the model file
    stage:     the stage, where the table has no measured tilt to fit it to
    prior:     what is known of the ball
    progress:  receives each step in words

    Raises ValueError if the table lacks a column or free motion of the ball. Raises TableError if the table has a ring
    that the map does not have."""
    for name in ("u_beta", "u_gamma", "r"):
        if name not in table:
            known = [there for there in table.columns if there != "segment"]  # a column that the program adds
            needed = "columns x and y, or theta and r, are" if name == "r" else f"column {name} is"
            raise ValueError(f"{needed} needed to fit a whole rig: got {', '.join(known)}{guess(name, known)}")
    rings_of(table, maze)
    dt = table.dt
    progress("stage")
    breaks = np.concatenate([[True], np.diff(table.segment) != 0])
    if stage is None:
        check_axes(table)
        u, angles = (np.column_stack([table[f"{kind}{axis}"] for axis in ("beta", "gamma")]) for kind in ("u_", ""))
        beta, gamma = fit_axes(u, angles, dt, breaks)
        stage = StageModel(beta.axis, gamma.axis)
    else:
        beta, gamma = (StageFit(axis, math.nan, 0) for axis in (stage.beta, stage.gamma))
    # train on the first part of each segment, score on the last
    found = find_windows(table, maze)
    parts = [_part(w, table, True) for w in found]
    most = max((len(w.start) for w in parts), default=0)
    fewest = MIN_WINDOWS if most >= MIN_WINDOWS else FEWEST_WINDOWS  # a short record at a low rate
    train = [w for w in parts if len(w.start) >= fewest]
    test = [w for w in (_part(w, table, False) for w in found) if any(w.ring == t.ring for t in train)]
    if not train:
        raise hardly_moving(table, most)
    progress("how late the camera is")
    prior = prior or BallPrior()
    delay, delay_sigma = prior.late or _best_delay(table, train, maze, dt, stage, prior)
    progress("ball")
    fit = _fit_balls(table, train, delay, prior)
    fit.check()
    scores: dict[str, Any] = {
        f"weak_nrmse_{name}": _score(table, windows, fit, delay) for name, windows in (("train", train), ("test", test))
    }
    model = RigModel(
        stage=stage,
        balls={ring.number: fit.ball(ring) for ring in maze.rings},
        camera_delay=delay,
        camera_delay_stderr=delay_sigma,
        kind="pi",
        rate_hz=round(1.0 / dt, 3),
        data=tuple(dict(source) for source in sources),
        scores=scores,
    )
    return RigFit(model, (beta, gamma), {w.ring: len(w.start) for w in train})


def _part(windows: WeakWindows, table: Table, train: bool) -> WeakWindows:
    """Windows in the first part of their segment, or in the last."""
    segment = table.segment
    numbers, first, count = np.unique(segment, return_index=True, return_counts=True)
    at = np.searchsorted(numbers, segment[windows.start])
    place = (windows.start + (0 if not train else window_of(table.dt)) - first[at]) / count[at]
    keep = place <= 1.0 - TEST_SHARE if train else place > 1.0 - TEST_SHARE
    return WeakWindows(windows.ring, windows.radius, windows.start[keep], windows.block[keep])
