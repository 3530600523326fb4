"""Candidates of one round of the search: which ones get a full fit, and what each fit gains."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from mazeplan.diagnosis.effect_entry import Values
from mazeplan.diagnosis.ring.fit import Fit, Likelihood, fit, forecast
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


@dataclass(frozen=True)
class CandidateTrial:
    """A candidate, tried together with the accepted effects.

    fit: of the candidate and the accepted effects
    gain: fall of -2 log L minus the price of the candidate's parameters
    raw: fall of -2 log L
    strength: root mean square acceleration over WEAKEST, for a term without a smallest size"""

    candidate: Effect
    fit: Fit
    gain: float
    raw: float
    strength: float = math.inf

    def sure(self, declared: Values) -> bool:
        """Whether the candidate is accepted: by its gain, its standard errors and its size."""
        if not self.gain > ACCEPT:
            return False
        c, values, stderr = self.candidate, self.fit.values[self.candidate.name], self.fit.stderr[self.candidate.name]
        had = declared.get(c.name, {})
        certain = any(
            abs(values[n] - had.get(n, spec.default)) > SURE * stderr[n]
            for n, spec in c.parameters.items()
            if n not in c.places
        )
        return certain and c.size(values, had) >= 1.0 and self.strength >= 1.0


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
            scores = [
                likelihood.minus2({**current.values, c.name: dict(zip(names, v, strict=True))}, current.q)
                for v in starts
            ]
            starts = [starts[int(np.argmin(scores))]]
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
    raw = current.minus2 - found.minus2
    return CandidateTrial(
        c, found, raw - price(likelihood, c), raw, math.inf if c.named else _strength(likelihood, current, found)
    )


def _strength(likelihood: Likelihood, current: Fit, found: Fit) -> float:
    """Root mean square of the change that a fit makes on its rows, in multiples of WEAKEST."""
    _, states = likelihood.everywhere(found.values, found.q)
    after, before = (
        accelerations(*likelihood.system.build(likelihood.library, values), states[:, 0].copy(), states[:, 1].copy())
        for values in (found.values, current.values)
    )
    return float(np.sqrt(np.mean((after - before)[likelihood.rows] ** 2)) / WEAKEST)


def swinging(likelihood: Likelihood, current: Fit) -> CandidateTrial:
    """A force that swings with time, at the highest peak in the spectrum of the whitened residual."""
    e = likelihood.whitened(current.values, current.q)
    power = np.abs(np.fft.rfft(e - e.mean())) ** 2 / max(len(e) * float(np.var(e)), 1e-300)
    frequency = np.fft.rfftfreq(len(e), likelihood.system.dt)
    k = int(np.argmax(power[1:])) + 1
    c = oscillation(Parameter("rad/s^2", 0.0, -50.0, 50.0, SWING, 1e-3))
    if power[k] < PEAK:
        return CandidateTrial(c, current, -math.inf, 0.0)
    start = {**current.values, c.name: {"frequency": float(frequency[k]), "cos": 0.05, "sin": 0.05}}
    likelihood.add(c)
    return try_one(likelihood, current, c, start[c.name])
