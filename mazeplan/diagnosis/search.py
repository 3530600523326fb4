"""Which effects are missing: forward selection with full refits, then each is put to the test of leaving it.

A candidate counts if it lowers -2 log L by more than ACCEPT beyond k log N, is larger than the smallest size worth a
word and than SURE of its standard errors; significance alone finds artefacts of milliseconds. One that, once others
have joined, is worth less than KEEP is dropped. Anonymous terms run along: where one of them explains far more than the
best named effect, something is there that has no name. So do placebos, which must lose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from mazeplan.diagnosis.fit import Fit, Likelihood, fit
from mazeplan.diagnosis.screening import ACCEPT, Trial, price, promising, swinging, try_one
from mazeplan.diagnosis.system import Values
from mazeplan.physics.effect import Effect

KEEP = 10.0  # of -2 log L
ALIKE = 15.0  # of -2 log L: two candidates that explain equally well to within this cannot be told apart
NEAR = 0.1  # share of the best one's; candidates that come so near are compared with the stage fitted along
AHEAD = 1.15  # an unnamed term must explain so many times what the best named one does, to be looked at
MOST = 5  # effects
SHARE = 0.05  # an unnamed term must bring this share of what named effects brought: they are not exact either


@dataclass(frozen=True)
class Finding:
    """base: without anything added; final: with all that was found; ranked: trials of the first round, the best first;
    alike: groups of names that cannot be told apart; unknown: an unnamed term that was accepted; plainer: what `final`
    was before some of it was said in finer words, where it was."""

    base: Fit
    final: Fit
    ranked: tuple[Trial, ...]
    alike: tuple[tuple[str, ...], ...]
    unknown: Trial | None
    worth: dict[str, float]
    plainer: Fit | None = None


def search(
    likelihood: Likelihood,
    library: Sequence[Effect],
    tell: Callable[[str], None],
    *,
    free: Sequence[Effect] = (),
    along: Sequence[Effect] = (),
    most: int = MOST,
    start: Values | None = None,
) -> Finding:
    """What is missing from the declared model; free: what is known to be there and fitted in every fit; along: what the
    tilt sensor leaves open of the stage, fitted where it is decided; most: effects that are added; start:
    values of what is free, where they are about known."""
    return _Search(likelihood, library, tell, free, along).run(most, start or {})


class _Search:
    """One search. Rounds hold the stage, which saves most of the time; what a round would accept is confirmed with the
    stage fitted along, since the ball feels errors of it that the tilt sensor does not see."""

    def __init__(
        self, likelihood: Likelihood, library: Sequence[Effect], tell: Callable[[str], None],
        free: Sequence[Effect], along: Sequence[Effect],
    ) -> None:  # fmt: skip
        self._likelihood, self._library, self._tell = likelihood, list(library), tell
        self._free, self._along = list(free), list(along)
        self._declared = likelihood.system.declared
        self._loose: dict[int, Fit] = {}
        self._kept: list[Fit] = []  # alive, so that no other takes their place among the keys

    def run(self, most: int, known: Values) -> Finding:
        """Rounds until nothing more is believed, or so many effects were added."""
        start = {c.name: dict(zip(c.parameters, c.first()[0], strict=True)) for c in self._free}
        start |= known
        current = base = fit(self._likelihood, self._free, start)
        ranked: tuple[Trial, ...] = ()
        alike: list[tuple[str, ...]] = []
        unknown: Trial | None = None
        while len(current.candidates) < most + len(self._free):
            trials = self._trials(current)
            ranked = ranked or tuple(trials)
            named, nameless, group = self._choice(current, trials, base.minus2 - current.minus2)
            if nameless is not None:
                unknown, current = nameless, nameless.fit
                break
            if named is None:
                break
            if len(group) > 1:
                alike.append(group)
            current = named.fit
            self._library = [c for c in self._library if c is not named.candidate]
            self._tell(f"{named.candidate.name}: -2 log L falls by {named.raw:.0f}")
        current, worth = self._drop(self._exchange(current))
        return Finding(base, self._with_stage(current), ranked, tuple(alike), unknown, worth)

    def _open(self, current: Fit) -> list[Effect]:
        """What can be added: not what is there already in other words."""
        there = {c.name for c in current.candidates}
        return [c for c in self._library if not there.intersection(c.rivals)]

    def _trials(self, current: Fit) -> list[Trial]:
        """One more candidate each, the best first."""
        self._tell("screening")
        trials = []
        ready = list(promising(self._likelihood, current, self._open(current)))
        for number, (c, start) in enumerate(ready, start=1):
            self._tell(f"trying {c.name}, {number} of {len(ready)}")
            trials.append(try_one(self._likelihood, current, c, start))
        if self._likelihood.noisy:  # else neighbours have much in common, and a spectrum tells that alone
            trials.append(swinging(self._likelihood, current))
        return sorted(trials, key=lambda t: -t.gain)

    def _choice(
        self, current: Fit, trials: Sequence[Trial], explained: float
    ) -> tuple[Trial | None, Trial | None, tuple[str, ...]]:
        """(The named candidate to accept, the unnamed one, the names of those that explain as well as the named)."""
        chance = max((t.gain for t in trials if t.candidate.placebo), default=-math.inf)
        sure = [t for t in trials if t.sure(self._declared) and t.gain > chance + ACCEPT and not t.candidate.placebo]
        best = max((t.raw for t in sure if t.candidate.named), default=0.0)
        close = [t for t in sure if t.candidate.named and t.raw > best - max(ALIKE, NEAR * best)]
        named = [t for t in (self._confirmed(current, t) for t in close) if t.sure(self._declared)]
        named.sort(key=lambda t: -t.gain)
        first = named[0] if named else None
        nameless = next((t for t in sure if not t.candidate.named), None)
        patient = not self._likelihood.noisy and first is not None  # many effects are at work: first all with a name
        if nameless is not None and not patient and (first is None or self._ahead(nameless, first)):
            loose = self._confirmed(current, nameless)
            if loose.sure(self._declared) and loose.gain > SHARE * explained:
                return None, nameless, ()
        if first is None:
            return None, None, ()
        alike = (t.candidate.name for t in named if t.raw > first.raw - ALIKE)
        return first, None, tuple(name for name in alike if name not in first.candidate.rivals)

    def _ahead(self, nameless: Trial, first: Trial) -> bool:
        """Whether an unnamed term explains more than the best named candidate and any second one beside it: of two
        effects at once either leaves much, and an unnamed term may take a share of both."""
        if nameless.gain <= AHEAD * first.gain + ACCEPT:
            return False
        others = [c for c in self._library if c.named and c is not first.candidate]
        trials = (try_one(self._likelihood, first.fit, c, s) for c, s in promising(self._likelihood, first.fit, others))
        second = max((t.gain for t in trials if t.sure(self._declared)), default=0.0)
        return nameless.gain > first.gain + second - ACCEPT

    def _confirmed(self, current: Fit, trial: Trial) -> Trial:
        """The trial with gain and standard errors as they are with the stage fitted along; its fit else as it was."""
        if not self._along:
            return trial
        loose = self._with_stage(trial.fit)
        raw = self._with_stage(current).minus2 - loose.minus2
        held = replace(trial.fit, stderr={**trial.fit.stderr, **loose.stderr})
        return replace(trial, fit=held, raw=raw, gain=raw - (trial.raw - trial.gain))

    def _with_stage(self, found: Fit) -> Fit:
        """The fit with what the tilt sensor leaves open of the stage fitted along."""
        if not self._along:
            return found
        if id(found) not in self._loose:
            zero = {c.name: dict.fromkeys(c.parameters, 0.0) for c in self._along}
            self._loose[id(found)] = fit(
                self._likelihood, [*self._along, *found.candidates], {**zero, **found.values}, found.q
            )
            self._kept.append(found)
        return self._loose[id(found)]

    def _exchange(self, current: Fit) -> Fit:
        """The first effect that was accepted also took a share of those that came later. Each is exchanged for
        another, were it only now accepted, that explains more for its parameters."""
        mine = [c for c in current.candidates if c not in self._free and c.named]
        for c in mine if len(mine) > 1 else []:
            rest = [x for x in current.candidates if x is not c]
            without = fit(self._likelihood, rest, {x.name: current.values[x.name] for x in rest}, current.q)
            self._tell(f"exchanging {c.name}")
            others = promising(self._likelihood, without, [x for x in self._open(without) if x.named])
            trials = [try_one(self._likelihood, without, x, start) for x, start in others]
            best = max((t for t in trials if t.sure(self._declared)), key=lambda t: t.gain, default=None)
            if best is not None and best.gain > without.minus2 - current.minus2 - price(self._likelihood, c):
                self._library = [x for x in self._library if x is not best.candidate]
                current = best.fit
        return current

    def _drop(self, current: Fit) -> tuple[Fit, dict[str, float]]:
        """Leave out what is worth too little now; by how much each of the others is worth."""
        while True:
            worth: dict[str, float] = {}
            for c in current.candidates:
                if c in self._free:
                    continue
                rest = [x for x in current.candidates if x is not c]
                without = fit(self._likelihood, rest, {x.name: current.values[x.name] for x in rest}, current.q)
                worth[c.name] = without.minus2 - current.minus2 - price(self._likelihood, c)
            weakest = min(worth, key=lambda name: worth[name], default=None)
            if weakest is None or worth[weakest] >= KEEP:
                return current, worth
            rest = [x for x in current.candidates if x.name != weakest]
            current = fit(self._likelihood, rest, {x.name: current.values[x.name] for x in rest}, current.q)
