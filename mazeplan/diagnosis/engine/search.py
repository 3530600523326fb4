"""The search for missing effects: forward selection and a backward check, judged by windows that were not fitted.

Windows of several lengths cover the record. At each length, the odd windows are fitted and the even ones predicted,
then the other way round, so each window is held out once. For a model with cost c_m (sum of squares over the noise) in
the held-out window m of n_m measurements, the gain of a candidate over another model is

    l_m = 1/2 log (c'_m + n_m k) / (c_m + n_m k)            k: 1, or the square of the misfit that no candidate removes

Its mean over the windows, over its standard error between the windows, is the statistic. Its threshold is that of
Student's t for so many windows: what counts is how large the gain is beside its own changes along the record. A
candidate is accepted if the gain is beyond chance at one length at least, if the held-out error shrinks there by more
than the noise, and if at no length the held-out windows get worse. At the end, one effect may take the place of
several, and two together are tried where single ones leave much. All findings have to explain half of a large error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from mazeplan.core.progress import Words
from mazeplan.diagnosis.document import Values
from mazeplan.diagnosis.engine.judge import DRIVES, EXPLAINS, LEAVES_MOST, Judge, Level, Trial, gain_of, track_of
from mazeplan.diagnosis.engine.model import Free, Model
from mazeplan.diagnosis.engine.windows import Point
from mazeplan.physics.effect import INPUT

SAME = 0.02  # share of a candidate's influence that other fitted numbers cannot copy
KEPT = 2  # candidates that are fitted at all lengths
FEWER = 0.5  # of the gain of a candidate that is accepted; one that gains less is not fitted at all lengths
MOST = 5  # effects
LIKELY = 5  # effects that are tried in pairs
FIRST = 0.003  # of its scale: where the fit of a candidate starts
Tried = dict[str, tuple[float, str]]  # candidates that were not taken: gain, and why not


@dataclass(frozen=True)
class Finding:
    """The result of a search."""

    base: Trial  # without what was found
    final: Trial  # and with it
    found: tuple[str, ...]  # names of effects in the order in which they were found
    alike: tuple[tuple[str, ...], ...]  # groups of names that the record cannot tell apart
    tried: Tried
    gains: dict[str, float]
    valid: tuple[int, ...]  # levels that could be judged
    levels: tuple[Level, ...]


class Search:
    """One search. known: declared values; along: names of effects that are fitted in every model"""

    def __init__(self, model: Model, known: Values, along: Sequence[str], tell: Words) -> None:
        self.model, self.known, self.tell = model, known, tell
        self.always = tuple(dict.fromkeys([model.system.motion.name, *known, *along]))
        self.judge = Judge(model)
        self.levels = self.judge.levels
        self.cache: dict[frozenset[str], Trial] = {}
        self.likely: list[str] = []  # those that explain most alone
        self.rivals: dict[str, set[str]] = {}  # of an effect that was taken: those that explained nearly as much

    def values(self, names: Sequence[str], like: Values | None = None, at_rest: bool = False) -> Values:
        """Start values of a model: those of another model where it has them, else small ones (at_rest: no effect)."""
        out: Values = {}
        for name in names:
            effect = self.model.effects[name]
            own = {n: p.default for n, p in effect.parameters.items()}
            if effect.places:
                own |= dict(zip(effect.parameters, (effect.starts or ((),))[0], strict=False))
            for n, p in effect.parameters.items() if not (at_rest or name in self.always) else ():
                if not (p.fixed or n in effect.places or (effect.acts == INPUT and n == "factor")):
                    own[n] = min(p.default + FIRST * self.model.scale[name, n], p.high)
            out[name] = {**(own if like is None or name not in like else like[name]), **self.known.get(name, {})}
        return out

    def free(self, names: Sequence[str]) -> Free:
        """Parameters that are fitted: neither known nor fixed."""
        numbers = ((name, n, p) for name in names for n, p in self.model.effects[name].parameters.items())
        return tuple((name, n) for name, n, p in numbers if not p.fixed and n not in self.known.get(name, {}))

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
                    ends = self.model.simulate(fit.values, windows.windows, fit.states)  # where the others begin
                    test = other.held_out(fit.values, other.states_on(track), other.states_on(ends))
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
        tried = Tried()
        library = [e.name for e in self.model.system.effects if e.name not in self.always]
        for name in [name for name in library if self.redundant(base, name)]:
            library.remove(name)
            tried[name] = (0.0, "the fitted numbers of the motion can do the same")
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
        current, found = self._otherwise(base, current, found, library, gains)
        if found and self.judge.leaves_most(base, current):
            tried |= {name: (gains.pop(name, 0.0), LEAVES_MOST) for name in found}
            current, found = base, []
        valid = tuple(self.judge.valid(base, current))
        alike = self._alike(current, found, library)
        for name in found:
            tried.pop(name, None)
        return Finding(base, current, tuple(found), alike, tried, gains, valid, self.levels)

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

    def _round(self, current: Trial, candidates: Sequence[str], tried: Tried) -> list[tuple[Trial, float]]:
        """Trials of the candidates that are accepted, the best first."""
        scored = []
        which = sorted({0, len(self.levels) // 2})
        for name in candidates:
            self.tell(f"trying {name}")
            quick = self._fitted((*current.names, name), current, which, (0,))
            gain = sum(
                gain_of(current.fits[level][0].cost, quick.fits[i][0].cost, quick.fits[i][0].count, 1.0).mean()
                for i, level in enumerate(which)
            )
            scored.append((gain, name))
        scored.sort(reverse=True)
        self.likely = self.likely or [name for _, name in scored[:LIKELY]]
        near = {name for score, name in scored if score >= FEWER * scored[0][0]}
        accepted: list[tuple[Trial, float]] = []
        judged = 0  # by windows of a length at least; a simulation with others leaves the record
        for score, name in scored:
            if judged == KEPT or (accepted and score < FEWER * scored[0][0]):
                tried[name] = (float(score), "others explain more")
                continue
            trial = self.trial((*current.names, name), current)
            gain, why_not = self.judge.why_not(current, trial, name)
            judged += bool(self.judge.valid(current, trial)) and why_not != DRIVES
            if why_not:
                tried[name] = (gain, why_not)
            else:
                accepted.append((trial, gain))
        order = {name: i for i, name in enumerate(candidates)}
        accepted.sort(key=lambda one: order[one[0].names[-1]])
        best, _ = max(accepted, key=lambda one: one[1], default=(current, 0.0))
        accepted.sort(key=lambda one: self.judge.clearly_better(best, one[0]))  # others in the order of the class
        if accepted:
            self.rivals[accepted[0][0].names[-1]] = near
        for trial, gain in accepted[1:]:
            tried[trial.names[-1]] = (gain, f"{accepted[0][0].names[-1]} explains more")
        return accepted

    def _otherwise(
        self, base: Trial, current: Trial, found: list[str], library: Sequence[str], gains: dict[str, float]
    ) -> tuple[Trial, list[str]]:
        """One effect instead of several that explain no more; or two together that alone show nothing, but explain
        what these leave."""
        if len(found) > 1:
            for name in sorted(self.rivals.get(found[0], set()) - set(found)):
                one = self.trial((name,), base)
                gain, why_not = self.judge.why_not(base, one, name)
                if not why_not and not self.judge.clearly_better(current, one):
                    gains[name] = gain
                    return one, [name]
        valid = self.judge.valid(base, current)
        if not valid or self.judge.explains(base, current):
            return current, found
        level = next(i for i in valid if current.usual(i) >= EXPLAINS)
        for names in combinations([name for name in self.likely if name in library], 2):
            self.tell(f"trying {' and '.join(names)}")
            if self._fitted(names, None, (level,), (0,)).fits[0][0].rms() < EXPLAINS:
                pair = self.trial(names)
                needed = {
                    name: self.judge.why_not(self.trial((other,), base), pair, name)
                    for name, other in (names, names[::-1])
                }
                if self.judge.explains(base, pair) and not any(why_not for _, why_not in needed.values()):
                    gains.update({name: gain for name, (gain, _) in needed.items()})
                    return pair, sorted(names, key=lambda name: -needed[name][0])
        return current, found

    def _backward(
        self, base: Trial, current: Trial, found: list[str], tried: Tried, gains: dict[str, float]
    ) -> tuple[Trial, list[str]]:
        """Drop effects that are no longer needed beside later ones."""
        again = len(found) > 1
        while again and found:
            again = False
            for name in list(found[:-1]):
                rest = tuple(other for other in found if other != name)
                without = self.trial(rest, current)
                gain, why_not = self.judge.why_not(without, current, name)
                if why_not:
                    tried[name] = (gain, f"beside {', '.join(rest)}: {why_not}")
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
                known = rival in self.rivals.get(name, ()) or frozenset((*rest, rival)) in self.cache
                if rival in found or not known:
                    continue
                instead = self.trial((*rest, rival), without)
                _, why_not = self.judge.why_not(without, instead, rival)
                if not why_not and not self.judge.clearly_better(current, instead):
                    group.append(rival)
            if len(group) > 1:
                groups.append(tuple(group))
        return tuple(groups)
