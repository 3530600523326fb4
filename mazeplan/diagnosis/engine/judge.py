"""Windows of several lengths that cover a record, and the judgement of a candidate by those that were not fitted (see
`search`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mazeplan.core.records import Array
from mazeplan.diagnosis.engine.model import Model
from mazeplan.diagnosis.engine.windows import Fit, Windows, cut
from mazeplan.physics.effect import INPUT
from mazeplan.physics.effects.ball import viscous_friction
from mazeplan.physics.effects.coordinate import viscous_asymmetry

FEWEST_ROWS = 24  # of a window
LENGTHS = 4  # of windows
WHOLE = 8  # windows of the greatest length
CLEAR = 4.0  # standard errors
BETTER = 2.0  # standard errors of the gain between held-out windows
WORSE = 0.02  # relative growth of the held-out error that counts as worse
WORTH = 0.25  # fall of the squared error, over the noise and over what remains, that is worth a word
EXPLAINS = 1.3  # times the noise: an error below this has no other cause
FAR = 5.0  # times the noise: an error above this has causes that no effect found so far explains
LOST = 0.5  # error over the movement at which a simulation has left the record
HELD = 0.6  # of a sample; how inputs are held between samples makes them later by up to half a sample
LEAVES_MOST = "most of the error remains with all that was found"
WITHIN_A_SAMPLE = "how the inputs change between samples does the same"
HALF = 0.5  # share of an error far above the noise that all findings together may leave
DRIVES = "friction would drive the motion in one direction"


@dataclass(frozen=True)
class Level:
    """Windows of one length. Free initial states explain a line without any force."""

    seconds: float
    folds: tuple[Windows, Windows]  # odd and even windows
    movement: Array  # sum of squares of each window around its mean, over the noise
    bend: Array  # and around a straight line


@dataclass(frozen=True)
class Trial:
    """A model with some effects, fitted at each level."""

    names: tuple[str, ...]
    fits: tuple[tuple[Fit, Fit], ...]  # of both folds, by level
    held: tuple[Array, ...]  # cost of each held-out window by level, folds one after the other
    count: tuple[Array, ...]  # measurements in these windows

    def rms(self, level: int) -> float:
        """Held-out error in times the noise."""
        return math.sqrt(float(np.sum(self.held[level])) / float(np.sum(self.count[level])))

    def usual(self, level: int) -> float:
        """Held-out error of the middle one of the windows, in times the noise: in a sensitive motion, the fit of an
        initial state may end far off."""
        return math.sqrt(float(np.median(self.held[level] / self.count[level])))


def _levels_of(model: Model) -> tuple[Level, ...]:
    record, out = model.record, []
    longest = max(len(record) // WHOLE, FEWEST_ROWS)
    for rows in dict.fromkeys(np.geomspace(FEWEST_ROWS, longest, LENGTHS).round().astype(int).tolist()):
        windows = cut(record, rows)
        if len(windows) < 4:
            continue
        folds = (Windows(model, windows[0::2]), Windows(model, windows[1::2]))
        movement, bend = (np.concatenate([_around(fold, degree) for fold in folds]) for degree in (0, 1))
        seconds = float(np.median(record.t[windows[:, 1] - 1] - record.t[windows[:, 0]]))
        out.append(Level(seconds, folds, movement, bend))
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


class Judge:
    """Judges models of a record by held-out windows of several lengths, the shortest first."""

    def __init__(self, model: Model) -> None:
        self.model, self.levels = model, _levels_of(model)

    def valid(self, *trials: Trial) -> list[int]:
        """Levels at which the best of some models stays with the record, in most windows."""
        out = []
        for i, level in enumerate(self.levels):
            moving = level.movement > 4.0 * trials[0].count[i]
            for error in (np.maximum(trial.held[i] - trial.count[i], 0.0) for trial in trials):  # without noise
                middle = np.median(error[moving] / level.movement[moving]) if moving.any() else np.inf
                if max(middle, np.sum(error) / np.sum(level.movement)) < LOST**2:
                    out.append(i)
                    break
        return out

    def why_not(self, before: Trial, after: Trial, name: str) -> tuple[float, str]:
        """Gain of a model over another one (mean over the levels), and why it is not accepted, or an empty text.

        Where an error far above the noise remains, windows of two lengths have to show a further effect: at one length
        alone, it would stand in for whatever causes the rest."""
        valid = self.valid(before, after)
        if not valid:
            return 0.0, "the simulation leaves the record with it, too"
        total, better, worse, sure = 0.0, False, False, list[int]()
        for i in valid:
            gain = self.gains(before, after, i)
            total += float(gain.mean()) / len(valid)
            fewer = before.rms(i) ** 2 - after.rms(i) ** 2
            good = self._t(gain) > BETTER and fewer > 0.0
            clear = self.clear(after, name, i) > CLEAR and self._steady(after, name, i, valid)
            better |= good
            sure += [i] if good and clear else []
            explains = np.sum(before.held[i]) < LOST**2 * np.sum(self.levels[i].bend)  # else there is nothing to lose
            worse |= explains and after.rms(i) > (1.0 + WORSE) * before.rms(i) and self._t(gain) < -BETTER
        if self._drives(after, name, valid):
            return total, DRIVES
        if self._within_a_sample(after, name, valid):
            return total, WITHIN_A_SAMPLE
        if not better:
            return total, "the gain in the held-out windows is not beyond chance"
        if not sure:
            return total, "its size is not beyond chance"
        if worse:
            return total, "held-out windows of another length get worse"
        far = min(after.rms(i) for i in sure) > FAR
        if before.names and far and len(sure) == 1 < len(valid):
            return total, "only windows of one length show it, and much remains unexplained"
        if not any(self._worth(before, after, i) for i in sure):
            return total, "it changes the predictions by less than the noise, or than what remains unexplained"
        return total, ""

    def leaves_most(self, base: Trial, trial: Trial) -> bool:
        """Whether a model leaves more than HALF of an error that is far above the noise: then it stands in for
        something else."""
        valid = self.valid(base, trial)
        shares = [trial.rms(i) / base.rms(i) for i in valid if base.rms(i) > FAR]
        far = 2 * len(shares) > len(valid) or all(trial.rms(i) > FAR for i in valid)
        return bool(shares) and far and float(np.mean(np.log(shares))) > math.log(HALF)

    def explains(self, base: Trial, trial: Trial) -> bool:
        """Whether a model leaves hardly more than the noise, in windows of each length."""
        valid = self.valid(base, trial)
        return bool(valid) and all(trial.usual(i) < EXPLAINS for i in valid)

    def clearly_better(self, one: Trial, other: Trial) -> bool:
        """Whether a model predicts held-out windows better than another one: beyond chance and by more than noise, or
        beyond doubt."""
        for i in self.valid(other, one):
            t = self._t(self.gains(other, one, i))
            if t > BETTER and (t > CLEAR or self._worth(other, one, i)):
                return True
        return False

    def gains(self, before: Trial, after: Trial, level: int) -> Array:
        """Gains of the held-out windows that move."""
        count = after.count[level]
        moving = self.levels[level].movement > 2.0 * count
        k = max(1.0, 0.1 * min(float(np.median(t.held[level] / count)) for t in (before, after)))
        gain = gain_of(before.held[level], after.held[level], count, k)
        return gain[moving] if moving.sum() >= 4 else gain

    @staticmethod
    def _worth(before: Trial, after: Trial, level: int) -> bool:
        """Whether the error falls by more than the noise, and by more than a part of what remains."""
        left = after.rms(level) ** 2
        return before.rms(level) ** 2 - left > WORTH * max(1.0, left)

    @staticmethod
    def _t(gain: Array) -> float:
        return float(gain.mean()) / max(float(gain.std(ddof=1)) / math.sqrt(len(gain)), 1e-12)

    def clear(self, trial: Trial, name: str, level: int) -> float:
        """Size of an effect in standard errors; 0 if both folds disagree about its sign."""
        out, (one, two) = 0.0, trial.fits[level]
        effect = self.model.effects[name]
        for n, p in effect.parameters.items():
            if (name, n) in one.free and n not in effect.places:
                a, b = (fit.values[name][n] - p.default for fit in (one, two))
                error = max(math.hypot(one.stderr(name, n), two.stderr(name, n)) / 2.0, abs(a - b) / 4.0, 1e-300)
                out = max(out, abs(a + b) / 2.0 / error) if a * b > 0.0 else out
        return out

    @staticmethod
    def _drives(trial: Trial, name: str, valid: Sequence[int]) -> bool:
        """Whether viscous friction would be negative in one direction."""
        if name != viscous_asymmetry.name or viscous_friction.name not in trial.fits[0][0].values:
            return False
        values = [fit.values for i in valid for fit in trial.fits[i]]
        least = [v[viscous_friction.name]["coefficient"] - abs(v[name]["coefficient"]) for v in values]
        return float(np.median(least)) < 0.0

    def _within_a_sample(self, trial: Trial, name: str, valid: Sequence[int]) -> bool:
        """Whether a delay or lag of the inputs is shorter than the time between two samples, or a gain hardly one."""
        effect = self.model.effects[name]
        if effect.acts != INPUT:
            return False
        ((n, p),) = effect.parameters.items()
        size = float(np.median([fit.values[name][n] for i in valid for fit in trial.fits[i]]))
        return abs(size - 1.0) < p.smallest if n == "factor" else size < HELD * self.model.record.step

    def _steady(self, trial: Trial, name: str, level: int, valid: Sequence[int]) -> bool:
        """Whether windows of other lengths give about the same size, where they tell it: not at its bound."""
        for n, p in self.model.effects[name].parameters.items():
            if (name, n) not in trial.fits[level][0].free:
                continue
            sizes = []
            for one, two in (trial.fits[i] for i in (level, *valid)):
                a, b = (fit.values[name][n] - p.default for fit in (one, two))
                sizes.append((0.5 * (a + b), 0.5 * math.hypot(one.stderr(name, n), two.stderr(name, n))))
            (mean, error), *others = sizes
            for other, wide in others:
                off = abs(other - mean)
                if 0.0 < wide < 0.5 * abs(mean) and off > 0.5 * abs(mean) and off > CLEAR * math.hypot(error, wide):
                    return False
        return True


def gain_of(before: Array, after: Array, count: Array, k: float) -> Array:
    """Gain of each window (M,) from its costs and its number of measurements, with k as in `search`."""
    return 0.5 * np.log((before + k * count) / (after + k * count))
