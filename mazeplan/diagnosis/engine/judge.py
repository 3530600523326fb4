"""Judgement of a candidate by windows that were not fitted (see `search`)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mazeplan.core.records import Array
from mazeplan.diagnosis.engine.levels import Level, Trial
from mazeplan.diagnosis.engine.model import Model
from mazeplan.physics.effect import INPUT
from mazeplan.physics.effects.ball import viscous_friction
from mazeplan.physics.effects.coordinate import viscous_asymmetry

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


class Judge:
    """Judges models of a record by the held-out windows of some levels."""

    def __init__(self, model: Model, levels: Sequence[Level]) -> None:
        self.model, self.levels = model, tuple(levels)

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
        for n in self.model.effects[name].parameters:
            if (name, n) not in trial.fits[level][0].free:
                continue
            sizes = []
            for i in (level, *valid):
                one, two = trial.fits[i]
                p = self.model.effects[name].parameters[n].default
                sizes.append((one.values[name][n] - p, one.stderr(name, n)))
                sizes.append((two.values[name][n] - p, two.stderr(name, n)))
            mean, error = 0.5 * (sizes[0][0] + sizes[1][0]), 0.5 * math.hypot(sizes[0][1], sizes[1][1])
            for i in range(2, len(sizes), 2):
                other, wide = 0.5 * (sizes[i][0] + sizes[i + 1][0]), 0.5 * math.hypot(sizes[i][1], sizes[i + 1][1])
                off = abs(other - mean)
                if 0.0 < wide < 0.5 * abs(mean) and off > 0.5 * abs(mean) and off > CLEAR * math.hypot(error, wide):
                    return False
        return True


def gain_of(before: Array, after: Array, count: Array, k: float) -> Array:
    """Gain of each window (M,) from its costs and its number of measurements, with k as in `search`."""
    return 0.5 * np.log((before + k * count) / (after + k * count))
