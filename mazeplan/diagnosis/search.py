"""Which effects are missing: forward selection with full refits, then each is put to the test of leaving it.

A candidate counts if it lowers -2 log L by more than ACCEPT beyond k log N, is larger than the smallest size worth a
word and than SURE of its standard errors; significance alone finds artefacts of milliseconds. One that, once others
have joined, is worth less than KEEP is dropped. Anonymous terms run along: where one of them explains far more than the
best named effect, something is there that has no name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mazeplan.diagnosis.fit import Fit, Likelihood, fit, forecast
from mazeplan.diagnosis.kalman import accelerations
from mazeplan.diagnosis.library import Candidate, Spec
from mazeplan.diagnosis.ringsystem import Values
from mazeplan.diagnosis.terms import oscillation

ACCEPT, KEEP = 15.0, 10.0  # of -2 log L
SURE = 3.0  # standard errors
ALIKE = 15.0  # of -2 log L: two candidates that explain equally well to within this cannot be told apart
AHEAD = 1.15  # an unnamed term must explain so many times what the best named one does
MOST = 5  # effects
NAMED, NAMELESS = 4, 2  # candidates that get a full fit in each round
MORE = 7  # named ones of a record from a real rig, in which many effects are at work at once
WEAKEST = 0.08  # rad/s^2, root mean square; an unnamed term that adds less is not worth a word ...
SHARE = 0.05  # ... nor one that brings less than this share of what named effects brought: they are not exact either
PEAK = 18.0  # of the periodogram over its mean: 1e-8 by chance in a frequency, 1e-4 in a record


@dataclass(frozen=True)
class Trial:
    """A candidate added to what was accepted: its fit, and by how much it lowered -2 log L, penalty taken off;
    strength: rad/s^2, of a term that has no smallest size of its own."""

    candidate: Candidate
    fit: Fit
    gain: float
    raw: float
    strength: float = math.inf

    def sure(self, declared: Values) -> bool:
        """Whether it is believed."""
        if not self.gain > ACCEPT:
            return False
        c, values, stderr = self.candidate, self.fit.values[self.candidate.name], self.fit.stderr[self.candidate.name]
        had = declared.get(c.name, {})
        certain = any(
            abs(values[n] - had.get(n, spec.default)) > SURE * stderr[n]
            for n, spec in c.parameters.items()
            if n not in c.places
        )
        return certain and c.size(values, had) >= 1.0 and self.strength >= WEAKEST


@dataclass(frozen=True)
class Finding:
    """base: without anything added; final: with all that was found; ranked: trials of the first round, the best first;
    alike: groups of names that cannot be told apart; unknown: an unnamed term that was accepted."""

    base: Fit
    final: Fit
    ranked: tuple[Trial, ...]
    alike: tuple[tuple[str, ...], ...]
    unknown: Trial | None
    worth: dict[str, float]


def search(
    likelihood: Likelihood, library: Sequence[Candidate], tell: Callable[[str], None], most: int = MOST
) -> Finding:
    """What is missing from the declared model, at most so many effects."""
    current = base = fit(likelihood, (), {})
    ranked: tuple[Trial, ...] = ()
    alike: list[tuple[str, ...]] = []
    unknown: Trial | None = None
    left, declared = list(library), likelihood.system.declared
    while len(current.candidates) < most:
        trials = [
            try_one(likelihood, current, c, start, tell) for c, start in _promising(likelihood, current, left, tell)
        ]
        if likelihood.noisy:  # else neighbours have much in common, and a spectrum tells that alone
            trials.append(_oscillation(likelihood, current))
        trials.sort(key=lambda t: -t.gain)
        ranked = ranked or tuple(trials)
        named = next((t for t in trials if t.candidate.named and t.sure(declared)), None)
        nameless = next((t for t in trials if not t.candidate.named and t.sure(declared)), None)
        enough = nameless is not None and nameless.gain > SHARE * (base.minus2 - current.minus2)
        patient = not likelihood.noisy and named is not None
        if nameless is not None and enough and not patient and (
            named is None or nameless.gain > AHEAD * named.gain + ACCEPT
        ):
            unknown, current = nameless, nameless.fit
            break
        if named is None:
            break
        group = [
            t.candidate.name for t in trials if t.candidate.named and t.sure(declared) and t.raw > named.raw - ALIKE
        ]
        if len(group) > 1:
            alike.append(tuple(group))
        current = named.fit
        left.remove(named.candidate)
        tell(f"{named.candidate.name}: -2 log L falls by {named.raw:.0f}")
    current, worth = _drop(likelihood, current)
    return Finding(base, current, ranked, tuple(alike), unknown, worth)


def with_stage(likelihood: Likelihood, finding: Finding, along: Sequence[Candidate]) -> Finding:
    """The finding with what the tilt sensor leaves open of the stage fitted along: values and intervals know of it.
    The search itself holds the stage, which costs a few units of -2 log L and saves most of the time."""
    final = finding.final
    zero = {c.name: dict.fromkeys(c.parameters, 0.0) for c in along}
    found = fit(likelihood, [*along, *final.candidates], {**zero, **final.values}, final.q)
    return replace(finding, final=found)


def _promising(
    likelihood: Likelihood, current: Fit, library: Sequence[Candidate], tell: Callable[[str], None]
) -> list[tuple[Candidate, dict[str, float]]]:
    """The candidates worth a full fit, with their starts: the best by one linear step, named and unnamed."""
    tell("screening")
    found: list[tuple[float, Candidate, dict[str, float]]] = []
    for c in library:
        names, declared = list(c.parameters), likelihood.system.declared.get(c.name)
        starts = [tuple(declared[n] for n in names)] if declared and not c.starts else c.first()
        if len(starts) > 1:  # held fixed first, with either sign of the last parameter
            low = list(c.parameters.values())[-1].low
            starts = [(*v[:-1], sign * v[-1]) for v in starts for sign in (1.0, -1.0) if sign * v[-1] >= low]
            scores = [
                likelihood.minus2({**current.values, c.name: dict(zip(names, v, strict=True))}, current.q)
                for v in starts
            ]
            starts = [starts[int(np.argmin(scores))]]
        start = dict(zip(names, starts[0], strict=True))
        price = len(names) * math.log(max(likelihood.rows.sum() / likelihood.repeats, 2.0))
        found.append((forecast(likelihood, current, c, start) - price, c, start))
    found.sort(key=lambda entry: -entry[0])
    named = [entry for entry in found if entry[1].named and entry[0] > 0.0][: NAMED if likelihood.noisy else MORE]
    nameless = [entry for entry in found if not entry[1].named and entry[0] > 0.0][:NAMELESS]
    return [(c, start) for _, c, start in named + nameless]


def try_one(
    likelihood: Likelihood, current: Fit, c: Candidate, start: dict[str, float], tell: Callable[[str], None]
) -> Trial:
    """The candidate together with what was accepted, all free."""
    tell(f"trying {c.name}")
    found = fit(likelihood, [*current.candidates, c], {**current.values, c.name: start}, current.q)
    raw = current.minus2 - found.minus2
    gain = raw - len(c.parameters) * math.log(max(likelihood.rows.sum() / likelihood.repeats, 2.0))
    return Trial(c, found, gain, raw, math.inf if c.named else _strength(likelihood, found, c))


def _strength(likelihood: Likelihood, found: Fit, c: Candidate) -> float:
    """Root mean square of what a term adds, rad/s^2, over the rows of the fit."""
    states, with_, without = likelihood.filtered(found.values, found.q), np.empty(0), np.empty(0)
    parts = []
    for values in (found.values, {name: v for name, v in found.values.items() if name != c.name}):
        problem, p = likelihood.system.build(likelihood.library, values)
        out = np.empty(len(states))
        accelerations(problem, p, states[:, 0].copy(), states[:, 1].copy(), out)
        parts.append(out)
    with_, without = parts
    return float(np.sqrt(np.mean((with_ - without)[likelihood.rows] ** 2)))


def _oscillation(likelihood: Likelihood, current: Fit) -> Trial:
    """A force that swings with time, at the highest peak of the whitened residual."""
    e, *_ = likelihood.whitened(current.values, current.q)
    power = np.abs(np.fft.rfft(e - e.mean())) ** 2 / max(len(e) * float(np.var(e)), 1e-300)
    frequency = np.fft.rfftfreq(len(e), likelihood.system.dt)
    k = int(np.argmax(power[1:])) + 1
    amplitude = Spec("rad/s^2", 0.0, -50.0, 50.0, 1e-3, 0.1)
    c = Candidate(
        "oscillation",
        {"frequency": Spec("Hz", 0.0, 0.0, 15.0, 1e-5), "cos": amplitude, "sin": amplitude},
        term=oscillation,
        named=False,
        depends_on=("time",),
        places=("frequency",),
    )
    if power[k] < PEAK:
        return Trial(c, current, -math.inf, 0.0)
    start = {**current.values, c.name: {"frequency": float(frequency[k]), "cos": 0.05, "sin": 0.05}}
    likelihood.add(c)
    return try_one(likelihood, current, c, start[c.name], lambda text: None)


def _drop(likelihood: Likelihood, current: Fit) -> tuple[Fit, dict[str, float]]:
    """Leave out what is worth too little now; by how much each of the others is worth."""
    worth: dict[str, float] = {}
    while True:
        worth = {}
        for c in current.candidates:
            rest = [x for x in current.candidates if x is not c]
            without = fit(likelihood, rest, {x.name: current.values[x.name] for x in rest}, current.q)
            price = len(c.parameters) * math.log(max(likelihood.rows.sum() / likelihood.repeats, 2.0))
            worth[c.name] = without.minus2 - current.minus2 - price
        weakest = min(worth, key=lambda name: worth[name], default=None)
        if weakest is None or worth[weakest] >= KEEP:
            return current, worth
        rest = [x for x in current.candidates if x.name != weakest]
        current = fit(likelihood, rest, {x.name: current.values[x.name] for x in rest}, current.q)
