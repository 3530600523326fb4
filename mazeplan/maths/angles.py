"""Angles in rad: wrapping and differences."""

from __future__ import annotations

import math


def wrap(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def difference(a: float, b: float) -> float:
    """Shortest signed turn from b to a, in [-pi, pi)."""
    return wrap(a - b)


def nearest(angle: float, reference: float) -> float:
    """`angle` plus the whole turns that bring it within half a turn of `reference`."""
    return reference + wrap(angle - reference)
