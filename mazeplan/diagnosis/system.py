"""What search and fit need of a thing that moves along one coordinate: a ball in its ring, a drive on its axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from mazeplan.diagnosis.kalman import Problem
from mazeplan.diagnosis.library import Candidate
from mazeplan.records import Array

Values = dict[str, dict[str, float]]  # effect -> parameter -> value


class System(Protocol):
    """A record and how effects enter its equation of motion. dt: s between samples; theta (N,): measured position;
    first (N,): where an uninterrupted stretch begins; declared: effects that are known already; weakest: acceleration,
    root mean square, of an unnamed term that is worth a word."""

    dt: float
    theta: Array
    first: np.ndarray
    declared: Values
    weakest: float

    def __len__(self) -> int:
        """Samples."""
        ...

    def build(self, candidates: Sequence[Candidate], values: Values) -> tuple[Problem, Array]:
        """The problem with these effects at these values (of those left out: as declared), and its parameters."""
        ...
