"""The interface of a system along one coordinate for search and fit: a ball in its ring, a drive on its axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from mazeplan.core.records import Array
from mazeplan.diagnosis.coordinate.kalman import Moves, Problem
from mazeplan.physics.effect import Effect

Values = dict[str, dict[str, float]]  # effect -> parameter -> value


class System(Protocol):
    """A record, and how effects enter its equation of motion.

    dt: time between samples, s
    theta: measured positions (N,)
    begins: True (N,) where an uninterrupted stretch begins
    declared: known effects
    weakest: minimum root mean square acceleration of a term without a name, to report it"""

    dt: float
    theta: Array
    begins: np.ndarray
    declared: Values
    weakest: float

    def __len__(self) -> int:
        """Number of samples."""
        ...

    def build(self, candidates: Sequence[Effect], values: Values) -> tuple[Problem, Array]:
        """The problem and its parameters, with these effects at these values; other effects stay as declared."""
        ...

    def volume(self, values: Values, rows: np.ndarray) -> float:
        """-2 log of the determinant of the change of variables from measured to true positions, of some rows."""
        ...

    def moves(self, candidates: Sequence[Effect], values: Values, steps: Sequence[tuple[str, str, float]]) -> Moves:
        """Changes when each parameter (effect, name, step) moves by its step."""
        ...
