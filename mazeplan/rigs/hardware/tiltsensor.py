"""Converts the voltages of the tilt sensor's diode to the tilt of the plate.

    beta = sum_k c_k a^i b^j,   a = (v0 - centre0) / scale0,   b = (v1 - centre1) / scale1,   gamma alike

The plate turns a laser. The laser's spot on the diode moves nearly in proportion to both tilts. Products and powers
correct for a diode that is turned, not flat, and not linear. `tiltcalibration` finds the coefficients.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pydantic import Field, field_validator

from mazeplan.core.records import Array
from mazeplan.maze.sections import Section

POWERS = {
    "one": (0, 0), "a": (1, 0), "b": (0, 1), "ab": (1, 1), "aa": (2, 0), "bb": (0, 2),
    "aaa": (3, 0), "aab": (2, 1), "abb": (1, 2), "bbb": (0, 3),
}  # fmt: skip
REACH = 1.3  # times the calibrated half range: farther out the polynomial is not valid


@dataclass(frozen=True)
class DiodeSensor:
    """A calibrated sensor.

    centre, scale: of the two channels, V.
    beta, gamma: {name of a term: coefficient, deg}."""

    centre: tuple[float, float]
    scale: tuple[float, float]
    beta: Mapping[str, float]
    gamma: Mapping[str, float]

    def tilt(self, v0: float, v1: float) -> tuple[float, float]:
        """beta, gamma, rad, at these voltages. Voltages beyond REACH are clamped."""
        a, b = (min(max((v - c) / s, -REACH), REACH) for v, c, s in zip((v0, v1), self.centre, self.scale, strict=True))
        beta, gamma = (
            sum(k * a ** POWERS[name][0] * b ** POWERS[name][1] for name, k in terms.items())
            for terms in (self.beta, self.gamma)
        )
        return math.radians(beta), math.radians(gamma)

    def reaches(self, v0: float, v1: float) -> bool:
        """Whether the voltages are within REACH. If not, the laser's spot has left the diode."""
        pairs = zip((v0, v1), self.centre, self.scale, strict=True)
        return all(abs(v - c) <= REACH * s for v, c, s in pairs)


class TiltSection(Section):
    """The section `tilt:` of a rig's file, as `mazeplan calibrate tilt` writes it."""

    centre_v: tuple[float, float]
    scale_v: tuple[float, float]
    beta_deg: dict[str, float]
    gamma_deg: dict[str, float]
    error_deg: float = Field(default=0.0, ge=0.0)
    readings: int = Field(default=0, ge=0)
    date: str = ""

    @field_validator("scale_v")
    @classmethod
    def _positive(cls, scale: tuple[float, float]) -> tuple[float, float]:
        if not all(s > 0.0 for s in scale):
            raise ValueError(f"got {list(scale)}, expected numbers > 0")
        return scale

    @field_validator("beta_deg", "gamma_deg")
    @classmethod
    def _known(cls, terms: dict[str, float]) -> dict[str, float]:
        if not terms or any(name not in POWERS for name in terms):
            got = ", ".join(repr(name) for name in terms if name not in POWERS) or "none"
            raise ValueError(f"got {got}, expected coefficients of {', '.join(POWERS)}")
        return terms

    def sensor(self) -> DiodeSensor:
        """The calibrated sensor of this section."""
        return DiodeSensor(self.centre_v, self.scale_v, self.beta_deg, self.gamma_deg)


def design(terms: tuple[str, ...], v: Array, centre: Array, scale: Array) -> Array:
    """Values (N, len(terms)) of the terms at voltages v (N, 2)."""
    a, b = ((v - centre) / scale).T
    return np.column_stack([a ** POWERS[name][0] * b ** POWERS[name][1] for name in terms])
