"""Weak form of the ball's equation over short windows of a record: no derivative of the data is needed.

Differentiating a noisy angle twice biases a fit. With a smooth phi(t) that vanishes with its derivatives at both ends
of a short window, integration by parts gives

    int phi'' theta dt - int phi kinematic dt
        = k int phi gravity dt + c_v int phi' theta dt - c_d int phi sign(theta_dot) dt
        + k beta_0 int phi d gravity/d beta dt + k gamma_0 int phi d gravity/d gamma dt

For a given tilt of the table (beta_0, gamma_0), this equation is linear in the unknowns of each ring: rolling factor k,
viscous friction c_v, dry friction c_d. The tilt of the plate is taken at t - delay. Windows with a missing sample or a
change of ring are left out. Windows with an impact have large residuals and therefore small weights (Huber).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mazeplan.core.logs.table import Table
from mazeplan.core.records import Array, IntArray
from mazeplan.learning.smoothing import smoothed
from mazeplan.maze.geometry import Maze, Ring
from mazeplan.physics.ball_model import RingKinematics, gravity_jacobian, gravity_part, kinematic_terms

WINDOW_S, WINDOWS = 0.4, (7, 13)  # s; fewest and most samples of a window, below 15 Hz and from 30 Hz on
HOP = 3  # samples between windows
BLOCK_S = 5.0  # s; windows within one block count as one observation for standard errors
NOISE = 2e-3  # m; the camera may see the ball this far in a wall
MOVING = 8e-3  # m/s; slower windows are left out: their friction has no sign
HUBER = 2.0  # standard deviations; larger residuals count less
FEWEST_WINDOWS = 8  # if no ring has more: the rigid ball is fitted to all rings afterwards
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


def find_windows(table: Table, maze: Maze) -> list[WeakWindows]:
    """Windows of each ring in which the ball is always seen, moves in one direction, and stays in the channel."""
    return [_windows_of(table, maze.ball.radius - NOISE, ring) for ring in maze.rings if not ring.is_disc]


def _windows_of(table: Table, reach: float, here: Ring) -> WeakWindows:
    r, theta, dt = table["r"], table["theta"], table.dt
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
    return WeakWindows(here.number, here.track_radius, starts, (starts * dt // BLOCK_S).astype(int))


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


def weak_rows(table: Table, tilts: dict[str, Array], windows: WeakWindows, delay: float) -> tuple[Array, Array]:
    """Targets (K,) and features (K, 5): gravity, viscous, dry, d gravity / d beta, d gravity / d gamma.

    tilts: see `smooth_tilt`"""
    dt = table.dt
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
        scale = 1.4826 * np.median(np.abs(residual)) + 1e-12
        weights = np.minimum(1.0, HUBER * scale / np.maximum(np.abs(residual), 1e-12))
        noise = max(float(np.sum(weights * residual**2) / max(np.sum(weights), 1.0)), 1e-12)
    residual = y - X @ w
    bread = np.linalg.inv(information)
    scores = X * (weights * residual)[:, None] / noise
    meat = sum(
        (np.outer(s, s) for s in (scores[block == b].sum(axis=0) for b in np.unique(block))), np.zeros_like(bread)
    )
    robust = np.diag(bread @ meat @ bread)
    return np.asarray(w, dtype=np.float64), np.where(robust > np.diag(bread), robust, np.diag(bread)), residual


def hardly_moving(table: Table, windows: int) -> ValueError:
    """The error for a table with so few windows."""
    seconds = len(table) * table.dt
    return ValueError(
        f"the ball is hardly ever seen moving freely in a ring: got {windows} windows of {window_of(table.dt)} samples "
        f"in {seconds:.3g} s, expected at least {FEWEST_WINDOWS} in one ring; "
        f"{'record for a minute' if seconds < LONG_S else 'tilt the plate more, until the ball rolls'}"
    )
