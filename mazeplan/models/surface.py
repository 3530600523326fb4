"""Forces along a ring that depend on the angle alone, compiled: a floor that is not flat, a magnet, a torque.

Packed as (SIZE,) numbers: whether there are any; a constant; cos and sin of theta, 2 theta, 3 theta
(`surface_profile`); centre, width, height of a hill or, with a negative height, of a hollow (`surface_bump`). In
rad/s^2 and rad.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from mazeplan.records import Array

if TYPE_CHECKING:
    from mazeplan.models.ball import BallModel

SIZE = 11
_CONSTANT, _WAVES, _BUMP = 1, 2, 8
WAVES = ("cos1", "sin1", "cos2", "sin2", "cos3", "sin3")


def pack(ball: BallModel) -> Array:
    """The numbers (SIZE,) of a ball model; zeros where it knows of no such force."""
    out = np.zeros(SIZE)
    out[_CONSTANT] = ball.parameter("constant_torque", "acceleration", 0.0)
    out[_WAVES:_BUMP] = [ball.parameter("surface_profile", name, 0.0) for name in WAVES]
    bump = [ball.parameter("surface_bump", *p) for p in (("centre", 0.0), ("width", 0.2), ("height", 0.0))]
    out[_BUMP:] = bump
    out[0] = float(bump[2] != 0.0 or bool(out[_CONSTANT:_BUMP].any()))
    return out


@njit(cache=True, error_model="numpy")
def force(p, at, theta):
    """Acceleration along the ring, rad/s^2; the numbers begin at p[at]."""
    total = p[at + _CONSTANT]
    for n in range(3):
        i = at + _WAVES + 2 * n
        total += p[i] * math.cos((n + 1) * theta) + p[i + 1] * math.sin((n + 1) * theta)
    i = at + _BUMP
    if p[i + 2] != 0.0:
        e = math.atan2(math.sin(theta - p[i]), math.cos(theta - p[i])) / p[i + 1]
        total += p[i + 2] * e * math.exp(0.5 - 0.5 * e * e)
    return total


@njit(cache=True, error_model="numpy")
def slope(p, at, theta):
    """Derivative of `force` by theta, 1/s^2."""
    total = 0.0
    for n in range(3):
        i = at + _WAVES + 2 * n
        total += (n + 1) * (p[i + 1] * math.cos((n + 1) * theta) - p[i] * math.sin((n + 1) * theta))
    i = at + _BUMP
    if p[i + 2] != 0.0:
        e = math.atan2(math.sin(theta - p[i]), math.cos(theta - p[i])) / p[i + 1]
        total += p[i + 2] / p[i + 1] * (1.0 - e * e) * math.exp(0.5 - 0.5 * e * e)
    return total
