"""When a model with one more effect is better than the one without it.

For a model with cost c_m (sum of squares over the noise) in the held-out window m of n_m measurements, the gain of a
candidate over another model is

    l_m = 1/2 log (c'_m + n_m k) / (c_m + n_m k)            k: 1, or the square of the misfit that no candidate removes

Its mean over the windows, over its standard error between the windows, is the statistic: what counts is how large the
gain is beside its own changes along the record.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mazeplan.core.records import Array
from mazeplan.diagnosis.engine.levels import Level
from mazeplan.diagnosis.engine.model import Model
from mazeplan.diagnosis.engine.windows import Fit
from mazeplan.physics.effect import INPUT

CLEAR = 4.0  # standard errors
BETTER = 2.0  # standard errors of the gain between held-out windows
WORSE = 0.02  # relative growth of the held-out error that counts as worse
WORTH = 0.25  # fall of the squared error, over the noise and over what remains, that is worth a word
TYPICAL = 0.01  # mean gain of the windows that is worth a word where blows disturb some of them
LOST = 0.5  # error over the movement at which a simulation has left the record


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


class Judge:
    """Compares models on the held-out windows of all levels."""

    def __init__(self, model: Model, levels: Sequence[Level]) -> None:
        self.model, self.levels = model, levels

    def valid(self, *trials: Trial) -> list[int]:
        """Levels at which the best of some models stays with the record, in most windows."""
        out = []
        for i, level in enumerate(self.levels):
            moving = level.movement > 4.0 * trials[0].count[i]
            for error in (trial.held[i] for trial in trials):
                middle = np.median(error[moving] / level.movement[moving]) if moving.any() else np.inf
                if max(middle, np.sum(error) / np.sum(level.movement)) < LOST**2:
                    out.append(i)
                    break
        return out

    def reason(self, before: Trial, after: Trial, name: str) -> tuple[float, str]:
        """Gain of a model over another one (mean over the levels), and why it is not accepted, or an empty text."""
        valid = self.valid(before, after)
        if not valid:
            return 0.0, "the simulation leaves the record with it, too"
        total, better, sure, worth, worse = 0.0, False, False, False, False
        disturbed = self.model.system.disturbed  # a few blows then hide what happens all the time: windows count alike
        for i in valid:
            gain = self.gains(before, after, i)
            total = max(total, gain.mean()) if disturbed else total + float(gain.mean()) / len(valid)
            fewer = before.rms(i) ** 2 - after.rms(i) ** 2
            good = self.t(gain) > BETTER and (fewer > 0.0 or disturbed)
            clear = self.clear(after, name, i) > CLEAR and self._steady(after, name, i, valid)
            better |= good
            sure |= good and clear
            worth |= good and clear and (gain.mean() > TYPICAL if disturbed else self.worth(before, after, i))
            explains = np.sum(before.held[i]) < LOST**2 * np.sum(self.levels[i].bend)  # else there is nothing to lose
            larger = after.rms(i) > (1.0 + WORSE) * before.rms(i) and self.t(gain) < -BETTER
            worse |= explains and larger and not disturbed
        if not self._large(after, name, valid):
            return total, "it is smaller than the smallest size that matters"
        if self._within_a_sample(after, name, valid):
            return total, "it is shorter than a sample: how inputs are held between samples does the same"
        if not better:
            return total, "the gain in the held-out windows is not beyond chance"
        if not sure:
            return total, "its size is not beyond chance"
        if worse:
            return total, "held-out windows of another length get worse"
        if not worth:
            return total, "it changes the predictions by less than the noise, or than what remains unexplained"
        return total, ""

    def gains(self, before: Trial, after: Trial, level: int) -> Array:
        """Gains of the held-out windows that move."""
        count = after.count[level]
        moving = self.levels[level].movement > 2.0 * count
        k = max(1.0, 0.1 * min(float(np.median(t.held[level] / count)) for t in (before, after)))
        gain = gain_of(before.held[level], after.held[level], count, k)
        return gain[moving] if moving.sum() >= 4 else gain

    @staticmethod
    def worth(before: Trial, after: Trial, level: int) -> bool:
        """Whether the error falls by more than the noise, and by more than a part of what remains."""
        left = after.rms(level) ** 2
        return before.rms(level) ** 2 - left > WORTH * max(1.0, left)

    @staticmethod
    def t(gain: Array) -> float:
        """The mean gain over its standard error."""
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

    def _large(self, trial: Trial, name: str, valid: Sequence[int]) -> bool:
        """Whether an effect is as large as its smallest size, at one level at least."""
        effect = self.model.effects[name]
        return any(all(effect.size(fit.values[name], {}) >= 1.0 for fit in trial.fits[i]) for i in valid)

    def _within_a_sample(self, trial: Trial, name: str, valid: Sequence[int]) -> bool:
        """Whether a delay or lag of the inputs is shorter than the time between two samples."""
        effect = self.model.effects[name]
        if effect.acts != INPUT or "factor" in effect.parameters:
            return False
        (n,) = effect.parameters
        sizes = [fit.values[name][n] for i in valid for fit in trial.fits[i]]
        return float(np.median(sizes)) < self.model.record.step

    def _steady(self, trial: Trial, name: str, level: int, valid: Sequence[int]) -> bool:
        """Whether windows of other lengths give about the same size, where they tell it."""
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
                if wide < 0.5 * abs(mean) and off > 0.5 * abs(mean) and off > CLEAR * math.hypot(error, wide):
                    return False
        return True


def gain_of(before: Array, after: Array, count: Array, k: float) -> Array:
    """Gains (M,) of windows with these costs."""
    return 0.5 * np.log((before + k * count) / (after + k * count))
