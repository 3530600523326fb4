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
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from mazeplan.core.progress import Words
from mazeplan.diagnosis.document import Values
from mazeplan.diagnosis.ring.fit import Fit, Likelihood, fit, fit_without, forecast, start_of
from mazeplan.diagnosis.ring.kalman import accelerations
from mazeplan.physics.effect import OPENING, Effect, Parameter
from mazeplan.physics.effects.nameless import oscillation

ACCEPT = 15.0  # minimum gain of -2 log L, after the price
SURE = 3.0  # minimum change, in standard errors
NAMED, NAMELESS = 6, 2  # candidates that get a full fit in each round
MORE = 7  # named candidates that get a full fit in a record of a real rig, where many effects act at once
ANGLES = 90  # tried angles of an opening
WEAKEST = 0.08  # rad/s^2; minimum root mean square of a term without a smallest size
SWING = 1.25 * WEAKEST  # smallest amplitude of a force that swings with time
PEAK = 18.0  # minimum peak of the periodogram over its mean: 1e-8 by chance in a frequency, 1e-4 in a record
KEEP = 10.0  # minimum gain of -2 log L by an effect beside the others, after its price
ALIKE = 15.0  # of -2 log L: two candidates whose gains differ by less cannot be told apart
NEAR = 0.1  # share of the best gain; candidates this near to the best are compared with the stage fitted as well
AHEAD = 1.15  # minimum gain of a term without a name, over that of the best named candidate, to look at the term
MOST = 5  # maximum number of effects
MANY = 10  # in a record of a real rig, where many act at once
FAR = 0.2  # error of a tilt sensor's scale beyond which other causes are likely
SAME = 0.03  # relative difference up to which two scales count as equal; their standard errors may allow more
SHARE = 0.05  # minimum gain of a term without a name, over that of the named effects: these are not exact either


@dataclass(frozen=True)
class CandidateTrial:
    """A candidate, tried together with the accepted effects."""

    candidate: Effect
    fit: Fit  # of the candidate and the accepted effects
    gain: float  # fall of -2 log L minus the price of the candidate's parameters
    raw: float  # fall of -2 log L
    strength: float = math.inf  # root mean square acceleration over WEAKEST, for a term without a smallest size

    def sure(self, declared: Values) -> bool:
        """Whether the candidate is accepted: by its gain, its standard errors and its size."""
        if not self.gain > ACCEPT:
            return False
        c, values, stderr = self.candidate, self.fit.values[self.candidate.name], self.fit.stderr[self.candidate.name]
        had = declared.get(c.name, {})
        sizes = {n: spec.default for n, spec in c.parameters.items() if n not in c.places}
        certain = any(abs(values[n] - had.get(n, usual)) > SURE * stderr[n] for n, usual in sizes.items())
        return certain and c.size(values, had) >= 1.0 and self.strength >= 1.0


@dataclass(frozen=True)
class Finding:
    """The result of a search."""

    final: Fit  # with the effects that were found
    ranked: tuple[CandidateTrial, ...]  # trials of the first round, the best first
    alike: tuple[tuple[str, ...], ...]  # groups of names that the record cannot tell apart
    unknown: CandidateTrial | None  # the accepted term without a name
    worth: dict[str, float]  # gain of -2 log L by each effect, minus its price


def still_alike(groups: Sequence[tuple[str, ...]], found: Container[str]) -> tuple[tuple[str, ...], ...]:
    """Groups of alike names whose first one was found in the end, without the others that were found beside it.

    An effect that was found later could be told apart."""
    kept = ((first, *(name for name in others if name not in found)) for first, *others in groups if first in found)
    return tuple(group for group in kept if len(group) > 1)


def confounded_effects(values: Values, stderr: Values) -> list[tuple[str, ...]]:
    """Groups of effects that look nearly the same at the sizes that were found.

    A sensor with the same large scale on both axes looks like a ball that accelerates less because it rolls. Only the
    rotation of the plate tells them apart, and the effect of this rotation on a rolling ball is hardly known."""
    if "tilt_gain" not in values or "rolling_inertia" in values:
        return []
    (beta, gamma), errors = values["tilt_gain"].values(), stderr["tilt_gain"].values()
    same = abs(beta - gamma) <= max(SAME * 0.5 * (beta + gamma), SURE * math.hypot(*errors))
    far = min(abs(beta - 1.0), abs(gamma - 1.0)) > FAR
    return [("tilt_gain", "rolling_inertia")] if same and far else []


class Search:
    """A search for what the declared model lacks.

    Rounds hold the stage fixed, which saves most of the time. Before a candidate is accepted, the stage is fitted as
    well, because the ball feels errors of the stage that the tilt sensor does not see.

    tell: reports progress; free: effects that exist and are part of every fit; nuisance: errors of the stage"""

    def __init__(
        self, likelihood: Likelihood, library: Sequence[Effect], tell: Words,
        free: Sequence[Effect] = (), nuisance: Sequence[Effect] = (),
    ) -> None:  # fmt: skip
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
        ranked, alike, unknown = tuple[CandidateTrial, ...](), list[tuple[str, ...]](), None
        while len(current.candidates) < most:
            trials = self._trials(current)
            ranked = ranked or tuple(trials)
            named, unknown, group = self._choice(current, trials, base.minus2 - current.minus2)
            if named is None:
                current = current if unknown is None else unknown.fit
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
        for c, start in promising(self._likelihood, current, self._open(current)):
            self._tell(f"trying {c.name}")
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
            mine = [c for c in current.candidates if c not in self._free]
            fits = {c.name: fit_without(self._likelihood, current, c) for c in mine}
            worth = {c.name: fits[c.name].minus2 - current.minus2 - price(self._likelihood, c) for c in mine}
            weakest = min(worth, key=lambda name: worth[name], default=None)
            if weakest is None or worth[weakest] >= KEEP:
                return current, worth
            current = fits[weakest]


def promising(likelihood: Likelihood, current: Fit, library: Sequence[Effect]) -> list[tuple[Effect, dict[str, float]]]:
    """The candidates to fit in full, with their start values. The gain of one linear step decides.

    These are the best candidates with a name, the best without a name, and the best placebo."""
    found: list[tuple[float, Effect, dict[str, float]]] = []
    for c in library:
        names, declared = list(c.parameters), likelihood.system.declared.get(c.name)
        starts = [tuple(declared[n] for n in names)] if declared and not c.starts else c.first_guesses()
        if c.acts == OPENING and "angle" in c.parameters and len(starts) > 1:
            starts = [_gate_start(likelihood, current, c, starts[0][-1])]
        if len(starts) > 1:  # compare the start values without a fit, with both signs of the last parameter
            low = list(c.parameters.values())[-1].low
            starts = [(*v[:-1], sign * v[-1]) for v in starts for sign in (1.0, -1.0) if sign * v[-1] >= low]
            ways = [{**current.values, c.name: dict(zip(names, v, strict=True))} for v in starts]
            starts = [starts[int(np.argmin([likelihood.minus2(values, current.q) for values in ways]))]]
        start = dict(zip(names, starts[0], strict=True))
        found.append((forecast(likelihood, current, c, start) - price(likelihood, c), c, start))
    found.sort(key=lambda entry: -entry[0])
    named = [entry for entry in found if entry[1].named and entry[0] > 0.0]
    named = named[: NAMED if likelihood.noisy else MORE]
    nameless = [entry for entry in found if not entry[1].named and not entry[1].placebo and entry[0] > 0.0][:NAMELESS]
    chance = [entry for entry in found if entry[1].placebo][:1]
    return [(c, start) for _, c, start in named + nameless + chance]


def _gate_start(likelihood: Likelihood, current: Fit, c: Effect, loss: float) -> tuple[float, float]:
    """(angle, loss) at which the fit of an opening starts.

    One linear step for openings all around the ring finds the angle that explains most."""
    angles = np.linspace(-math.pi, math.pi, ANGLES, endpoint=False)
    openings = [replace(c, name=f"{c.name} {i}") for i in range(ANGLES)]
    closed = {g.name: {"angle": float(a), "loss": 0.0} for g, a in zip(openings, angles, strict=True)}
    wide = copy(likelihood)
    wide.library = [*likelihood.library, *openings]
    steps = [(g.name, "loss", c.parameters["loss"].step) for g in openings]
    e, J = wide.jacobian({**current.values, **closed}, current.q, steps)
    slopes = J.T @ e  # negative where a loss lowers the squared residuals
    worth = np.where(slopes < 0.0, slopes**2 / np.maximum(np.sum(J * J, axis=0), 1e-300), 0.0)
    return float(angles[int(np.argmax(worth))]), loss


def price(likelihood: Likelihood, c: Effect) -> float:
    """Price of a candidate's k parameters, in -2 log L: k log N."""
    return len(c.parameters) * math.log(max(float(likelihood.rows.sum()) / likelihood.repeats, 2.0))


def try_one(likelihood: Likelihood, current: Fit, c: Effect, start: dict[str, float]) -> CandidateTrial:
    """Fit the candidate together with the accepted effects, all of them free."""
    found = fit(likelihood, [*current.candidates, c], {**current.values, c.name: start}, current.q)
    raw, strength = current.minus2 - found.minus2, math.inf
    if not c.named:
        _, states = likelihood.everywhere(found.values, found.q)
        x, v = states[:, 0].copy(), states[:, 1].copy()
        problems = (likelihood.system.build(likelihood.library, values) for values in (found.values, current.values))
        after, before = (accelerations(problem, p, x, v) for problem, p in problems)
        strength = float(np.sqrt(np.mean((after - before)[likelihood.rows] ** 2)) / WEAKEST)
    return CandidateTrial(c, found, raw - price(likelihood, c), raw, strength)


def swinging(likelihood: Likelihood, current: Fit) -> CandidateTrial:
    """A force that swings with time, at the highest peak in the spectrum of the whitened residual."""
    e = likelihood.whitened(current.values, current.q)
    power = np.abs(np.fft.rfft(e - e.mean())) ** 2 / max(len(e) * float(np.var(e)), 1e-300)
    frequency = np.fft.rfftfreq(len(e), likelihood.system.dt)
    k = int(np.argmax(power[1:])) + 1
    c = oscillation(Parameter("rad/s^2", 0.0, -50.0, 50.0, SWING, 1e-3))
    if power[k] < PEAK:
        return CandidateTrial(c, current, -math.inf, 0.0)
    likelihood.add(c)
    return try_one(likelihood, current, c, {"frequency": float(frequency[k]), "cos": 0.05, "sin": 0.05})
