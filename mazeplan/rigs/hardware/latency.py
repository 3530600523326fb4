"""Measures the delays of a rig from one swing of its plate.

    command to tilt    The plate follows gain times u through a second-order lag, after a dead time and, on average,
                       half a period of the servo pulses. An output-error fit finds these parameters from the tilt in
                       the board's reports. This model serves the measurement alone; it is not the planner's model.
    tilt to pixels     The tilt in the pictures (by markers) equals the board's tilt `picture_delay` seconds earlier.
                       The delay is the shift with the smallest squared difference.

The command of each axis is a sine plus small steps; the two axes step at different times. The steps separate a dead
time from a slow servo. They are small, because a servo at its top speed would look late.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import cont2discrete, lfilter

from mazeplan.core.records import Array

GRID_S = 1e-3  # s, time step of the simulated response
SWING_DEG, STEP_DEG = 1.0, 0.6  # amplitude of the sine; height of a step, up or down
SWING_HZ = (0.45, 0.7)  # frequency of the sine for beta, gamma
DWELL_S = (0.2, 0.2667)  # s between steps, for beta, gamma
STEPS = np.random.default_rng(3).choice([-1.0, 1.0], (2, 1000))
PULSE_S = 0.02  # s between servo pulses
SHIFTS = (-0.05, 0.3)  # s, range in which the age is searched
FAR = 6.0  # a residual of more than this many times the median is due to a wrong marker
START = (1.0, 20.0, 0.9)  # initial guess of the fit: gain, natural frequency in rad/s, damping
DEADS = (0.0, 0.03, 0.06, 0.1)  # s, initial guesses of the dead time; the best fit counts


@dataclass(frozen=True)
class MeasuredDelay:
    """A measured delay.

    seconds: the delay, s.
    stderr: its standard error, s.
    rms: rms residual of the fit, rad."""

    seconds: float
    stderr: float
    rms: float


def swing(t: float, limit: float) -> tuple[float, float]:
    """Commands (beta, gamma) of the swing at time t, rad. They start from 0 and stay within the limit."""
    fade, most = min(1.0, t), min(1.0, math.degrees(limit) / (SWING_DEG + STEP_DEG))
    beta, gamma = (
        SWING_DEG * math.sin(math.tau * f * t) + STEP_DEG * float(STEPS[axis, int(t / dwell) % STEPS.shape[1]])
        for axis, (f, dwell) in enumerate(zip(SWING_HZ, DWELL_S, strict=True))
    )
    return math.radians(fade * most * beta), math.radians(fade * most * gamma)


def dead_time(sent: Array, u: Array, measured: Array, tilt: Array) -> MeasuredDelay:
    """Delay from commands to tilt. Both times are by the same clock.

    sent (M,): times of the commands, s.
    u (M, 2): commands, rad.
    measured (N,): times of the board's reports, s.
    tilt (N, 2): tilt in the reports, rad."""
    start = float(sent[0])
    grid = np.arange(start, float(measured[-1]) + GRID_S, GRID_S)
    held = np.searchsorted(sent, grid, side="right") - 1
    late = max(1, round(PULSE_S / GRID_S))
    smooth = np.asarray(lfilter(np.full(late, 1.0 / late), 1.0, u[held], axis=0))
    use = measured > start + 0.3
    times, y = measured[use], tilt[use]

    def residual(p: Array) -> Array:
        dead = p[0]
        out = []
        for axis in (0, 1):
            gain, wn, zeta, offset = p[1 + 4 * axis : 5 + 4 * axis]
            out.append(
                np.interp(times - dead, grid, _second_order_response(smooth[:, axis], wn, zeta)) * gain
                + offset
                - y[:, axis]
            )
        return np.concatenate(out)

    low = [0.0, *2 * (0.3, 4.0, 0.2, -0.2)]
    high = [0.4, *2 * (3.0, 200.0, 4.0, 0.2)]
    fits = [least_squares(residual, [dead, *2 * (*START, 0.0)], bounds=(low, high), x_scale="jac") for dead in DEADS]
    best = min(fits, key=lambda fit: fit.cost)
    rms = math.sqrt(2.0 * best.cost / len(best.fun))
    covariance = np.linalg.pinv(best.jac.T @ best.jac) * rms**2
    return MeasuredDelay(float(best.x[0]) + 0.5 * PULSE_S, math.sqrt(float(covariance[0, 0])), rms)


def _second_order_response(u: Array, wn: float, zeta: float) -> Array:
    """Response of a second-order lag to u, which is constant within each step of the grid. It starts at rest, at 0."""
    discrete: Any = cont2discrete(([wn * wn], [1.0, 2.0 * zeta * wn, wn * wn]), GRID_S)
    return np.asarray(lfilter(np.ravel(discrete[0]), discrete[1], u))


def picture_delay(seen_at: Array, seen: Array, measured: Array, tilt: Array) -> MeasuredDelay:
    """Age of the pictures. Both times are by the same clock.

    seen_at (M,): times of the pictures, s.
    seen (M, 2): tilt in the pictures, rad.
    measured (N,): times of the board's reports, s.
    tilt (N, 2): tilt in the reports, rad."""
    inside = (seen_at - SHIFTS[1] > measured[0]) & (seen_at - SHIFTS[0] < measured[-1])
    seen_at, seen = seen_at[inside], seen[inside]

    def left(shift: float) -> tuple[float, Array]:
        total, slopes = 0.0, np.zeros(len(seen_at))
        for axis in (0, 1):
            y = np.interp(seen_at - shift, measured, tilt[:, axis])
            residual, gain = _line(y, seen[:, axis])
            most = FAR * float(np.median(np.abs(residual)))
            total += float(np.sum(np.minimum(residual**2, most**2)))
            slopes += np.gradient(y * gain, seen_at) ** 2
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
    return MeasuredDelay(float(shift), rms / math.sqrt(max(float(np.sum(slopes)), 1e-12)), rms)


def _line(x: Array, y: Array) -> tuple[Array, float]:
    """Residuals and slope of a straight line fitted to (x, y); the fit leaves out wrong markers."""
    columns, good = np.column_stack([x, np.ones(len(x))]), np.ones(len(x), dtype=bool)
    residual, slope = y, 1.0
    for _ in range(3):
        k, *_ = np.linalg.lstsq(columns[good], y[good], rcond=None)
        residual, slope = y - columns @ k, float(k[0])
        good = np.abs(residual) <= max(FAR * float(np.median(np.abs(residual))), 1e-9)
    return residual, slope
