"""Gravity, angular velocity and angular acceleration of the moving plate, in its own frame.

The plate has the rotation Ry(beta) Rx(gamma) on a table with the tilt (b, c). With B = beta + b, C = gamma + c:

    gravity   = g (sin B, -cos B sin C, -cos B cos C)
    Omega     = (C', B' cos C, -B' sin C)
    Omega'    = (C'', B'' cos C - B' C' sin C, -B'' sin C - B' C' cos C)

(from R^T (0, 0, -g) and R^T R'). Each sub-step has one row of numbers, for its middle.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from mazeplan.core.constants import GRAVITY
from mazeplan.core.maths.compiled import CALLEE, KERNEL
from mazeplan.core.records import Array

# columns of a row, and its length ROW. A row begins with the inputs of formulas in their order (`symbols.PLATE`);
# it ends with gravity on a level table, along x and y
RADIUS_AT, BALL_AT, FELT_AT, TIME_AT, STATED_AT, ROW = 6, 7, 8, 17, 18, 20
SOONEST = 1e-9  # s, minimum interval between two times


class PlateMotion(NamedTuple):
    """Motion of the plate on an even time grid."""

    start: float  # time of the first row, s
    step: float  # s
    motion: Array  # (M, 6) beta, its rate and acceleration, then the same for gamma: rad, rad/s, rad/s^2


class Tilting(NamedTuple):
    """How the true tilt follows from the stated tilt (beta, gamma), such as that of a `PlateMotion`.

    True beta = gain_beta beta + cross_beta gamma + tilt_beta; gamma likewise. tilt_beta, tilt_gamma: tilt of the table,
    rad."""

    gain_beta: float = 1.0
    gain_gamma: float = 1.0
    cross_beta: float = 0.0
    cross_gamma: float = 0.0
    tilt_beta: float = 0.0
    tilt_gamma: float = 0.0


@njit(**CALLEE)
def motion_at(motion, start, step, t, out):
    """Interpolate motion (M, 6) at the time t into out[:6]: accelerations linearly, the rest by cubic Hermite splines.

    Beyond the ends, the first or last row is held."""
    place = min(max((t - start) / step, 0.0), len(motion) - 1.000001)
    i = int(place)
    _between(motion, i, place - i, step, out)


@njit(**CALLEE)
def _between(motion, i, s, step, out):
    """As `motion_at`, for a time s steps (0 to 1) after row i."""
    s2, r2 = s * s, (1.0 - s) * (1.0 - s)
    a0, a1 = (1.0 + 2.0 * s) * r2, s2 * (3.0 - 2.0 * s)
    b0, b1 = s * r2 * step, s2 * (s - 1.0) * step
    for axis in range(0, 6, 3):
        for c in range(axis, axis + 2):  # a value; the next column is its slope
            here, next_ = motion[i, c], motion[i + 1, c]
            out[c] = a0 * here + a1 * next_ + b0 * motion[i, c + 1] + b1 * motion[i + 1, c + 1]
        out[axis + 2] = motion[i, axis + 2] + s * (motion[i + 1, axis + 2] - motion[i, axis + 2])


@njit(**KERNEL)
def plate_rows(plate, tilting, times, h, per, out):
    """Write rows for the `per` sub-steps of h s that follow each of the times (N,), s, into out (N per, ROW).

    A row holds the values in the middle of its sub-step."""
    raw = np.empty(6)
    for k in range(len(times)):
        for j in range(per):
            t = times[k] + (j + 0.5) * h
            motion_at(plate.motion, plate.start, plate.step, t, raw)
            _fill(tilting, raw, t, out[k * per + j])


@njit(**KERNEL)
def history_rows(times, motion, tilting, start, h, out):
    """Write rows for the middles of M sub-steps of h s from `start` on into out (M, ROW).

    motion (N, 6): as in `PlateMotion`, at any increasing times (N,), N > 1; held beyond the ends."""
    raw, i = np.empty(6), 0
    for k in range(len(out)):
        t = start + (k + 0.5) * h
        while i + 2 < len(times) and times[i + 1] <= t:
            i += 1
        step = max(times[i + 1] - times[i], SOONEST)
        _between(motion, i, min(max((t - times[i]) / step, 0.0), 1.0), step, raw)
        _fill(tilting, raw, t, out[k])


@njit(**CALLEE)
def _fill(tilting, raw, t, row):
    """Fill a row from raw (6,), the stated motion of the plate at the time t: true motion, gravity, Omega, Omega'."""
    for c in range(3):
        row[c] = tilting.gain_beta * raw[c] + tilting.cross_beta * raw[c + 3]
        row[c + 3] = tilting.gain_gamma * raw[c + 3] + tilting.cross_gamma * raw[c]
    row[RADIUS_AT], row[BALL_AT], row[TIME_AT] = 0.0, 0.0, t
    row[STATED_AT], row[STATED_AT + 1] = GRAVITY * math.sin(row[0]), -GRAVITY * math.sin(row[3]) * math.cos(row[0])
    beta, gamma = row[0] + tilting.tilt_beta, row[3] + tilting.tilt_gamma
    sb, cb, sc, cc = math.sin(beta), math.cos(beta), math.sin(gamma), math.cos(gamma)
    b1, b2, c1, c2 = row[1], row[2], row[4], row[5]
    row[FELT_AT], row[FELT_AT + 1], row[FELT_AT + 2] = GRAVITY * sb, -GRAVITY * cb * sc, -GRAVITY * cb * cc
    row[FELT_AT + 3], row[FELT_AT + 4], row[FELT_AT + 5] = c1, b1 * cc, -b1 * sc
    row[FELT_AT + 6], row[FELT_AT + 7] = c2, b2 * cc - b1 * c1 * sc
    row[FELT_AT + 8] = -b2 * sc - b1 * c1 * cc
