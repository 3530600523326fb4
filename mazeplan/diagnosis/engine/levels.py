"""Levels: windows of several lengths that cover a record, in two folds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mazeplan.core.records import Array
from mazeplan.diagnosis.engine.model import Model
from mazeplan.diagnosis.engine.windows import Fit, Windows, cut

FEWEST_ROWS = 24  # of a window
LENGTHS = 4  # of windows
WHOLE = 8  # windows of the greatest length


@dataclass(frozen=True)
class Level:
    """Windows of one length.

    folds: odd and even windows; movement, bend: sum of squares of each window around its mean and around a straight
    line, over the noise. Free initial states explain a line without any force."""

    rows: int
    seconds: float
    folds: tuple[Windows, Windows]
    movement: Array
    bend: Array


@dataclass(frozen=True)
class Trial:
    """A model with some effects, fitted at each level.

    fits: of both folds, by level; held: cost of each held-out window by level, folds one after the other"""

    names: tuple[str, ...]
    fits: tuple[tuple[Fit, Fit], ...]
    held: tuple[Array, ...]
    count: tuple[Array, ...]

    def rms(self, level: int) -> float:
        """Held-out error in times the noise."""
        return math.sqrt(float(np.sum(self.held[level])) / float(np.sum(self.count[level])))

    def usual(self, level: int) -> float:
        """Held-out error of the middle one of the windows, in times the noise: in a sensitive motion, the fit of an
        initial state may end far off."""
        return math.sqrt(float(np.median(self.held[level] / self.count[level])))


def levels_of(model: Model) -> tuple[Level, ...]:
    """Windows of several lengths, the shortest first."""
    record, out = model.record, []
    longest = max(len(record) // WHOLE, FEWEST_ROWS)
    for rows in dict.fromkeys(np.geomspace(FEWEST_ROWS, longest, LENGTHS).round().astype(int).tolist()):
        windows = cut(record, rows)
        if len(windows) < 4:
            continue
        folds = (Windows(model, windows[0::2]), Windows(model, windows[1::2]))
        movement, bend = (np.concatenate([_around(fold, degree) for fold in folds]) for degree in (0, 1))
        seconds = float(np.median(record.t[windows[:, 1] - 1] - record.t[windows[:, 0]]))
        out.append(Level(rows, seconds, folds, movement, bend))
    return tuple(out)


def _around(windows: Windows, degree: int) -> Array:
    """Sum of squares of each window around a polynomial, over the noise."""
    model, out = windows.model, np.zeros(len(windows.windows))
    for m, (a, b) in enumerate(windows.windows):
        for i, noise in enumerate(model.noise):
            seen = np.flatnonzero(np.isfinite(model.record.y[a:b, i]))
            t, y = model.record.t[a:b][seen], model.record.y[a:b, i][seen]
            left = y - np.polynomial.Polynomial.fit(t, y, degree)(t)
            out[m] += float(np.sum(left**2)) / noise**2
    return out


def track_of(level: Level, fits: Sequence[Fit]) -> Array:
    """Simulated states along the record (N, 2 C), each window with its own fit; NaN where there is none."""
    parts = [w.model.simulate(f.values, w.windows, f.states) for w, f in zip(level.folds, fits, strict=True)]
    return np.where(np.isfinite(parts[0]), parts[0], parts[1])


def least_left(levels: Sequence[Level], trial: Trial) -> Array:
    """What a model leaves in windows of some length that move, in times the noise, of each coordinate (C,);
    at most 1.

    A few numbers cannot fit below the noise: if less is left, a fast swing was taken for noise."""
    out = [np.ones(trial.fits[0][0].residual.shape[1])]
    for level, fits in zip(levels, trial.fits, strict=True):
        moving = np.split(level.movement > 2.0 * np.concatenate([fit.count for fit in fits]), [len(fits[0].count)])
        parts = [
            fit.residual[a + 1 : b]
            for fold, fit, moves in zip(level.folds, fits, moving, strict=True)
            for a, b in fold.windows[moves]
        ]
        if parts:
            square = np.sum([np.nansum(part**2, axis=0) for part in parts], axis=0)
            count = np.sum([np.isfinite(part).sum(axis=0) - 2.0 for part in parts], axis=0)
            out.append(np.sqrt(square / np.maximum(count, 1.0)))
    return np.min(out, axis=0)
