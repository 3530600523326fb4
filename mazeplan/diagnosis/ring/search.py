"""The search for missing effects: forward selection with full refits, then a test of each effect without it.

A candidate with k parameters is accepted if

    it lowers -2 log L by more than ACCEPT + k log N,
    it is larger than its smallest size: significance alone finds artefacts of milliseconds,
    it is larger than SURE standard errors.

An effect that gains less than KEEP beside the later ones is dropped. Terms without a name take part. Such a term is
reported as unknown if it explains far more than the best named effect. Placebos take part, too, and must lose.
"""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass, replace

from mazeplan.core.progress import Words
from mazeplan.diagnosis.effect_entry import Values
from mazeplan.diagnosis.ring.fit import Fit, Likelihood, fit, fit_without, start_of
from mazeplan.diagnosis.ring.screening import ACCEPT, CandidateTrial, price, promising, swinging, try_one
from mazeplan.physics.effect import Effect

KEEP = 10.0  # minimum gain of -2 log L by an effect beside the others, after its price
ALIKE = 15.0  # of -2 log L: two candidates whose gains differ by less cannot be told apart
NEAR = 0.1  # share of the best gain; candidates this near to the best are compared with the stage fitted as well
AHEAD = 1.15  # minimum gain of a term without a name, over that of the best named candidate, to look at the term
MOST = 5  # maximum number of effects
MANY = 10  # in a record of a real rig, where many act at once
SHARE = 0.05  # minimum gain of a term without a name, over that of the named effects: these are not exact either


@dataclass(frozen=True)
class Finding:
    """The result of a search.

    final: the fit with the effects that were found
    ranked: trials of the first round, the best first
    alike: groups of names that the record cannot tell apart
    unknown: the accepted term without a name
    worth: gain of -2 log L by each effect, minus its price"""

    final: Fit
    ranked: tuple[CandidateTrial, ...]
    alike: tuple[tuple[str, ...], ...]
    unknown: CandidateTrial | None
    worth: dict[str, float]


def still_alike(groups: Sequence[tuple[str, ...]], found: Container[str]) -> tuple[tuple[str, ...], ...]:
    """Groups of alike names whose first one was found in the end, without the others that were found beside it.

    An effect that was found later could be told apart."""
    kept = ((first, *(name for name in others if name not in found)) for first, *others in groups if first in found)
    return tuple(group for group in kept if len(group) > 1)


class Search:
    """A search for what the declared model lacks.

    Rounds hold the stage fixed, which saves most of the time. Before a candidate is accepted, the stage is fitted as
    well, because the ball feels errors of the stage that the tilt sensor does not see."""

    def __init__(
        self, likelihood: Likelihood, library: Sequence[Effect], tell: Words,
        free: Sequence[Effect] = (), nuisance: Sequence[Effect] = (),
    ) -> None:  # fmt: skip
        """tell: reports progress
        free: effects that exist and are part of every fit
        nuisance: errors of the stage, which are fitted as well before a decision"""
        self._likelihood, self._library, self._tell = likelihood, list(library), tell
        self._free, self._nuisance = list(free), list(nuisance)
        self._declared = likelihood.system.declared
        self._loose: dict[int, tuple[Fit, Fit]] = {}  # id of a fit -> the fit itself, and the fit with the stage
        self._instead: dict[str, str] = {}  # name of an effect -> name of the one that took its place

    def run(self, known: Values | None = None) -> Finding:
        """Add effects until no further one is accepted. known: start values of effects that exist, if known"""
        most = (MOST if self._likelihood.noisy else MANY) + len(self._free)
        start = {c.name: start_of(c) for c in self._free} | (known or {})
        current = base = fit(self._likelihood, self._free, start)
        ranked: tuple[CandidateTrial, ...] = ()
        alike: list[tuple[str, ...]] = []
        unknown: CandidateTrial | None = None
        while len(current.candidates) < most:
            trials = self._trials(current)
            ranked = ranked or tuple(trials)
            named, unknown, group = self._choice(current, trials, base.minus2 - current.minus2)
            if unknown is not None:
                current = unknown.fit
                break
            if named is None:
                break
            if len(group) > 1:
                alike.append(group)
            current = self._taken(named)
            self._tell(f"{named.candidate.name}: -2 log L falls by {named.raw:.0f}")
        current, worth = self._drop(self._exchange(current))
        alike = [self._renamed(group) for group in alike]
        return Finding(self._with_stage(current), ranked, still_alike(alike, current.values), unknown, worth)

    def _taken(self, trial: CandidateTrial) -> Fit:
        """The fit with an accepted candidate, which leaves the library."""
        self._library = [c for c in self._library if c is not trial.candidate]
        return trial.fit

    def _open(self, current: Fit) -> list[Effect]:
        """Candidates that no accepted effect excludes."""
        there = {c.name for c in current.candidates}
        return [c for c in self._library if not there.intersection(c.rivals)]

    def _trials(self, current: Fit) -> list[CandidateTrial]:
        """Each promising candidate beside the accepted ones, the best first."""
        self._tell("screening")
        trials = []
        ready = list(promising(self._likelihood, current, self._open(current)))
        for number, (c, start) in enumerate(ready, start=1):
            self._tell(f"trying {c.name}, {number} of {len(ready)}")
            trials.append(try_one(self._likelihood, current, c, start))
        if self._likelihood.noisy:  # otherwise neighbouring residuals share samples, which shapes their spectrum
            trials.append(swinging(self._likelihood, current))
        return sorted(trials, key=lambda t: -t.gain)

    def _choice(
        self, current: Fit, trials: Sequence[CandidateTrial], explained: float
    ) -> tuple[CandidateTrial | None, CandidateTrial | None, tuple[str, ...]]:
        """The candidate to accept: with a name, or without one; and names that explain the record as well."""
        chance = max((t.gain for t in trials if t.candidate.placebo), default=-math.inf)
        sure = [t for t in trials if t.sure(self._declared) and t.gain > chance + ACCEPT and not t.candidate.placebo]
        best = max((t.raw for t in sure if t.candidate.named), default=0.0)
        close = [t for t in sure if t.candidate.named and t.raw > best - max(ALIKE, NEAR * best)]
        named = [t for t in (self._confirmed(current, t) for t in close) if t.sure(self._declared)]
        named.sort(key=lambda t: -t.gain)
        first = named[0] if named else None
        nameless = next((t for t in sure if not t.candidate.named), None)
        patient = not self._likelihood.noisy and first is not None  # many effects act: those with a name come first
        if nameless is not None and not patient and (first is None or self._ahead(nameless, first)):
            loose = self._confirmed(current, nameless)
            if loose.sure(self._declared) and loose.gain > SHARE * explained:
                return None, nameless, ()
        if first is None:
            return None, None, ()
        alike = (t.candidate.name for t in named if t.raw > first.raw - ALIKE)
        return first, None, tuple(name for name in alike if name not in first.candidate.rivals)

    def _ahead(self, nameless: CandidateTrial, first: CandidateTrial) -> bool:
        """Whether a term without a name explains more than the best named candidate together with any second one.

        If two effects are missing, a term without a name may take a share of both."""
        if nameless.gain <= AHEAD * first.gain + ACCEPT:
            return False
        others = [c for c in self._library if c.named and c is not first.candidate]
        trials = (try_one(self._likelihood, first.fit, c, s) for c, s in promising(self._likelihood, first.fit, others))
        second = max((t.gain for t in trials if t.sure(self._declared)), default=0.0)
        return nameless.gain > first.gain + second - ACCEPT

    def _confirmed(self, current: Fit, trial: CandidateTrial) -> CandidateTrial:
        """The trial, with gain and standard errors from fits that include the stage. Its values stay."""
        if not self._nuisance:
            return trial
        loose = self._with_stage(trial.fit)
        raw = self._with_stage(current).minus2 - loose.minus2
        held = replace(trial.fit, stderr={**trial.fit.stderr, **loose.stderr})
        return replace(trial, fit=held, raw=raw, gain=raw - (trial.raw - trial.gain))

    def _with_stage(self, found: Fit) -> Fit:
        """The fit, repeated with the stage fitted as well."""
        if not self._nuisance:
            return found
        if id(found) not in self._loose:
            start = {c.name: dict.fromkeys(c.parameters, 0.0) for c in self._nuisance} | found.values
            self._loose[id(found)] = found, fit(self._likelihood, [*self._nuisance, *found.candidates], start, found.q)
        return self._loose[id(found)][1]

    def _exchange(self, current: Fit) -> Fit:
        """Exchange effects: the first effect also took a share of later ones, so another one may now explain more."""
        mine = [c for c in current.candidates if c not in self._free and c.named]
        for c in mine if len(mine) > 1 else []:
            without = fit_without(self._likelihood, current, c)
            self._tell(f"exchanging {c.name}")
            others = promising(self._likelihood, without, [x for x in self._open(without) if x.named])
            trials = [try_one(self._likelihood, without, x, start) for x, start in others]
            best = max((t for t in trials if t.sure(self._declared)), key=lambda t: t.gain, default=None)
            if best is not None and best.gain > without.minus2 - current.minus2 - price(self._likelihood, c):
                current, self._instead[c.name] = self._taken(best), best.candidate.name
        return current

    def _renamed(self, group: tuple[str, ...]) -> tuple[str, ...]:
        """The group behind the effect that took the place of its first one, if both are alike."""
        taken = self._instead.get(group[0])
        return (taken, *(name for name in group if name != taken)) if taken in group else group

    def _drop(self, current: Fit) -> tuple[Fit, dict[str, float]]:
        """Drop effects that gain too little beside the others. Returns the fit and the gains of the remaining effects,
        minus their prices."""
        while True:
            fits = {
                c.name: fit_without(self._likelihood, current, c) for c in current.candidates if c not in self._free
            }
            gains = {name: without.minus2 - current.minus2 for name, without in fits.items()}
            worth = {c.name: gains[c.name] - price(self._likelihood, c) for c in current.candidates if c.name in gains}
            weakest = min(worth, key=lambda name: worth[name], default=None)
            if weakest is None or worth[weakest] >= KEEP:
                return current, worth
            current = fits[weakest]
