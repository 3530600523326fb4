"""Sine and cosine of angles that are nearly always small, such as the tilt of the plate."""

from __future__ import annotations

import math

from numba import njit

from mazeplan.core.maths.compiled import KERNEL

SMALL = 0.5  # rad


@njit(**KERNEL)
def sine_and_cosine(x):
    """(sin x, cos x); for |x| < SMALL by Taylor series, error about 1e-15, without a library call."""
    if not abs(x) < SMALL:
        return math.sin(x), math.cos(x)
    s = x * x
    sine = 1.0 - s / 6.0 * (
        1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0 * (1.0 - s / 156.0))))
    )
    cosine = 1.0 - s / 2.0 * (
        1.0 - s / 12.0 * (1.0 - s / 30.0 * (1.0 - s / 56.0 * (1.0 - s / 90.0 * (1.0 - s / 132.0))))
    )
    return x * sine, cosine
