"""Errors of a model of a motion, and the words for them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from mazeplan.diagnosis.effect_entry import Values
from mazeplan.diagnosis.engine.judge import LOST
from mazeplan.diagnosis.engine.model import Model
from mazeplan.diagnosis.engine.windows import Windows

DIVERGED = 10.0  # error over the movement from which on there is no number in the document


@dataclass(frozen=True)
class MotionScore:
    """Errors of a model on a record.

    nrmse: error of the held-out windows over the movement in them
    free_run: rms error of one simulation from the first sample to the last one; NaN if it leaves the record
    over_noise: error of the held-out windows, in times the noise
    window: length of the windows, s; seconds: length of the record, s"""

    nrmse: float
    free_run: float
    over_noise: float
    window: float
    seconds: float
    unit: str
    forces: bool = False  # nrmse is a relative error of the force
    drawn: str = "nrmse"  # the error that a report draws

    @property
    def _error(self) -> str:
        return "force error" if self.forces else f"error in windows of {self.window:.2g} s"

    def labels(self) -> dict[str, str]:
        """Words with the unit for each error."""
        return {
            "nrmse": "relative force error ||e|| / ||y||"
            if self.forces
            else f"position error in windows of {self.window:.2g} s, over the movement in them",
            "free_run": f"position error of the free run (root mean square), {self.unit}",
        }

    def document(self) -> dict[str, float | None]:
        """The errors, rounded; None where the simulation leaves the record."""
        return {
            "nrmse": rounded(self.nrmse if self.nrmse < DIVERGED else math.nan),
            "free_run": rounded(self.free_run),
        }

    def both(self, after: MotionScore) -> str:
        """These errors and those after the effects were found, in words."""
        one, two = (f"{s.nrmse:.2%}" if s.nrmse < 1.0 else "beyond the movement itself" for s in (self, after))
        runs = " -> ".join(self._run(s.free_run) for s in (self, after))
        return f"{self._error} {one} -> {two}, {self.seconds:.3g} s of free run {runs}"

    def nothing_found(self) -> str:
        """The sentence of a record in which no effect was found."""
        return f"Nothing is missing: {self.alone()}."

    def alone(self) -> str:
        """These errors in words."""
        error = f"{self.nrmse:.2%}" if self.nrmse < 1.0 else "beyond the movement itself"
        return f"{self._error} {error}, {self.seconds:.3g} s of free run {self._run(self.free_run)}"

    def _run(self, off: float) -> str:
        times, unit = (1e3, "mm") if self.unit == "m" else (1.0, self.unit)
        return f"{times * off:.3g} {unit} off" if math.isfinite(off) else "(the simulation leaves the record)"


class Score(Protocol):
    """Errors of a model."""

    @property
    def drawn(self) -> str:
        """The name of the error that a report draws."""
        ...

    @property
    def unit(self) -> str:
        """The unit of the position."""
        ...

    def labels(self) -> dict[str, str]:
        """Words with the unit for each error."""
        ...

    def document(self) -> dict[str, float | None]:
        """The errors, rounded; None if not finite."""
        ...

    def nothing_found(self) -> str:
        """The sentence of a record in which no effect was found."""
        ...

    def both(self, after: Any) -> str:
        """These errors and those after the effects were found, in words."""
        ...


def free_run(model: Model, values: Values, coordinate: int = 0) -> float:
    """Rms error of a coordinate over the whole record (each stretch), NaN if the simulation leaves it."""
    record = model.record
    whole = Windows(model, np.array(record.stretches, dtype=np.int64))
    states = whole.guess
    for share in (0.02, 0.05, 0.1, 0.25, 0.5, 1.0):  # longer and longer, so that it does not lose the way
        parts = [(a, max(a + 20, a + round(share * (b - a)))) for a, b in record.stretches]
        windows = Windows(
            model, np.array([(a, min(b, c)) for (a, c), (_, b) in zip(parts, record.stretches, strict=True)])
        )
        states, r = windows.settled(values, states)
    own = windows.coordinate == coordinate
    off = float(np.sqrt(np.mean((r[own] * model.noise[coordinate]) ** 2)))
    y = record.y[:, coordinate]
    return off if off < LOST * float(np.nanstd(y)) else math.nan


def fall(gain: float) -> float:
    """By how much the error of a window falls, %, with a gain."""
    return 100.0 * (1.0 - math.exp(-max(gain, 0.0)))


def rounded(value: float, digits: int = 6) -> float | None:
    """A number of a document; None if not finite."""
    return round(float(value), digits) if math.isfinite(value) else None
