"""The search for missing effects: forward selection and a backward check, judged by windows that were not fitted.

Windows of several lengths cover the record. At each length, the odd windows are fitted and the even ones predicted,
then the other way round, so each window is held out once.
A candidate is accepted if its gain is beyond chance at one length at least, if the held-out error shrinks there by more
than the noise, and if at no length the held-out windows get worse (`judge`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mazeplan.core.records import Array
from mazeplan.diagnosis.effect_entry import Values
from mazeplan.diagnosis.engine.judge import BETTER, TYPICAL, Judge, Trial, gain_of
from mazeplan.diagnosis.engine.levels import Level, levels_of, track_of
from mazeplan.diagnosis.engine.model import Model
from mazeplan.diagnosis.engine.screening import forecast
from mazeplan.diagnosis.engine.windows import Fit, Free, free_of
from mazeplan.physics.effect import INPUT

SAME = 0.02  # share of a candidate's influence that other fitted numbers cannot copy
EQUAL = 0.99  # of the best gain: candidates that the class names first go first
LEAST = 0.005  # forecast gain below which no candidate is fitted
LIKELY = 6  # candidates that are fitted at some lengths
KEPT = 3  # candidates that are fitted at all lengths
MOST = 5  # effects
FIRST = 0.003  # of its scale: where the fit of a candidate starts


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
    alike: groups of names that the record cannot tell apart; valid: levels that could be judged
    unknown: the term without a name that was found beside them, and is a part of `final`; empty if none was"""

    base: Trial
    final: Trial
    found: tuple[str, ...]
    alike: tuple[tuple[str, ...], ...]
    tried: tuple[Tried, ...]
    gains: dict[str, float]
    valid: tuple[int, ...]
    levels: tuple[Level, ...]
    unknown: str = ""


class Search:
    """One search.

    known: declared values; along: names of effects that are fitted in every model
    given: declared values that may have changed: these effects are candidates, too"""

    def __init__(
        self, model: Model, known: Values, along: Sequence[str], tell: Callable[[str], None],
        given: Values | None = None,
    ) -> None:  # fmt: skip
        self.model, self.known, self.tell, self.given = model, known, tell, given or {}
        self.levels = levels_of(model)
        self.judge = Judge(model, self.levels)
        always = [name for name in (model.system.motion.name, *known, *along) if name not in self.given]
        self.always = tuple(dict.fromkeys(always))
        self.cache: dict[frozenset[str], Trial] = {}
        self.starts: dict[str, list[dict[str, float]]] = {}  # of candidates, where a linear step promises most

    def values(self, names: Sequence[str], like: Values | None = None, at_rest: bool = False) -> Values:
        """Start values of a model: those of another model where it has them, else small ones (at_rest: no effect)."""
        out: Values = {}
        for name in dict.fromkeys((*self.given, *names)):
            effect = self.model.effects[name]
            if name not in names:
                out[name] = dict(self.given[name])
                continue
            if like is not None and name in like:
                out[name] = dict(like[name])
                continue
            out[name] = {n: p.default for n, p in effect.parameters.items()}
            out[name] |= self.starts[name][0] if effect.places and name in self.starts else {}
            for n in out[name] if name not in (*self.always, *self.given) else ():
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
        free, fits, held, count = self.free((*self.always, *added)), [], [], []
        before: dict[int, Values] = {}
        track = None  # states along the record, from shorter windows: where longer ones start
        for level in which:
            pair: dict[int, Fit] = {}
            for fold in folds:
                near = self.levels[level].folds[fold].states_on(track)
                starts = [(before[fold], near)] if fold in before else []
                starts += self._starts(added, parent, level, fold)
                pair[fold] = self._best(level, fold, free, starts)
            if len(pair) == 2 and added and self.model.effects[added[-1]].places:  # each fold learns from the other one
                for fold in folds:
                    starts = [(pair[f].values, pair[fold].states) for f in (fold, 1 - fold)]
                    pair[fold] = self._best(level, fold, free, starts)
            before = {fold: fit.values for fold, fit in pair.items()}
            tests = []
            for fold in sorted(folds, reverse=True):  # held-out windows in the order of folds
                other = self.levels[level].folds[1 - fold]
                tests.append(other.held_out(pair[fold].values, other.states_on(track)))
            if len(pair) == 2:
                track = track_of(self.levels[level], (pair[0], pair[1]))
            fits.append((pair[folds[0]], pair[folds[-1]]))
            held.append(np.concatenate([test.cost for test in tests]))
            count.append(np.concatenate([test.count for test in tests]))
        return Trial(added, tuple(fits), tuple(held), tuple(count))

    def _starts(
        self, added: tuple[str, ...], parent: Trial | None, level: int, fold: int
    ) -> list[tuple[Values, Array]]:
        """Values and initial states at which a fit may start: at those of another model, without the new effect."""
        names = (*self.always, *added)
        if parent is None:
            return [(self.values(names), self.levels[level].folds[fold].guess)]
        own = parent.fits[level][fold]
        values = self.values(names, own.values, at_rest=True)
        new = added[-1] if added and added[-1] not in parent.names else ""
        ways = self.starts.get(new) or [{}]
        return [({**values, new: values[new] | way} if way else values, own.states) for way in ways]

    def _best(self, level: int, fold: int, free: Free, starts: Sequence[tuple[Values, Array]]) -> Fit:
        """The best fit from several starts. A few steps from each of them show which one that is."""
        windows = self.levels[level].folds[fold]
        tries = [windows.fit(start, free, states, most=3) for start, states in starts]
        disturbed = self.model.system.disturbed
        n = windows.count
        first = min(tries, key=lambda f: float(np.sum(n * np.log(1.0 + f.cost / n))) if disturbed else f.total)
        return windows.fit(first.values, free, first.states)

    def run(self, most: int = MOST) -> Finding:
        """Add effects until none is accepted, then check each of them again."""
        self.tell("fits of the known motion")
        base = current = self.trial(())
        tried: dict[str, Tried] = {}
        every = [self.model.system.motion, *self.model.system.effects] if self.given else self.model.system.effects
        library = [e.name for e in every if e.name not in self.always and e.acts != e.name]
        for name in [name for name in library if self.redundant(base, name)]:
            library.remove(name)
            tried[name] = Tried(name, 0.0, "the fitted numbers of the motion can do the same")
        nameless = [name for name in library if not self.model.effects[name].named]
        library = [name for name in library if name not in nameless]
        gains: dict[str, float] = {}
        found: list[str] = []
        while len(found) < most:
            there = {rival for name in found for rival in self.model.effects[name].rivals}
            candidates = [name for name in library if name not in found and name not in there and self.free([name])]
            judged = self._round(current, candidates, tried)
            if not judged:
                break
            best, gain = judged[0]
            current, found = best, [*found, best.names[-1]]
            gains[best.names[-1]] = gain
            self.tell(f"{best.names[-1]}: explains more")
        current, found = self._exchanged(current, found, library, gains)
        current, found = self._backward(base, current, found, tried, gains)
        unknown = ""
        wanted = (
            self.model.system.disturbed or not found
        )  # a machine's list of effects is often shorter than its causes
        if wanted and nameless and (judged := self._round(current, nameless, tried)):
            unknown = judged[0][0].names[-1]
            current, found = self._backward(base, judged[0][0], [*found, unknown], tried, gains)
            found.remove(unknown)
        valid = tuple(self.judge.valid(base, current))
        alike = self._alike(current, found, library, valid)
        for name in found:
            tried.pop(name, None)
        return Finding(base, current, tuple(found), alike, tuple(tried.values()), gains, valid, self.levels, unknown)

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

    def _round(self, current: Trial, candidates: Sequence[str], tried: dict[str, Tried]) -> list[tuple[Trial, float]]:
        """Trials of the candidates that are accepted, the best first."""
        scored = []
        which = sorted({0, len(self.levels) // 2})
        forecasts = forecast(self, current, candidates)
        likely = sorted(candidates, key=lambda name: -forecasts[name])[:LIKELY]
        likely = [name for name in likely if forecasts[name] > LEAST]
        tried |= {name: Tried(name, forecasts[name], "others explain more") for name in candidates}
        for name in likely:
            self.tell(f"trying {name}, {likely.index(name) + 1} of {len(likely)}")
            quick = self._fitted((*current.names, name), current, which, (0,))
            gain = sum(
                gain_of(current.fits[level][0].cost, quick.fits[i][0].cost, quick.fits[i][0].count, 1.0).mean()
                for i, level in enumerate(which)
            )
            scored.append((gain, name))
        scored.sort(reverse=True)
        accepted = []
        for gain, name in scored[KEPT:]:
            tried[name] = Tried(name, float(gain), "others explain more")
        order = {name: i for i, name in enumerate(candidates)}
        for _, name in sorted(scored[:KEPT], key=lambda one: order[one[1]]):
            trial = self.trial((*current.names, name), current)
            gain, why_not = self.judge.reason(current, trial, name)
            if why_not:
                tried[name] = Tried(name, gain, why_not)
            else:
                accepted.append((trial, gain))
        best = max((gain for _, gain in accepted), default=0.0)
        accepted.sort(key=lambda one: -one[1] if one[1] < EQUAL * best else -best)  # equal ones in the class's order
        for trial, gain in accepted[1:]:
            tried[trial.names[-1]] = Tried(trial.names[-1], gain, f"{accepted[0][0].names[-1]} explains more")
        return accepted

    def _exchanged(
        self, current: Trial, found: list[str], library: Sequence[str], gains: dict[str, float]
    ) -> tuple[Trial, list[str]]:
        """Exchange effects for plainer ones that explain as much: an early effect also took a share of later ones."""
        for i, name in enumerate(found if len(found) > 1 and self.model.system.disturbed else []):
            rest, count = [n for n in found if n != name], len(self.free([name]))
            others = [n for n in library if n not in found and 0 < len(self.free([n])) < count]
            without = self.trial(rest, current)
            forecasts = forecast(self, without, others)
            best = max(others, key=lambda n: forecasts[n], default="")
            if not best or forecasts[best] < LEAST:
                continue
            instead = self.trial((*rest, best), without)
            gain, why_not = self.judge.reason(without, instead, best)
            valid = self.judge.valid(instead, current)
            if not why_not and all(self.judge.gains(instead, current, level).mean() < TYPICAL for level in valid):
                found = [*found[:i], best, *found[i + 1 :]]
                current, gains[best] = instead, gain
        return current, found

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
                gain, why_not = self.judge.reason(without, current, name)
                if why_not:
                    tried[name] = Tried(name, gain, f"beside {', '.join(rest)}: {why_not}")
                    current, found, again = without, list(rest), True
                    gains.pop(name, None)
                    break
                gains[name] = gain
        return current, found

    def _alike(
        self, current: Trial, found: Sequence[str], library: Sequence[str], valid: Sequence[int]
    ) -> tuple[tuple[str, ...], ...]:
        """Groups of a found effect and others that would explain the record as well in its place."""
        groups = []
        for name in found:
            rest = tuple(other for other in current.names if other != name)
            without = self.trial(rest, current)
            group = [name]
            for rival in library:
                if rival in found or frozenset((*rest, rival)) not in self.cache:
                    continue
                instead = self.cache[frozenset((*rest, rival))]
                if self.judge.reason(without, instead, rival)[1]:
                    continue
                clear = any(
                    self.judge.t(self.judge.gains(instead, current, i)) > BETTER
                    and self.judge.worth(instead, current, i)
                    for i in valid
                )
                if not clear:
                    group.append(rival)
            if len(group) > 1:
                groups.append(tuple(group))
        return tuple(groups)
