"""Angles in rad, numbers or arrays: wrapping and differences; and places on a ring in degrees for people."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:  # commands that compute nothing start without NumPy
    import numpy as np
    from numpy.typing import NDArray

Angle = TypeVar("Angle", float, "NDArray[np.float64]")


def wrap(angle: Angle) -> Angle:
    """The same angle in [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def difference(a: Angle, b: Angle) -> Angle:
    """Shortest signed turn from b to a, in [-pi, pi)."""
    return wrap(a - b)


def nearest(angle: Angle, reference: Angle) -> Angle:
    """`angle` plus the whole turns that bring it within half a turn of `reference`."""
    return reference + wrap(angle - reference)


def place_deg(angle: float, places: int = 9) -> float:
    """A place on a ring, rad, as people and names of openings give it: degrees from 0 to below 360, rounded."""
    return round(math.degrees(angle), places) % 360.0
