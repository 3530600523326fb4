"""What search and fit need of a thing that moves along one coordinate: a ball in its ring, a drive on its axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from mazeplan.diagnosis.kalman import Moves, Problem
from mazeplan.physics.effect import Effect
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

    def build(self, candidates: Sequence[Effect], values: Values) -> tuple[Problem, Array]:
        """The problem with these effects at these values (of those left out: as declared), and its parameters."""
        ...

    def volume(self, values: Values, rows: np.ndarray) -> float:
        """-2 log of the determinant of the change from what was measured to what the problem has for it, of some rows;
        0 where effects leave that alone."""
        ...

    def moves(self, candidates: Sequence[Effect], values: Values, steps: Sequence[tuple[str, str, float]]) -> Moves:
        """What moving each of some parameters (effect, name, step) changes."""
        ...


def plain_moves(
    system: System, candidates: Sequence[Effect], values: Values, steps: Sequence[tuple[str, str, float]]
) -> Moves:
    """`System.moves` where parameters change nothing but p."""
    moved = [{**values, effect: {**values[effect], name: values[effect][name] + step}} for effect, name, step in steps]
    problem, here = system.build(candidates, values)
    p = np.array([system.build(candidates, there)[1] for there in moved]).reshape(len(steps), len(here))
    unmoved = np.ascontiguousarray(np.repeat(problem.w.mean(axis=1)[None, :, None], 2, axis=2))
    which, sizes = np.full(len(steps), -1, dtype=np.int64), np.array([step for *_, step in steps])
    return Moves(p, unmoved, which, sizes, np.tile([0, len(problem.terms)], (len(steps), 1)))
