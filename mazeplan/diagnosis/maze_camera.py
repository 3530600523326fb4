"""The camera and the whole maze: offset, scale and lens distortion from the places where the ball can be.

The centre of the ball never leaves the channels. In a channel, the ball lies against the inner wall, against the outer
wall, or between them. So its true distance r from the centre of the maze has the density

    p(r) = sum over rings of a_in N(r; r_in, s^2) + a_out N(r; r_out, s^2) + a_between U(r; r_in, r_out) * N(s^2)

with r_in and r_out the limits of the ball's centre: each wall is one ball radius away. A camera that is off shifts,
stretches and bends this picture. The fit finds the most likely camera for all rings at once, before any sample is
assigned to a ring. Expectation maximisation gives the shares a and the noise s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.special import erf

from mazeplan.core.logs.table import Table
from mazeplan.core.records import Array, IntArray
from mazeplan.diagnosis.effect_entry import Entry, effect_entry
from mazeplan.maze.geometry import Maze
from mazeplan.physics.effect import Effect
from mazeplan.physics.effects import rig
from mazeplan.physics.rig.sensors import Camera

FEWEST = 2000  # samples of the ball
EVERY = 2  # samples from one used sample to the next: neighbours say nearly the same
NOISE = 5e-4  # m, start value of the noise
ROUNDS = 3  # rounds of two fits in turn: shares and noise, then the camera
OUTLIER_SHARE = 0.02  # share of samples that are in no channel: in an opening, or not the ball at all
SEARCH_STEP = {"offset_x": 1e-3, "offset_y": 1e-3, "scale": 1e-2, "distortion": 1.0}  # steps of the search
GRID, SPARSE = (-5.0, -3.0, -1.5, 0.0, 1.5, 3.0, 5.0), 4  # start values, in steps; every fourth sample judges them
TRIED = 3  # points of the grid at which a search starts
LEAST = 0.05  # minimum share of samples in a ring, and at each of its walls
# minimum gain of log likelihood a sample, for a camera with more numbers or far from the known one
MIN_GAIN_PER_SAMPLE = 0.05
BLOCK_S, SURE = 2.0, 5.0  # s, block of correlated samples; minimum change, in standard errors
SHIFT = ("offset_x", "offset_y")
EFFECTS = (rig.camera_offset, rig.camera_scale, rig.lens_distortion)


@dataclass(frozen=True)
class CameraFit:
    """The fitted camera.

    stderr: standard errors by the names of the camera's fields
    noise: m
    samples: number of samples used
    log_likelihood: of all these samples
    touched: whether the ball was at both walls of at least two rings"""

    camera: Camera
    stderr: dict[str, float]
    noise: float
    samples: int
    log_likelihood: float
    touched: bool


class _Channels:
    """Densities of the ball's distance r from the centre, in the channels of a maze, and their shares."""

    def __init__(self, maze: Maze) -> None:
        ball = maze.ball.radius
        self.low = np.array([ring.inner_radius + ball if not ring.is_disc else 0.0 for ring in maze.rings])
        self.high = np.array([ring.outer_radius - ball for ring in maze.rings])
        self.farthest = maze.rings[0].outer_radius
        self.shares = np.full((3, len(self.low)), (1.0 - OUTLIER_SHARE) / (3 * len(self.low)))
        self.noise = NOISE

    def densities(self, r: Array) -> Array:
        """Densities (3, R, N) at r (N,) in R rings, 1/m: at the inner wall, between the walls, at the outer wall."""
        s, d = self.noise, r[None, :]
        inner = np.exp(-0.5 * ((d - self.low[:, None]) / s) ** 2) / (s * math.sqrt(2.0 * math.pi))
        outer = np.exp(-0.5 * ((d - self.high[:, None]) / s) ** 2) / (s * math.sqrt(2.0 * math.pi))
        edges = [erf((d - limit[:, None]) / (s * math.sqrt(2.0))) for limit in (self.low, self.high)]
        between = 0.5 * (edges[0] - edges[1]) / (self.high - self.low)[:, None]
        return np.stack([inner, between, outer])

    def touched(self) -> bool:
        """Whether the ball was at both walls of at least two rings.

        Otherwise a camera that is off looks like a ball that keeps to one side."""
        share = self.shares / np.maximum(self.shares.sum(axis=0), 1e-300)
        enough = self.shares.sum(axis=0) > LEAST
        return int(np.sum(enough & (share[0] > LEAST) & (share[2] > LEAST))) >= 2

    def log_density(self, r: Array) -> Array:
        """Log density (N,) at r (N,), all channels together."""
        return np.log(np.einsum("kr,krn->n", self.shares, self.densities(r)) + OUTLIER_SHARE / self.farthest)

    def em_step(self, r: Array) -> None:
        """One round of expectation maximisation of shares and noise."""
        each = self.shares[:, :, None] * self.densities(r)
        each /= each.sum(axis=(0, 1)) + OUTLIER_SHARE / self.farthest
        self.shares = (1.0 - OUTLIER_SHARE) * each.sum(axis=2) / max(float(each.sum()), 1e-300)
        gaps = np.stack([r[None, :] - self.low[:, None], r[None, :] - self.high[:, None]])
        weight = each[[0, 2]]
        found = math.sqrt(float((weight * gaps**2).sum() / max(float(weight.sum()), 1e-300)))
        self.noise = min(max(found, 0.2 * NOISE), 6.0 * NOISE)


def fit_camera(table: Table, maze: Maze, start: Camera, free: Sequence[str] = tuple(SEARCH_STEP)) -> CameraFit | None:
    """The camera that fits all positions of a record.

    start: camera of the model, at which the search starts
    free: names of the numbers to fit

    None for a record with few positions, or with nominal radii that were not measured."""
    if "x" not in table:
        return None
    x, y = table["x"][::EVERY], table["y"][::EVERY]
    seen = np.isfinite(x) & np.isfinite(y)
    x, y, block = x[seen], y[seen], (np.flatnonzero(seen) * EVERY * table.dt // BLOCK_S).astype(np.int64)
    if len(x) < FEWEST // EVERY or np.std(np.hypot(x, y)) < NOISE:
        return None

    def radii(v: Array) -> Array:
        return np.hypot(*_true(_moved(start, free, v), x, y))

    starts = _starts(maze, free, lambda v: radii(v)[::SPARSE])
    near, *far = (_searched(maze, radii, start) for start in starts)
    best = max(far, key=lambda one: one[0], default=near)
    value, v, channels = best if best[0] > near[0] + MIN_GAIN_PER_SAMPLE * len(x) else near
    errors, touched = _errors(channels, radii, v, free, block), channels.touched()
    return CameraFit(_moved(start, free, v), errors, channels.noise, len(x), value, touched)


def _searched(maze: Maze, radii: Any, v: Array) -> tuple[float, Array, _Channels]:
    """Log likelihood, steps and channels of the maximum near a start."""
    channels, value, simplex = _Channels(maze), -math.inf, np.vstack([np.zeros(len(v)), np.eye(len(v))])
    for number in range(ROUNDS):
        for _ in range(20 if number == 0 else 8):
            channels.em_step(radii(v))
        found: Any = minimize(
            lambda v: -float(channels.log_density(radii(v)).sum()),
            v,
            method="Nelder-Mead",
            options={"xatol": 1e-3, "fatol": 1e-2, "initial_simplex": v + simplex},
        )
        v, value = found.x, -float(found.fun)
    return value, v, channels


def _starts(maze: Maze, free: Sequence[str], radii: Any) -> list[Array]:
    """Start points of searches: the known camera, and the best points of a grid over scale and lens.

    The grid is needed because the likelihood has further maxima."""
    axes = [GRID if name in ("scale", "distortion") else (0.0,) for name in free]
    tried = []
    for point in product(*axes):
        channels, v = _Channels(maze), np.array(point)
        r = radii(v)
        for _ in range(10):
            channels.em_step(r)
        tried.append((float(channels.log_density(r).sum()), v))
    best = sorted(tried, key=lambda one: -one[0])[: TRIED if len(tried) > 1 else 0]
    return [np.zeros(len(free)), *(v for _, v in best if v.any())]


def _moved(start: Camera, free: Sequence[str], v: Array) -> Camera:
    return replace(start, **{name: _at(start, name, v[i]) for i, name in enumerate(free)})


def _at(camera: Camera, name: str, steps: float) -> float:
    """A number of the camera, moved by some steps, within its bounds."""
    low, high = {"offset_x": (-0.05, 0.05), "offset_y": (-0.05, 0.05), "scale": (0.5, 2.0)}.get(name, (-30.0, 30.0))
    return min(max(getattr(camera, name) + steps * SEARCH_STEP[name], low), high)


def _true(camera: Camera, x: Array, y: Array) -> tuple[Array, Array]:
    """`Camera.true` for arrays."""
    true: Any = camera.true(x, y)  # pyright: ignore[reportArgumentType]
    return true


def _errors(channels: _Channels, radii: Any, v: Array, free: Sequence[str], block: IntArray) -> dict[str, float]:
    """Standard errors that hold for correlated neighbours: they sum the scores over blocks."""
    step = 0.02
    up, down = ([channels.log_density(radii(v + sign * step * e)) for e in np.eye(len(v))] for sign in (1.0, -1.0))
    scores = (np.array(up) - np.array(down)).T / (2.0 * step)
    names, at = np.unique(block, return_inverse=True)
    sums = np.stack([np.bincount(at, weights=column, minlength=len(names)) for column in scores.T], axis=1)
    inverse = np.linalg.pinv(scores.T @ scores)
    covariance = inverse @ (sums.T @ sums) @ inverse
    return {name: SEARCH_STEP[name] * math.sqrt(max(covariance[i, i], 0.0)) for i, name in enumerate(free)}


def camera_effects(table: Table, maze: Maze, camera: Camera) -> tuple[list[Entry] | None, Camera]:
    """Effects of a camera that differs from the model's, and the true camera. No effects (None) if the record cannot
    show the camera.

    Scale and lens are named only if they differ significantly. If one of them is enough, the one that explains more is
    named."""
    both = fit_camera(table, maze, camera)
    if both is None:
        return None, camera
    sets = [SHIFT, (*SHIFT, "scale"), (*SHIFT, "distortion")]
    shift, scale, lens = (fit_camera(table, maze, camera, free) for free in sets)
    if shift is None or scale is None or lens is None:
        return None, camera
    one = max(scale, lens, key=lambda p: p.log_likelihood)
    if both.log_likelihood > one.log_likelihood + MIN_GAIN_PER_SAMPLE * both.samples:
        fitted = both
    elif _sure(one, camera, rig.camera_scale if one is scale else rig.lens_distortion):
        fitted = one
    else:
        fitted = shift
    if not fitted.touched:
        return None, camera
    found = [effect for effect in EFFECTS if _sure(fitted, camera, effect)]
    entries = [_entry(effect, fitted, camera) for effect in found]
    names = {place.removeprefix("camera.") for effect in found for place in effect.entry.values()}
    return entries, replace(camera, **{name: getattr(fitted.camera, name) for name in names})


def _sure(fitted: CameraFit, camera: Camera, effect: Effect) -> bool:
    """Whether a number of the effect differs significantly, and by more than its smallest size."""
    for name, p in effect.parameters.items():
        key = effect.entry[name].removeprefix("camera.")
        change = abs(getattr(fitted.camera, key) - getattr(camera, key))
        if p.smallest and key in fitted.stderr and change > max(p.smallest, SURE * fitted.stderr[key]):
            return True
    return False


def _entry(effect: Effect, fitted: CameraFit, camera: Camera) -> Entry:
    keys = {name: place.removeprefix("camera.") for name, place in effect.entry.items()}
    values, before = ({name: getattr(c, key) for name, key in keys.items()} for c in (fitted.camera, camera))
    return effect_entry(effect, values, {name: fitted.stderr.get(key, 0.0) for name, key in keys.items()}, before)
