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

    dt: s between samples; theta (N,): measured position; first (N,): an uninterrupted stretch begins; declared: known
    effects; weakest: root mean square acceleration from which a term without a name is reported."""

    dt: float
    theta: Array
    first: np.ndarray
    declared: Values
    weakest: float

    def __len__(self) -> int:
        """Samples."""
        ...

    def build(self, candidates: Sequence[Effect], values: Values) -> tuple[Problem, Array]:
        """The problem with these effects at these values, others as declared; and its parameters."""
        ...

    def volume(self, values: Values, rows: np.ndarray) -> float:
        """-2 log of the determinant of the change of variables from measured to true positions, of some rows."""
        ...

    def moves(self, candidates: Sequence[Effect], values: Values, steps: Sequence[tuple[str, str, float]]) -> Moves:
        """The change by a step of each parameter (effect, name, step)."""
        ...
