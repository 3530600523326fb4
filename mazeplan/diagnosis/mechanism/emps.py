"""The drive axis of the public benchmark EMPS (`data.drivelog`) as a mechanism: a mass under the drive's force."""

from __future__ import annotations

import math
from typing import Any

from mazeplan.diagnosis.mechanism.mechanism import mechanism_of
from mazeplan.physics.effect import Parameter


class Axis:
    """The axis: a force is its input, the position is its output."""

    position, unit, inputs = "qm", "m", ("force",)
    name, force, inertia = "moving_mass", "force", "mass"
    parameters = {"mass": Parameter("kg", 1.0, 0.0, math.inf)}  # noqa: RUF012  read only

    @staticmethod
    def motion(s: Any, p: Any) -> Any:
        """Acceleration of the mass under the force, m/s^2."""
        return s.force / p.mass


EMPS = mechanism_of(Axis)
