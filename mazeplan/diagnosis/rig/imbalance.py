"""An unbalanced ball: a force that turns with the ball.

If the mass of the ball is off its middle by e, gravity accelerates the ball towards its heavy side. On the floor, with
the unit vector d to the heavy side and the inertia k m R^2:

    a = A (d_x, d_y),    A = g e / (R (1 + k)),    d' = s x d,    s = (-v_y, v_x, w) / R

Nobody knows d: the record does not show it, and a slip of the ball changes it. So a second filter follows b = A d in
the innovations of the first filter. These are the error of the first filter along the ring, plus white noise:

    nu = e_1 + noise,    e <- F (I - K H) e + G a,    b <- rho R(s dt) b + noise of variance (1 - rho^2) A^2 / 3

with F, G of a point mass and the gain K of the first filter. The size A and the time constant of rho = exp(-dt / tau)
are those of the highest likelihood. A force that does not turn with the ball, or turns at another rate, has to explain
much less. A ball at rest is held by its friction, and feels nothing. A ball along a wall accelerates by
(1 + k) / (1 + 2 k) times as much.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import product
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.optimize import minimize

from mazeplan.control.estimation.rigid_body_filter import BodyFilter, BodyModel
from mazeplan.control.estimation.rigid_body_fit import BodyFit
from mazeplan.core.records import Array
from mazeplan.diagnosis.document import Entry, effect_entry
from mazeplan.physics.effects.ball import ball_imbalance

SLOW = 0.02  # m/s; friction holds a slower ball
NEEDED = 75.0  # minimum gain of -2 log L; without an imbalance, the gain is 0 nearly always
CLEARLY = 1.5  # minimum gain over the gain of a force that turns at a wrong rate
LEAST_COHERENCE = 2.0  # s; a force that forgets its direction sooner is something else
WRONG_RATES = (0.0, 0.5, 1.6)  # times the rate at which the ball turns
SIZES, COHERENCES, BRIEF = (0.02, 0.05, 0.12), (2.0, 10.0), 0.3  # m/s^2 and s, at which a search starts
MODEL_ERROR = 0.1  # of the size: how long the ball lies at walls is not known
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # of an imbalance, tried in an earlier record
STEP = 0.15  # of the logarithm of the size, for the curvature of the likelihood
SURE = 3.5  # minimum growth of a known imbalance, in standard errors
ANY_ANGLE = math.pi / math.sqrt(3.0)  # rad; standard error of an angle of which nothing is known
FARTHEST = 0.05  # m; the ball does not move so far from one picture to the next


class Imbalance(NamedTuple):
    """An unbalanced ball."""

    size: float  # A, m/s^2
    stderr: float  # of A, m/s^2
    coherence: float  # tau, s
    gain: float  # of -2 log L


BALANCED = Imbalance(0.0, 0.0, 0.0, 0.0)


class _Along(NamedTuple):
    """What the second filter needs, of each picture."""

    nu: Array  # innovation along the ring; NaN where nothing counts
    S: Array  # its variance; 1 where nothing counts
    to_place: Array  # gains of the first filter
    to_speed: Array
    tx: Array  # direction along the ring; 0 where friction holds the ball
    ty: Array
    turn: Array  # rotation of the ball until the next picture (N, 3), rad
    begins: np.ndarray  # whether a stretch begins


def unbalanced(body: BodyFilter, fit: BodyFit) -> Imbalance:
    """The imbalance that the innovations of a fit show; `BALANCED` without one."""
    along, dt = _along(body, fit), body.pictures.dt
    ways = [along, along._replace(turn=along.turn * (1.0, 1.0, 0.0))]  # the spin about the vertical may be wrong
    none = _minus2(along, dt, 1e-9, 1.0)
    starts = [(none - _minus2(way, dt, *at), way, at) for way in ways for at in product(SIZES, COHERENCES)]
    gain, way, at = max(starts, key=lambda start: start[0])
    if gain < 0.5 * NEEDED:
        return BALANCED
    found = minimize(
        lambda x: _minus2(way, dt, *np.exp(x)), np.log(at), method="Nelder-Mead",
        options={"xatol": 0.02, "fatol": 0.5, "maxiter": 80},
    )  # fmt: skip
    size, coherence = np.exp(found.x)
    gain = none - float(found.fun)
    wrong = max(
        none - _minus2(other._replace(turn=rate * other.turn), dt, *at)
        for other, rate, at in product(ways, WRONG_RATES, product(SIZES, (BRIEF, *COHERENCES)))
    )
    if gain < max(NEEDED, CLEARLY * wrong) or coherence < LEAST_COHERENCE:
        return BALANCED
    ends = [_minus2(way, dt, size * math.exp(step), coherence) for step in (-STEP, STEP)]
    curvature = max(sum(ends) - 2.0 * float(found.fun), 1e-9) / STEP**2
    share = math.hypot(math.sqrt(2.0 / curvature), MODEL_ERROR)
    k = fit.value("inertia")
    size *= (1.0 + 2.0 * k) / (1.0 + k)
    return Imbalance(float(size), float(share * size), float(coherence), gain)


def also_in(body: BodyFilter, model: BodyModel, imbalance: Imbalance) -> bool:
    """Whether an imbalance may have been there in an earlier record, although that does not show it surely: no smaller
    one is likelier there beyond doubt.

    model: the ball of the earlier record"""
    fit = BodyFit(model, {}, (), np.empty((0, 0)), 0.0, body.run(model))
    along, dt, k = _along(body, fit), body.pictures.dt, fit.value("inertia")
    size = max(imbalance.size - imbalance.stderr, 0.0) * (1.0 + k) / (1.0 + 2.0 * k)
    ways = (along, along._replace(turn=along.turn * (1.0, 1.0, 0.0)))
    *smaller, whole = (
        min(_minus2(way, dt, max(share * size, 1e-9), imbalance.coherence) for way in ways) for share in SHARES
    )
    return whole - min(smaller) < SURE**2


def imbalance_entry(now: Imbalance, was: Imbalance, radii: Mapping[int, float]) -> Entry | None:
    """The imbalance as an entry of the document; None if it is not surely larger than before.

    The record does not show the phase: its standard error is that of any angle.
    radii: track radii by ring, m; the ring with most pictures is first"""
    if not radii:
        return None
    ring, radius = next(iter(radii.items()))
    least = ball_imbalance.parameters["amplitude"].smallest
    if now.size - was.size <= max(least * radius, SURE * math.hypot(now.stderr, was.stderr)):
        return None
    before, after = ({number: {"amplitude": size / at, "phase": 0.0} for number, at in radii.items()}
                     for size in (was.size, now.size))  # fmt: skip
    rings = {str(number): {"after": after[number], "before": before[number]} for number in radii}
    stderr = {"amplitude": now.stderr / radius, "phase": ANY_ANGLE}
    return effect_entry(ball_imbalance, after[ring], stderr, before[ring], rings=rings)


def _along(body: BodyFilter, fit: BodyFit) -> _Along:
    """Innovations and gains of a fit along the rings, and the rotation of the ball."""
    seen, dt, radius = fit.filtered, body.pictures.dt, body.walls.radius
    x, y, vx, vy, w = np.nan_to_num(seen.state).T
    r = np.maximum(np.hypot(x, y), 1e-3)
    tx, ty = -y / r, x / r
    gain = np.nan_to_num(seen.cov[:, :4, :2]) / fit.value("noise") ** 2
    t = np.column_stack([tx, ty])
    there, then = (np.einsum("ni,nij,nj->n", t, gain[:, rows], t) for rows in (slice(0, 2), slice(2, 4)))
    nu = tx * seen.nu[:, 0] + ty * seen.nu[:, 1]
    S = tx * tx * seen.S[:, 0] + ty * ty * seen.S[:, 1] + 2.0 * tx * ty * seen.S[:, 2]
    # from place to place: errors of speeds would add up
    dx, dy, spin = np.diff(x, append=x[-1]), np.diff(y, append=y[-1]), 0.5 * dt * (w + np.append(w[1:], w[-1]))
    turn = np.column_stack([-dy, dx, spin]) / radius
    turn[np.hypot(dx, dy) > FARTHEST] = 0.0
    moves = np.hypot(vx, vy) >= SLOW
    return _Along(
        nu, np.where(np.isfinite(nu), S, 1.0), there, then, tx * moves, ty * moves, turn,
        np.ascontiguousarray(body.pictures.begins),
    )  # fmt: skip


def _minus2(along: _Along, dt: float, size: float, coherence: float) -> float:
    """-2 log L of the innovations for an imbalance, with the scale of their variances eliminated."""
    squares, logs, count = _follow(along, dt, size, coherence)
    return count * math.log(squares / count) + logs if count and squares > 0.0 else 0.0


@njit(cache=True)
def _turn(F, turn, rho):
    """Write rho times the rotation matrix of a rotation vector into the last three rows and columns of F (5, 5)."""
    x, y, z = turn[0], turn[1], turn[2]
    angle = math.sqrt(x * x + y * y + z * z)
    s = rho * math.sin(angle) / angle if angle > 1e-9 else rho
    c = rho * (1.0 - math.cos(angle)) / (angle * angle) if angle > 1e-9 else 0.5 * rho
    F[2, 2], F[2, 3], F[2, 4] = rho - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y
    F[3, 2], F[3, 3], F[3, 4] = c * x * y + s * z, rho - c * (x * x + z * z), c * y * z - s * x
    F[4, 2], F[4, 3], F[4, 4] = c * x * z - s * y, c * y * z + s * x, rho - c * (x * x + y * y)


@njit(cache=True)
def _predict(F, mean, cov, spread):
    """One step of a Kalman filter: mean <- F mean, cov <- F cov F', with the noise `spread` of b."""
    after, half = np.zeros(5), np.zeros((5, 5))
    for i in range(5):
        for m in range(5):
            after[i] += F[i, m] * mean[m]
            for j in range(5):
                half[i, j] += F[i, m] * cov[m, j]
    for i in range(5):
        mean[i] = after[i]
        for j in range(5):
            cov[i, j] = spread if i == j and i > 1 else 0.0
            for m in range(5):
                cov[i, j] += half[i, m] * F[j, m]


@njit(cache=True)
def _follow(along, dt, size, coherence):
    """The second filter. State: error of the first filter along the ring, m and m/s, and b (3,), m/s^2.

    Returns the sum of squares of its whitened innovations, the sum of log variances over S, and their number."""
    mean, cov, F, pull = np.zeros(5), np.zeros((5, 5)), np.zeros((5, 5)), np.zeros(5)
    rho, spread = math.exp(-dt / coherence), size * size / 3.0
    squares, logs, count = 0.0, 0.0, 0
    F[0, 1], F[1, 1] = dt, 1.0
    for n in range(len(along.nu)):
        if along.begins[n] or n == 0:
            for i in range(5):
                mean[i] = 0.0
                for j in range(5):
                    cov[i, j] = spread if i == j and i > 1 else 0.0
        K, L = 0.0, 0.0
        if math.isfinite(along.nu[n]):
            K, L = along.to_place[n], along.to_speed[n]
            variance, left = cov[0, 0] + along.S[n], along.nu[n] - mean[0]
            squares += left * left / variance
            logs += math.log(variance / along.S[n])
            count += 1
            for i in range(5):
                pull[i] = cov[i, 0] / variance
                mean[i] += pull[i] * left
            for i in range(5):
                for j in range(5):
                    cov[i, j] -= variance * pull[i] * pull[j]
        F[0, 0], F[1, 0] = 1.0 - K - dt * L, -L
        F[1, 2], F[1, 3] = dt * along.tx[n], dt * along.ty[n]
        F[0, 2], F[0, 3] = 0.5 * dt * F[1, 2], 0.5 * dt * F[1, 3]
        _turn(F, along.turn[n], rho)
        _predict(F, mean, cov, (1.0 - rho * rho) * spread)
    return squares, logs, count
