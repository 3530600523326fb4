"""Fit a rig's model to a log: stage by output error, ball by the weak form, camera delay by prediction (`delay`).

Differentiating a noisy angle twice biases a fit. The weak form needs no derivative of the data. With a smooth phi(t)
that vanishes with its derivatives at both ends of a short window, integration by parts gives

    int phi'' theta dt - int phi kinematic dt
        = k int phi gravity dt + c_v int phi' theta dt - c_d int phi sign(theta_dot) dt
        + k beta_0 int phi d gravity/d beta dt + k gamma_0 int phi d gravity/d gamma dt

For a given tilt of the table (beta_0, gamma_0), this equation is linear in the unknowns of each ring: rolling factor k,
viscous friction c_v, dry friction c_d. All rings share the tilt of the table. The fit alternates between the unknowns
of the rings and the tilt of the table. The tilt of the plate is taken at t - delay.

The unknowns of a ring have a Gaussian prior around the pooled fit of all rings (PRIOR_SIGMA), so that a ring with few
windows gets the pooled values. Windows with a missing sample or a change of ring are left out. Windows with an impact
have large residuals and therefore small weights (Huber). Standard errors are robust against correlation within blocks.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mazeplan.core.constants import FREE_ROLLING, WALL_ROLLING
from mazeplan.core.logs.table import Table
from mazeplan.core.name_hints import guess
from mazeplan.core.progress import Words, no_words
from mazeplan.core.records import Array, IntArray
from mazeplan.learning.delay import best_delay, usable_starts
from mazeplan.learning.features import EFFECTS
from mazeplan.learning.rig_model import RigModel
from mazeplan.learning.samples import rings_of
from mazeplan.learning.smoothing import smoothed
from mazeplan.learning.stage_axes import fit_axes
from mazeplan.learning.stage_fit import StageFit
from mazeplan.learning.tilt_checks import check_axes, check_follows
from mazeplan.maze.geometry import Maze
from mazeplan.physics.ball_model import BallModel, RingKinematics, gravity_jacobian, gravity_part, kinematic_terms
from mazeplan.physics.dynamics.planar import PlanarModel
from mazeplan.physics.effects.ball import dry_friction, rolling_inertia, tilt_offset, viscous_friction
from mazeplan.physics.rig.stage import StageModel

WINDOW_S, WINDOWS = 0.4, (7, 13)  # s; fewest and most samples of a window, below 15 Hz and from 30 Hz on
HOP = 3  # samples between windows
BLOCK_S = 5.0  # s; windows within one block count as one observation for standard errors
PRIOR_SIGMA = np.array([0.03, 0.15, 0.02])  # of a ring around the pooled fit: factor, viscous 1/s, dry m/s^2
POOLED_SIGMA = np.array([2.0, 0.5])  # of the friction of the pooled fit, around 0
MOVING = 8e-3  # m/s; slower windows are left out: their friction has no sign
TEST_SHARE = 0.3  # the last part of the record, for scores only
MIN_WINDOWS = 20
FEWEST_WINDOWS = 8  # if no ring has more: the rigid ball is fitted to all rings afterwards
FRICTION = ("viscous_friction", "dry_friction")  # a ring without it does not have the effect
USUAL_DELAY_S = 0.06  # s, of the camera: sharp enough to tell whether the ball follows the tilt
LONG_S = 55.0  # s; such a record is long enough: if windows are missing, something else is wrong


@dataclass(frozen=True)
class WeakWindows:
    """Windows of one ring.

    radius:      of the track, m
    start (K,):  first sample of each window
    block (K,):  number of the block of each window"""

    ring: int
    radius: float
    start: IntArray
    block: IntArray


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


def window_of(dt: float) -> int:
    """Samples of a window, an odd number."""
    return min(max(int(WINDOW_S / dt + 1e-9) | 1, WINDOWS[0]), WINDOWS[1])


def weak_function(dt: float, n: int) -> tuple[Array, Array, Array]:
    """phi, phi', phi'' (n,) of (1 - s^2)^5 over a window of n samples, s from -1 to 1.

    Because of the fifth power, four derivatives vanish at the ends. Sums over samples are then as good as integrals."""
    half = 0.5 * (n - 1) * dt
    s = np.linspace(-1.0, 1.0, n)
    q = 1.0 - s**2
    slope = -10.0 * s * q**4 / half
    curve = (-10.0 * q**4 + 80.0 * s**2 * q**3) / half**2
    return q**5, slope, curve


def find_windows(table: Table, maze: Maze, ring: int, dt: float) -> WeakWindows:
    """Windows in which the ball is always seen, moves in one direction, and stays in the channel of one ring."""
    here = maze.ring(ring)
    r, theta = table["r"], table["theta"]
    reach = maze.ball.radius - 2e-3  # m; noise of the camera may move the ball into a wall
    good = np.isfinite(theta) & (r > here.inner_radius + reach) & (r < here.outer_radius - reach)
    segment, n = table.segment, window_of(dt)
    starts = np.arange(0, len(r) - n + 1, HOP)
    inside = np.lib.stride_tricks.sliding_window_view(good, n)[starts].all(axis=1)
    inside &= segment[starts] == segment[starts + n - 1]
    starts = starts[inside]
    if len(starts):
        moved = _unwrapped(theta, starts, n)
        speed = np.abs(moved[:, 4:] - moved[:, :-4]).min(axis=1) * here.track_radius / (4.0 * dt)
        starts = starts[speed > MOVING]
    return WeakWindows(ring, here.track_radius, starts, (starts * dt // BLOCK_S).astype(int))


def _unwrapped(theta: Array, starts: IntArray, n: int) -> Array:
    """theta of each window of n samples, continuous, (K, n)."""
    rows = starts[:, None] + np.arange(n)
    return np.unwrap(theta[rows], axis=1) if len(starts) else np.zeros((0, n))


def smooth_tilt(table: Table) -> dict[str, Array]:
    """Measured tilt (N,) of both axes, and its smoothed derivatives."""
    out = {}
    for axis in ("beta", "gamma"):
        rates = (smoothed(table[axis], 7, deriv=order, dt=table.dt) for order in (1, 2))
        out |= zip((axis, f"{axis}_dot", f"{axis}_ddot"), (table[axis], *rates), strict=True)
    return out


def weak_rows(
    table: Table, tilts: dict[str, Array], windows: WeakWindows, delay: float, dt: float
) -> tuple[Array, Array]:
    """Targets (K,) and features (K, 5): gravity, viscous, dry, d gravity / d beta, d gravity / d gamma.

    tilts: see `smooth_tilt`"""
    n = window_of(dt)
    phi, slope, curve = weak_function(dt, n)
    rows = windows.start[:, None] + np.arange(n)
    theta = _unwrapped(table["theta"], windows.start, n)
    late, grid = np.clip(rows - delay / dt, 0, len(table) - 1).ravel(), np.arange(len(table))
    flat = {name: np.interp(late, grid, values) for name, values in tilts.items()}
    theta_dot = np.gradient(theta, dt, axis=1)
    k = RingKinematics(windows.radius, theta.ravel(), theta_dot.ravel(), **flat)
    shape, weight = theta.shape, phi * dt
    gravity = gravity_part(k).reshape(shape)
    by_tilt = np.einsum("kwi,w->ki", gravity_jacobian(k)[:, [2, 4]].reshape(*shape, 2), weight)
    theta = theta - theta[:, n // 2, None]  # the sums of phi' and phi'' vanish but for rounding
    target = theta @ curve * dt - kinematic_terms(k).reshape(shape) @ weight
    direction = np.sign(theta[:, -1] - theta[:, 0])[:, None] * np.ones(n)
    columns = [gravity @ weight, theta @ slope * dt, -direction @ weight, by_tilt[:, 0], by_tilt[:, 1]]
    return target, np.stack(columns, axis=1)


def per_radius(radius: float) -> Array:
    """Factors (5,) that turn the features of a ring into those of `radius * theta_dd`, with dry friction in m/s^2."""
    return np.array([radius, radius, 1.0, radius, radius])


def _huber(residual: Array, width: float = 2.0) -> Array:
    """Huber weights (N,) of residuals (N,): below 1 for large residuals."""
    scale = 1.4826 * np.median(np.abs(residual)) + 1e-12
    return np.minimum(1.0, width * scale / np.maximum(np.abs(residual), 1e-12))


def ridge(X: Array, y: Array, mean: Array, sigma: Array, block: IntArray) -> tuple[Array, Array, Array]:
    """MAP estimate of w in y = X w, with the prior w ~ N(mean, sigma^2). Returns (w, variances, residual).

    It estimates noise and Huber weights, too. Each variance is the larger of the Bayesian and the block-robust one."""
    w, weights = mean.copy(), np.ones(len(y))
    noise, precision = 1.0, np.diag(1.0 / sigma**2)
    information = precision
    for _ in range(8):
        information = (X * weights[:, None]).T @ X / noise + precision
        w = np.linalg.solve(information, (X * weights[:, None]).T @ y / noise + precision @ mean)
        residual = y - X @ w
        weights = _huber(residual)
        noise = max(float(np.sum(weights * residual**2) / max(np.sum(weights), 1.0)), 1e-12)
    residual = y - X @ w
    bread = np.linalg.inv(information)
    scores = X * (weights * residual)[:, None] / noise
    meat = sum(
        (np.outer(s, s) for s in (scores[block == b].sum(axis=0) for b in np.unique(block))), np.zeros_like(bread)
    )
    robust = np.diag(bread @ meat @ bread)
    return np.asarray(w, dtype=np.float64), np.where(robust > np.diag(bread), robust, np.diag(bread)), residual


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
        """Raise ValueError if the ball does not follow the tilt."""
        for ring, found in self.weights.items():
            check_follows(ring, float(found[0]))

    def ball(self, ring: int, maze: Maze) -> BallModel:
        """The ball of a ring, or of the nearest ring with data. In the disc the ball rolls on the floor alone."""
        nearest = min(self.weights, key=lambda number: abs(number - ring))
        values = np.concatenate([self.weights[nearest], self.offset])
        if maze.ring(ring).is_disc:
            values[0] = FREE_ROLLING
        ball = effect_ball(values, np.concatenate([self.sigma[nearest], self.offset_sigma]))
        return replace(
            ball, effects=tuple(term for term in ball.effects if term.name not in FRICTION or any(term.numbers))
        )

    def balls(self, maze: Maze) -> dict[int, BallModel]:
        """The balls of all rings."""
        return {ring.number: self.ball(ring.number, maze) for ring in maze.rings}


def _fit_balls(table: Table, windows: list[WeakWindows], delay: float, dt: float, prior: BallPrior) -> _BallFit:
    """All rings at one delay: first pooled, then each ring around the pooled fit, with a common tilt of the table."""
    tilts = smooth_tilt(table)
    data = {w.ring: weak_rows(table, tilts, w, delay, dt) for w in windows}
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
    found = (find_windows(table, maze, ring.number, table.dt) for ring in maze.rings if not ring.is_disc)
    enough = [w for w in found if len(w.start) >= MIN_WINDOWS]
    if enough:
        _fit_balls(table, enough, USUAL_DELAY_S, table.dt, BallPrior()).check()


def _best_delay(
    table: Table, windows: list[WeakWindows], maze: Maze, dt: float, stage: StageModel, prior: BallPrior
) -> tuple[float, float]:
    """Delay of the camera and its standard error, s, with the ball fitted anew at each delay."""
    starts = np.concatenate([w.start for w in windows])
    blocks = np.concatenate([w.block for w in windows])
    usable = np.isin(starts, usable_starts(table, starts))

    def model_at(delay: float) -> PlanarModel | None:
        fit = _fit_balls(table, windows, delay, dt, prior)
        try:
            fit.check()
        except ValueError:  # far from the true delay
            return None
        return PlanarModel.build(maze, RigModel(StageModel(), fit.balls(maze)))

    return best_delay(table, starts[usable], blocks[usable], model_at, dt, -stage.dead_time)


def _score(table: Table, windows: list[WeakWindows], fit: _BallFit, delay: float, dt: float) -> dict[str, float]:
    """Residual of the weak form over the spread of its target, by ring."""
    out, tilts = {}, smooth_tilt(table)
    for w in windows:
        if len(w.start) >= MIN_WINDOWS:
            target, F = weak_rows(table, tilts, w, delay, dt)
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
    found = [find_windows(table, maze, ring.number, dt) for ring in maze.rings if not ring.is_disc]
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
    fit = _fit_balls(table, train, delay, dt, prior)
    fit.check()
    scores: dict[str, Any] = {
        f"weak_nrmse_{name}": _score(table, windows, fit, delay, dt)
        for name, windows in (("train", train), ("test", test))
    }
    model = RigModel(
        stage=stage,
        balls=fit.balls(maze),
        camera_delay=delay,
        camera_delay_stderr=delay_sigma,
        kind="pi",
        rate_hz=round(1.0 / dt, 3),
        data=tuple(dict(source) for source in sources),
        scores=scores,
    )
    return RigFit(model, (beta, gamma), {w.ring: len(w.start) for w in train})


def hardly_moving(table: Table, windows: int) -> ValueError:
    """The error for a table with so few windows."""
    seconds = len(table) * table.dt
    return ValueError(
        f"the ball is hardly ever seen moving freely in a ring: got {windows} windows of {window_of(table.dt)} samples "
        f"in {seconds:.3g} s, expected at least {FEWEST_WINDOWS} in one ring; "
        f"{'record for a minute' if seconds < LONG_S else 'tilt the plate more, until the ball rolls'}"
    )


def _part(windows: WeakWindows, table: Table, train: bool) -> WeakWindows:
    """Windows in the first part of their segment, or in the last."""
    segment = table.segment
    numbers, first, count = np.unique(segment, return_index=True, return_counts=True)
    at = np.searchsorted(numbers, segment[windows.start])
    place = (windows.start + (0 if not train else window_of(table.dt)) - first[at]) / count[at]
    keep = place <= 1.0 - TEST_SHARE if train else place > 1.0 - TEST_SHARE
    return WeakWindows(windows.ring, windows.radius, windows.start[keep], windows.block[keep])
