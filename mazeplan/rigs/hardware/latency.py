"""How late a rig is, from one swing of its plate.

    command to tilt    the plate follows as gain u through a lag of second order, `dead` later; fitted by output error
                       to the tilt that the board told (a model of the rig's own: nothing of the planner's is in it)
    tilt to pixels     the tilt that the pictures show (markers) is that of the board, `age` earlier: the shift with the
                       smallest squared difference

Commands are sums of sines that a servo follows without reaching its fastest speed: one at its limit would look late.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import cont2discrete, lfilter

from mazeplan.records import Array

GRID_S = 1e-3  # s, of the simulated answer
SWING_DEG = 1.5  # of each axis, at most
SWING_HZ = ((0.35, 0.9, 1.5), (0.5, 1.1, 1.7))  # of beta, gamma: neither a multiple of the other's
SHIFTS = (-0.05, 0.3)  # s, of ages that are tried
START = (1.0, 20.0, 0.9)  # gain, rad/s, damping, from which the fit starts
DEADS = (0.0, 0.03, 0.06, 0.1)  # s


@dataclass(frozen=True)
class Delay:
    """seconds, its standard error, and the rms of what is left over, rad."""

    seconds: float
    stderr: float
    rms: float


def swing(t: float, limit: float) -> tuple[float, float]:
    """Commands of the swing at time t, rad: from rest, at most SWING_DEG or the limit."""
    fade = min(1.0, t)
    beta, gamma = (
        fade * sum(math.sin(math.tau * f * t + k) - math.sin(k) * math.exp(-4.0 * t) for k, f in enumerate(axis)) / 3.0
        for axis in SWING_HZ
    )
    most = min(math.radians(SWING_DEG), limit)
    return most * beta, most * gamma


def dead_time(sent: Array, u: Array, told: Array, tilt: Array) -> Delay:
    """From commands to tilt. sent (M,) s, u (M, 2) rad; told (N,) s, tilt (N, 2) rad, by the same clock."""
    start = float(sent[0])
    grid = np.arange(start, float(told[-1]) + GRID_S, GRID_S)
    held = np.searchsorted(sent, grid, side="right") - 1
    use = told > start + 0.3
    times, y = told[use], tilt[use]

    def residual(p: Array) -> Array:
        dead = p[0]
        out = []
        for axis in (0, 1):
            gain, wn, zeta, offset = p[1 + 4 * axis : 5 + 4 * axis]
            out.append(np.interp(times - dead, grid, _answer(u[held, axis], wn, zeta)) * gain + offset - y[:, axis])
        return np.concatenate(out)

    low = [0.0, *2 * (0.3, 4.0, 0.2, -0.2)]
    high = [0.4, *2 * (3.0, 200.0, 4.0, 0.2)]
    fits = [least_squares(residual, [dead, *2 * (*START, 0.0)], bounds=(low, high), x_scale="jac") for dead in DEADS]
    best = min(fits, key=lambda fit: fit.cost)
    rms = math.sqrt(2.0 * best.cost / len(best.fun))
    covariance = np.linalg.pinv(best.jac.T @ best.jac) * rms**2
    return Delay(float(best.x[0]), math.sqrt(float(covariance[0, 0])), rms)


def _answer(u: Array, wn: float, zeta: float) -> Array:
    """Of a lag of second order to u held on the grid, from rest at u[0] = 0."""
    b, a, _ = cont2discrete(([wn * wn], [1.0, 2.0 * zeta * wn, wn * wn]), GRID_S)
    return lfilter(np.ravel(b), a, u)


def age(seen_at: Array, seen: Array, told: Array, tilt: Array) -> Delay:
    """Of the pictures. seen_at (M,) s and seen (M, 2) rad from the pictures; told (N,) s and tilt (N, 2) rad of the
    board."""
    inside = (seen_at - SHIFTS[1] > told[0]) & (seen_at - SHIFTS[0] < told[-1])
    seen_at, seen = seen_at[inside], seen[inside]

    def left(shift: float) -> tuple[float, Array]:
        total, slopes = 0.0, np.zeros(len(seen_at))
        for axis in (0, 1):
            y = np.interp(seen_at - shift, told, tilt[:, axis])
            x = np.column_stack([y, np.ones(len(y))])
            k, *_ = np.linalg.lstsq(x, seen[:, axis], rcond=None)
            residual = seen[:, axis] - x @ k
            # a marker that was read wrong must not decide
            total += float(np.sum(np.minimum(residual**2, (4.0 * np.median(np.abs(residual))) ** 2)))
            slopes += np.gradient(y * k[0], seen_at) ** 2
        return total, slopes

    coarse = np.arange(*SHIFTS, 5e-3)
    costs = np.array([left(float(shift))[0] for shift in coarse])
    middle = float(coarse[int(np.argmin(costs))])
    fine = np.arange(middle - 6e-3, middle + 6.5e-3, 1e-3)
    costs = np.array([left(float(shift))[0] for shift in fine])
    c2, c1, _ = np.polyfit(fine - middle, costs, 2)
    shift = middle - 0.5 * c1 / c2 if c2 > 0.0 else middle
    total, slopes = left(shift)
    rms = math.sqrt(total / max(2 * len(seen_at) - 5, 1))
    return Delay(float(shift), rms / math.sqrt(max(float(np.sum(slopes)), 1e-12)), rms)
