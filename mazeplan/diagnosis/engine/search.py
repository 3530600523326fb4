"""The search for missing effects: forward selection and a backward check, judged by windows that were not fitted.

Windows of several lengths cover the record. At each length, the odd windows are fitted and the even ones predicted,
then the other way round, so each window is held out once. For a model with cost c_m (sum of squares over the noise) in
the held-out window m of n_m measurements, the gain of a candidate over another model is

    l_m = 1/2 log (c'_m + n_m k) / (c_m + n_m k)            k: 1, or the square of the misfit that no candidate removes

Its mean over the windows, over its standard error between the windows, is the statistic. Its threshold is that of
Student's t for so many windows: what counts is how large the gain is beside its own changes along the record. A
candidate is accepted if the gain is beyond chance at one length at least, if the held-out error shrinks there by more
than the noise, and if at no length the held-out windows get worse.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mazeplan.core.records import Array
from mazeplan.diagnosis.engine.levels import Level, levels_of, track_of
from mazeplan.diagnosis.engine.model import Free, Model, free_of
from mazeplan.diagnosis.engine.system import Values
from mazeplan.diagnosis.engine.windows import Fit, Point
from mazeplan.physics.effect import INPUT

CLEAR = 4.0  # standard errors
BETTER = 2.0  # standard errors of the gain between held-out windows
WORSE = 0.02  # relative growth of the held-out error that counts as worse
WORTH = 0.25  # fall of the squared error, over the noise and over what remains, that is worth a word
FAR = 5.0  # times the noise: an error above this has causes that no effect found so far explains
SAME = 0.02  # share of a candidate's influence that other fitted numbers cannot copy
LOST = 0.5  # error over the movement at which a simulation has left the record
KEPT = 2  # candidates that are fitted at all lengths
FEWER = 0.5  # of the gain of a candidate that is accepted; one that gains less is not fitted at all lengths
MOST = 5  # effects
FIRST = 0.003  # of its scale: where the fit of a candidate starts


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


@dataclass(frozen=True)
class Tried:
    """A candidate that was not taken, with its gain and the reason."""

    name: str
    gain: float
    why_not: str


@dataclass(frozen=True)
class Finding:
    """The result of a search.

    base, final: trials without and with what was found; found: names of effects in the order in which they were found
    alike: groups of names that the record cannot tell apart; valid: levels that could be judged"""

    base: Trial
    final: Trial
    found: tuple[str, ...]
    alike: tuple[tuple[str, ...], ...]
    tried: tuple[Tried, ...]
    gains: dict[str, float]
    valid: tuple[int, ...]
    levels: tuple[Level, ...]


class Search:
    """One search. known: declared values; along: names of effects that are fitted in every model"""

    def __init__(
        self, model: Model, known: Values, along: Sequence[str], tell: Callable[[str], None],
        levels: Sequence[Level] | None = None,
    ) -> None:  # fmt: skip
        self.model, self.known, self.tell = model, known, tell
        self.levels = tuple(levels or levels_of(model))
        self.always = tuple(dict.fromkeys([model.system.motion.name, *known, *along]))
        self.cache: dict[frozenset[str], Trial] = {}

    def values(self, names: Sequence[str], like: Values | None = None, at_rest: bool = False) -> Values:
        """Start values of a model: those of another model where it has them, else small ones (at_rest: no effect)."""
        out: Values = {}
        for name in names:
            effect = self.model.effects[name]
            if like is not None and name in like:
                out[name] = dict(like[name])
                continue
            out[name] = {n: p.default for n, p in effect.parameters.items()}
            if effect.starts and effect.places:
                out[name] = dict(zip(effect.parameters, effect.starts[0], strict=False)) | {
                    n: out[name][n] for n in list(effect.parameters)[len(effect.starts[0]) :]
                }
            for n in out[name] if name not in self.always else ():
                if effect.parameters[n].fixed or n in effect.places or (effect.acts == INPUT and n == "factor"):
                    continue
                one = effect.parameters[n]
                if not at_rest:
                    out[name][n] = min(one.default + FIRST * self.model.scale[name, n], one.high)
            out[name] |= self.known.get(name, {})
        return {name: out[name] | self.known.get(name, {}) for name in out}

    def free(self, names: Sequence[str]) -> Free:
        """Parameters that are fitted."""
        return free_of([self.model.effects[name] for name in names], self.known)

    def trial(self, added: Sequence[str], parent: Trial | None = None) -> Trial:
        """The model with some effects, fitted at all levels."""
        key = frozenset(added)
        if key not in self.cache:
            self.cache[key] = self._fitted(tuple(added), parent, range(len(self.levels)), (0, 1))
        return self.cache[key]

    def _fitted(
        self, added: tuple[str, ...], parent: Trial | None, which: Sequence[int], folds: Sequence[int]
    ) -> Trial:
        """Fits at some levels. Windows are held out only if both folds are fitted."""
        names = (*self.always, *added)
        free, fits, held, count = self.free(names), [], [], []
        before: list[Values | None] = [None, None]
        track = None  # states along the record, from shorter windows: where longer ones start
        for level in which:
            pair, costs, counts = [], [], []
            for fold in folds:
                windows = self.levels[level].folds[fold]
                near = windows.states_on(track)
                starts = [] if before[fold] is None else [windows.begin(self.values(names, before[fold]), near)]
                if parent is not None:
                    own = parent.fits[level][fold]
                    values = self.values(names, own.values, at_rest=True)
                    starts.append(Point(values, own.states, windows.residual(values, own.states)))
                starts = starts or [windows.begin(self.values(names), windows.guess)]
                tries = [windows.descend(start, free, most=1) for start in starts]
                best = min(tries, key=lambda point: point.cost)
                fit = windows.finished(windows.descend(best, free), free)
                before[fold] = fit.values
                pair.append(fit)
                if len(folds) == 2:
                    other = self.levels[level].folds[1 - fold]
                    test = other.held_out(fit.values, other.states_on(track))
                    costs.append(test.cost)
                    counts.append(test.count)
            fits.append((pair[0], pair[-1]))
            if len(folds) == 2:
                track = track_of(self.levels[level], pair)
                held.append(np.concatenate(costs[::-1]))  # in the order of folds
                count.append(np.concatenate(counts[::-1]))
        return Trial(added, tuple(fits), tuple(held), tuple(count))

    def run(self, most: int = MOST) -> Finding:
        """Add effects until none is accepted, then check each of them again."""
        self.tell("fits of the known motion")
        base = current = self.trial(())
        tried: dict[str, Tried] = {}
        library = [e.name for e in self.model.system.effects if e.name not in self.always]
        for name in [name for name in library if self.redundant(base, name)]:
            library.remove(name)
            tried[name] = Tried(name, 0.0, "the fitted numbers of the motion can do the same")
        gains: dict[str, float] = {}
        found: list[str] = []
        while len(found) < most:
            candidates = [name for name in library if name not in found and self.free([name])]
            judged = self._round(current, candidates, tried)
            if not judged:
                break
            best, gain = judged[0]
            current, found = best, [*found, best.names[-1]]
            gains[best.names[-1]] = gain
            self.tell(f"{best.names[-1]}: explains more")
        current, found = self._backward(base, current, found, tried, gains)
        valid = tuple(self.valid(base, current))
        alike = self._alike(current, found, library)
        for name in found:
            tried.pop(name, None)
        return Finding(base, current, tuple(found), alike, tuple(tried.values()), gains, valid, self.levels)

    def redundant(self, base: Trial, name: str) -> bool:
        """Whether the fitted numbers of the motion can copy an effect, at every level."""
        effect = self.model.effects[name]
        own = tuple((name, n) for n, p in effect.parameters.items() if not p.fixed)
        if len(own) != 1 or not self.free(base.names + self.always):
            return False
        for i, level in enumerate(self.levels):
            fit = base.fits[i][0]
            values = {**fit.values, **self.values([name], at_rest=True)}
            if level.folds[0].own_share(values, fit.states, own[0], fit.free) > SAME:
                return False
        return True

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

    def _round(self, current: Trial, candidates: Sequence[str], tried: dict[str, Tried]) -> list[tuple[Trial, float]]:
        """Trials of the candidates that are accepted, the best first."""
        scored = []
        which = sorted({0, len(self.levels) // 2})
        for name in candidates:
            self.tell(f"trying {name}")
            quick = self._fitted((*current.names, name), current, which, (0,))
            gain = sum(
                _gain(current.fits[level][0].cost, quick.fits[i][0].cost, quick.fits[i][0].count, 1.0).mean()
                for i, level in enumerate(which)
            )
            scored.append((gain, name))
        scored.sort(reverse=True)
        accepted: list[tuple[Trial, float]] = []
        judged = 0  # by windows of a length at least; a simulation with others leaves the record
        for score, name in scored:
            if judged == KEPT or (accepted and score < FEWER * scored[0][0]):
                tried[name] = Tried(name, float(score), "others explain more")
                continue
            trial = self.trial((*current.names, name), current)
            judged += bool(self.valid(current, trial))
            gain, why_not = self.judge(current, trial, name)
            if why_not:
                tried[name] = Tried(name, gain, why_not)
            else:
                accepted.append((trial, gain))
        order = {name: i for i, name in enumerate(candidates)}
        accepted.sort(key=lambda one: order[one[0].names[-1]])
        best, _ = max(accepted, key=lambda one: one[1], default=(current, 0.0))
        accepted.sort(key=lambda one: self._clearly_better(best, one[0]))  # others in the order of the class
        for trial, gain in accepted[1:]:
            tried[trial.names[-1]] = Tried(trial.names[-1], gain, f"{accepted[0][0].names[-1]} explains more")
        return accepted

    def judge(self, before: Trial, after: Trial, name: str) -> tuple[float, str]:
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
        if self._within_a_sample(after, name, valid):
            return total, "it is shorter than a sample: how inputs are held between samples does the same"
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

    def _clearly_better(self, one: Trial, other: Trial) -> bool:
        """Whether a model predicts held-out windows better than another one, beyond chance and by more than noise."""
        return any(
            self._t(self.gains(other, one, i)) > BETTER and self._worth(other, one, i) for i in self.valid(other, one)
        )

    def gains(self, before: Trial, after: Trial, level: int) -> Array:
        """Gains of the held-out windows that move."""
        count = after.count[level]
        moving = self.levels[level].movement > 2.0 * count
        k = max(1.0, 0.1 * min(float(np.median(t.held[level] / count)) for t in (before, after)))
        gain = _gain(before.held[level], after.held[level], count, k)
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

    def _within_a_sample(self, trial: Trial, name: str, valid: Sequence[int]) -> bool:
        """Whether a delay or lag of the inputs is shorter than the time between two samples."""
        effect = self.model.effects[name]
        if effect.acts != INPUT or "factor" in effect.parameters:
            return False
        (n,) = effect.parameters
        sizes = [fit.values[name][n] for i in valid for fit in trial.fits[i]]
        return float(np.median(sizes)) < self.model.record.step

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

    def _backward(
        self, base: Trial, current: Trial, found: list[str], tried: dict[str, Tried], gains: dict[str, float]
    ) -> tuple[Trial, list[str]]:
        """Drop effects that are no longer needed beside later ones."""
        again = len(found) > 1
        while again and found:
            again = False
            for name in list(found[:-1]):
                rest = tuple(other for other in found if other != name)
                without = self.trial(rest, current)
                gain, why_not = self.judge(without, current, name)
                if why_not:
                    tried[name] = Tried(name, gain, f"beside {', '.join(rest)}: {why_not}")
                    current, found, again = without, list(rest), True
                    gains.pop(name, None)
                    break
                gains[name] = gain
        return current, found

    def _alike(self, current: Trial, found: Sequence[str], library: Sequence[str]) -> tuple[tuple[str, ...], ...]:
        """Groups of a found effect and others that would explain the record as well in its place."""
        groups = []
        for name in found:
            rest = tuple(other for other in found if other != name)
            without = self.trial(rest, current)
            group = [name]
            for rival in library:
                if rival in found or frozenset((*rest, rival)) not in self.cache:
                    continue
                instead = self.cache[frozenset((*rest, rival))]
                if self.judge(without, instead, rival)[1]:
                    continue
                if not self._clearly_better(current, instead):
                    group.append(rival)
            if len(group) > 1:
                groups.append(tuple(group))
        return tuple(groups)


def _gain(before: Array, after: Array, count: Array, k: float) -> Array:
    return 0.5 * np.log((before + k * count) / (after + k * count))
