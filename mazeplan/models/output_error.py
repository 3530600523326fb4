"""Difference equations fitted through measurement noise: plain ARX, and from there by output error.

    w_k = sum_i a_i w_(k-i) + sum_j b_j u_(k-d-j),    y_k = w_k + sum_m c_m v_mk + level + noise,   i = 1..n, j = 1..n+1

Plain ARX is least squares with measured y_(k-i) in place of w_(k-i); their noise biases it. Output error minimises the
squared error of y as simulated from u alone (the prediction error when the noise is white). Given a, that is linear in
b, c and the level, which are eliminated (variable projection: G. Golub and V. Pereyra, Inverse Problems 19, 2003);
steps of a are Levenberg-Marquardt's. The simulation stands still at first, where the first rows were measured.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mazeplan.records import Array, IntArray

SETTLE_S = 0.5  # s at the beginning of a stretch that are left out: how it moved before is not known ...
SETTLE_TIMES = 3.5  # ... and as many time constants of the slowest pole (3 % left), up to a third of the stretch
ROUNDS = 40
STEADY = 1e-6
DAMPING = (1e-3, 1e4, 6.0)  # Levenberg-Marquardt, in units of the scaled gradient: first, last, and by what it changes
SLOWEST = 0.998  # size of the largest z-pole that is believed; 0.06 rad/s at 30 Hz
START_RATE = 10.0  # rad/s: about where the commands of a stage have their power


@dataclass(frozen=True)
class Stretch:
    """Uninterrupted rows: command u (N,), angle y (N,), what enters as it is (m, N), held out (N,), block (N,)."""

    u: Array
    y: Array
    extra: Array
    held_out: NDArray[np.bool_]
    block: IntArray


def z_poles(a: Array) -> tuple[complex, ...]:
    """Roots of z^n - a_1 z^(n-1) - ... - a_n, the largest first."""
    roots = np.roots(np.concatenate([[1.0], -np.asarray(a)])) if np.any(a) else np.zeros(len(a))
    return tuple(sorted((complex(z) for z in roots), key=lambda z: (-abs(z), -z.imag)))


def stable(a: Array) -> Array:
    """Coefficients whose poles are those of a, mirrored into the circle where they are outside."""
    poles = np.array(z_poles(a))
    size = np.abs(poles)
    size = np.maximum(size, 1e-12)
    inside = np.minimum(np.minimum(size, 1.0 / size), SLOWEST)
    return np.asarray(-np.real(np.poly(poles / size * inside))[1:], dtype=np.float64)


def settling(a: Array, dt: float) -> int:
    """Samples until a wrong start has died away."""
    slowest = max((abs(z) for z in z_poles(a)), default=0.0)
    return max(round(SETTLE_S / dt), math.ceil(SETTLE_TIMES / -math.log(max(slowest, 1e-9))))


def kept(s: Stretch, warm: int, held_out: bool = False) -> NDArray[np.bool_]:
    """Which rows (N,) of a stretch count: those of the fit, or those held out, once it has settled."""
    keep = s.held_out == held_out
    keep[: min(warm, len(keep) // 3)] = False
    return keep


def late(x: Array, lag: int) -> Array:
    """x (N,) some samples later; before its first row it stood still."""
    return np.concatenate([np.full(lag, x[0]), x[: len(x) - lag]])


def all_pole(a: Array, drive: Array, before: float) -> Array:
    """w (N,) with w_k = sum a_i w_(k-i) + drive_k, and w = before for k < 0."""
    from scipy.signal import lfilter, lfiltic  # here: a second to import, of which navigating needs nothing

    denominator = np.concatenate([[1.0], -a])
    state = lfiltic([1.0], denominator, np.full(len(a), before))
    return np.asarray(lfilter([1.0], denominator, drive, zi=state)[0])


def _from_rest(a: Array, drive: Array) -> Array:
    """`all_pole` from 0, also of several at once: drive (..., N)."""
    from scipy.signal import lfilter

    return np.asarray(lfilter([1.0], np.concatenate([[1.0], -a]), drive))


def regressors(s: Stretch, order: int, delay: int) -> Array:
    """Rows (N, p) of plain ARX; before the first row everything stood still."""
    columns = [late(s.y, i) for i in range(1, order + 1)] + [late(s.u, delay + j) for j in range(1, order + 2)]
    return np.stack([*columns, *s.extra, np.ones(len(s.y))], axis=1)


def least_squares_arx(stretches: list[Stretch], order: int, delay: int) -> Array:
    """Coefficients (a, b, c, constant) of plain ARX by least squares."""
    warm = order + delay + 1
    F = np.concatenate([regressors(s, order, delay)[kept(s, warm)] for s in stretches])
    target = np.concatenate([s.y[kept(s, warm)] for s in stretches])
    return np.asarray(np.linalg.lstsq(F, target, rcond=None)[0], dtype=np.float64)


def simulate(s: Stretch, x: Array, order: int, delay: int) -> Array:
    """y (N,) of the formula without noise, for x = (a, b, c, level)."""
    linear, standing = _columns(s, x[:order], order, delay)
    return linear @ x[order:] + standing


def motion(s: Stretch, x: Array, order: int, delay: int) -> Array:
    """w (N,) of the formula: without the level and what comes from v."""
    return simulate(s, x, order, delay) - x[2 * order + 1 : -1] @ s.extra - x[-1]


def loss(stretches: list[Stretch], x: Array, order: int, delay: int, warm: int) -> tuple[float, int]:
    """Mean squared error in rad^2 of the simulation on the rows of the fit, and how many there are."""
    errors = np.concatenate([(s.y - simulate(s, x, order, delay))[kept(s, warm)] for s in stretches])
    return float(np.mean(errors**2)), len(errors)


def refine(
    stretches: list[Stretch], order: int, delay: int, dt: float, lower: Array | None = None, steady: float = STEADY
) -> Array:
    """Coefficients (a, b, c, level) whose simulation has the smallest squared error.

    From plain ARX, which noise can bring far off, or from `lower`, a of the same or a lower order, or from a slow
    low-pass: from whichever is best. A step that lowers the squared error by less than `steady`, relatively, is the
    last."""
    slow = np.asarray(-np.poly(np.full(order, math.exp(-START_RATE * dt)))[1:], dtype=np.float64)
    starts = [least_squares_arx(stretches, order, delay)[:order], slow]
    if lower is not None:
        starts.append(np.concatenate([lower, np.zeros(order - len(lower))]))
    warm = round(SETTLE_S / dt)
    keep = [kept(s, warm) for s in stretches]
    ends = [_projected(stretches, stable(a), order, delay, keep) for a in starts]
    x = _descend(stretches, min(ends, key=lambda end: end[2]), order, delay, keep, steady)
    longer = settling(x[:order], dt)
    if longer > warm:
        keep = [kept(s, longer) for s in stretches]
        x = _descend(stretches, _projected(stretches, x[:order], order, delay, keep), order, delay, keep, steady)
    return x


def _descend(
    stretches: list[Stretch], start: tuple[Array, Array, float], order: int, delay: int,
    keep: list[NDArray[np.bool_]], steady: float,
) -> Array:  # fmt: skip
    """Levenberg-Marquardt from what `_projected` gave: (a, b, c, level)."""
    x, error, cost = start
    damping, last, factor = DAMPING
    for _ in range(ROUNDS):
        Q, R = np.linalg.qr(jacobian(stretches, x, order, delay, keep))
        scale = np.maximum(np.linalg.norm(R, axis=0), 1e-12)
        gradient = np.concatenate([Q.T @ error, np.zeros(len(x))])
        tried, gained = start, -1.0
        while gained <= 0.0 and damping < last:
            system = np.vstack([R / scale, math.sqrt(damping) * np.eye(len(x))])
            step = np.linalg.lstsq(system, gradient, rcond=None)[0] / scale
            moved = R @ step
            if float(moved @ (2.0 * gradient[: len(x)] - moved)) < steady * cost:
                return x  # even the linear prediction gains no more
            tried = _projected(stretches, stable(x[:order] + step[:order]), order, delay, keep)
            gained = cost - tried[2]
            damping = damping / factor if gained > 0.0 else damping * factor
        if gained <= 0.0:
            break
        x, error, cost = tried
        if gained < steady * cost:
            break
    return x


def _projected(
    stretches: list[Stretch], a: Array, order: int, delay: int, keep: list[NDArray[np.bool_]]
) -> tuple[Array, Array, float]:
    """The best (a, b, c, level) for this a, its errors on the rows kept, and the sum of their squares."""
    parts = [_columns(s, a, order, delay) for s in stretches]
    F = np.concatenate([linear[k] for (linear, _), k in zip(parts, keep, strict=True)])
    places = zip(stretches, parts, keep, strict=True)
    target = np.concatenate([(s.y - standing)[k] for s, (_, standing), k in places])
    Q, R = np.linalg.qr(F)
    linear = np.asarray(np.linalg.lstsq(R, Q.T @ target, rcond=None)[0], dtype=np.float64)
    error = target - F @ linear
    return np.concatenate([a, linear]), error, float(error @ error)


def _columns(s: Stretch, a: Array, order: int, delay: int) -> tuple[Array, Array]:
    """Derivatives (N, p - n) of the simulation by b, c and level, which it is linear in, given a; and what is left
    (N,) of having stood where the first three rows were measured."""
    drive = np.zeros((order + 2, len(s.u)))
    drive[0, :order] = np.cumsum(a[::-1])[::-1]  # as if w = 1 before the first row
    for j in range(1, order + 2):
        drive[j] = late(s.u, delay + j)
    filtered = _from_rest(a, drive)
    rest = filtered[0]
    rows = np.concatenate([filtered[1:], s.extra - s.extra[:, :1] * rest, [1.0 - rest]])
    return rows.T, float(np.mean(s.y[:3])) * rest


def jacobian(stretches: list[Stretch], x: Array, order: int, delay: int, keep: list[NDArray[np.bool_]]) -> Array:
    """Derivatives (K, p) of the simulation by (a, b, c, level) on the rows kept."""
    parts = []
    for s, k in zip(stretches, keep, strict=True):
        linear, standing = _columns(s, x[:order], order, delay)
        w = linear @ x[order:] + standing - x[2 * order + 1 : -1] @ s.extra - x[-1]
        before = float(np.mean(s.y[:3]) - x[2 * order + 1 : -1] @ s.extra[:, 0] - x[-1])
        w = np.concatenate([np.full(order, before), w])
        past = np.stack([w[order - i : len(w) - i] for i in range(1, order + 1)])
        poles = _from_rest(x[:order], past)
        parts.append(np.concatenate([poles.T, linear], axis=1)[k])
    return np.concatenate(parts)


def covariance_of(stretches: list[Stretch], x: Array, order: int, delay: int, dt: float) -> tuple[Array, float]:
    """Covariance (p, p) of refined coefficients, robust against errors that last (within blocks), and by how much it
    is on average larger than that of independent errors, at least 1."""
    keep = [kept(s, settling(x[:order], dt)) for s in stretches]
    Z = jacobian(stretches, x, order, delay, keep)
    block = np.concatenate([s.block[k] for s, k in zip(stretches, keep, strict=True)])
    error = np.concatenate([(s.y - simulate(s, x, order, delay))[k] for s, k in zip(stretches, keep, strict=True)])
    scale = np.linalg.norm(Z, axis=0)
    _, sizes, turn = np.linalg.svd(Z / scale, full_matrices=False)
    root = turn.T / np.maximum(sizes, 1e-12 * sizes[0]) / scale[:, None]  # root root' is the inverse of Z'Z
    variance = float(np.sum(error**2)) / max(len(error) - len(x), 1)
    scores = np.stack([(Z * error[:, None])[block == b].sum(axis=0) for b in np.unique(block)]) @ root
    middle = scores.T @ scores
    inflation = max(float(np.trace(middle)) / (variance * len(x)), 1.0) if variance > 0.0 else 1.0
    return inflation * variance * root @ root.T, inflation
