"""Fits of a ball's numbers for a search: from likely beginnings, and again where small steps may have got stuck."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mazeplan.control.estimation.rigid_body_filter import BodyFilter, BodyModel
from mazeplan.control.estimation.rigid_body_fit import BodyFit, fit_body, number_of, score_search, value_of, with_values
from mazeplan.core.side_by_side import side_by_side
from mazeplan.diagnosis.rig.candidates import Candidate
from mazeplan.physics.effect import Term
from mazeplan.physics.effects.local_forces import FAMILY

NEEDED = 150.0  # minimum gain of -2 log L
HALF_GAIN_SHARE = 0.45  # share of the gain that half of a record brings
SURE = 3.5  # minimum change, in standard errors of both records, each multiplied by STDERR_SCALE
STDERR_SCALE = 2.0  # scatter of values from record to record, in standard errors of a fit
PART_S = 15.0  # length of a stretch, s
SHORT_RECORD, PART = 6000, 4000  # pictures; those of a part of a long record
SOLID, HOLLOW = 0.4, 2.0 / 3.0  # inertia over m R^2 of a solid and a hollow ball
NOISE = ("noise", "plane")  # `strike` stays fixed: it would hide walls that are elsewhere
STEPS = 8  # maximum number of steps of a fit that compares candidates
POLISH = 20  # maximum number of steps of a fit whose numbers are kept
ENOUGH = 4.0  # of -2 log L; a fit ends when a step gains less
MIN_PROCESS_NOISE = 1e-6  # m^2/s^3, minimum unexplained noise at the start of a search
NOISE_FACTORS = tuple(3.0**k for k in range(-3, 9))  # of the grid of noises
# a rescale moves all numbers away from the reference by one of these factors
RESCALE_FACTORS = (0.8, 0.9, 0.95, 1.05, 1.12, 1.25, 1.5)
MAX_AGAIN = 3  # maximum number of further fits
ROUGH = 20.0  # of -2 log L; jumps between near points (`rigid_body_fit`)
MOVABLE = ("centre", "start", "end", "x", "y", "width")  # places on the plate
NEAR_S = 2.0  # s before and after
UNKNOWN = 10.0  # standard error of a place that a record does not determine, over its range
MOVES = tuple(range(1, 9))  # by which a place moves, in its steps


@dataclass(frozen=True)
class Reference:
    """The ball as it was when the model was right."""

    model: BodyModel
    stderr: dict[str, float] = field(default_factory=dict)  # of its numbers, if known
    open: tuple[str, ...] = ()  # unknown numbers, which are part of every fit
    start: BodyModel | None = None  # at which fits start; None: `model`
    misfit: float = 1.0  # rms of its innovations over the noise, at least 1; it widens all errors


def known_value(model: BodyModel, name: str, of: BodyModel | None = None) -> float:
    """A number of a model. If it belongs to a term that the model does not have: 0, or its default for an effect of a
    user that the model `of` has."""
    try:
        return value_of(model, name)
    except KeyError:
        effect, _, key = name.partition(".")
        own = () if of is None else (term.effect for term in of.terms if term.name not in FAMILY)
        return next((user.parameters[key].default for user in own if user.name == effect), 0.0)


def smallest_reportable(model: BodyModel, name: str) -> float:
    """Smallest change of a number to report, in its unit."""
    number = number_of(model, name)
    if "." in name:
        effect, _, key = name.partition(".")
        (places,) = (term.effect.places for term in model.terms if term.name == effect)
        return math.inf if key in places else number.step
    smallest = number.origin[0].smallest * (0.1 if number.unit == "m/s^2" else 1.0) if number.effect else 0.0
    return max(smallest, number.step)


def surely_differs(model: BodyModel, stderr: dict[str, float], was: Reference, free: Sequence[str]) -> bool:
    """Whether one of these numbers surely differs from the reference, and by more than its smallest size."""
    for name in free:
        before = known_value(was.model, name, model)
        sigma = STDERR_SCALE * was.misfit * math.hypot(stderr.get(name, 0.0), was.stderr.get(name, 0.0))
        if abs(value_of(model, name) - before) > max(smallest_reportable(model, name), SURE * sigma):
            return True
    return False


def alternate(body: BodyFilter, most: int = PART, short: int = SHORT_RECORD) -> BodyFilter:
    """Every other stretch of PART_S s of a record, or fewer: about `most` pictures. One below `short` stays whole."""
    n, rows = len(body.pictures), round(PART_S / body.pictures.dt)
    return body if n < short else body.part(np.arange(n) // rows % max(n // most, 2) == 0)


def with_likeliest_noise(body: BodyFilter, model: BodyModel) -> BodyModel:
    """The model with the unexplained noise, of a coarse grid, at which the record is likeliest.

    Derivatives do not see that more noise would bring back pictures that the filter left out, or that the likelihood
    falls again behind a rough place."""
    tried = _noisier(model, NOISE_FACTORS)
    minus2 = [one.minus2 for one in side_by_side(body.innovations, tried)]
    return tried[int(np.argmin(minus2))]


def _noisier(model: BodyModel, factors: Sequence[float]) -> list[BodyModel]:
    plane = max(model.wander.plane, MIN_PROCESS_NOISE)
    return [model._replace(wander=model.wander._replace(plane=plane * factor)) for factor in factors]


def polished(body: BodyFilter, model: BodyModel, was: Reference, free: Sequence[str]) -> BodyFit:
    """The likeliest numbers. Small steps can get stuck. So the fit also tries numbers that are further from the
    reference, or nearer to it, and other noise."""
    names = [name for name in free if name not in NOISE and "." not in name]

    def rescaled(model: BodyModel, factor: float) -> BodyModel:
        values = {}
        for name in names:
            number, old = number_of(model, name), value_of(was.model, name)
            values[name] = min(max(old + factor * (value_of(model, name) - old), number.low), number.high)
        return with_values(model, values)

    def others(model: BodyModel) -> list[BodyModel]:
        return [*(rescaled(model, factor) for factor in RESCALE_FACTORS), *_noisier(model, (0.1, 0.3, 3.0, 10.0))]

    return _fitted_again(body, model, free, others if names else lambda _: [], body)


def placed(body: BodyFilter, model: BodyModel, free: Sequence[str]) -> BodyFit:
    """The likeliest numbers; for effects at a place, other places and sizes are tried, too.

    If a record is nearly as likely with a place far off, it does not determine the place."""
    places = [f"{term.name}.{place}" for term in model.terms for place in term.effect.places if place in MOVABLE]
    places = [name for name in places if name in free]

    def others(model: BodyModel) -> list[BodyModel]:
        """The model with other sizes of each effect, and with each place moved."""
        out = []
        for term in model.terms:
            names = [f"{term.name}.{key}" for key in term.effect.parameters if key not in term.effect.places]
            sizes = {name: value_of(model, name) for name in names if name in free}
            factors = RESCALE_FACTORS if sizes else ()
            out += [with_values(model, {name: f * value for name, value in sizes.items()}) for f in factors]
        return [*out, *(far for name in places for steps in MOVES for far in _away(model, name, steps))]

    near = _at_effects(body, model)
    fit = _fitted_again(body, model, free, others, near)
    least, unknown = near.innovations(fit.model).minus2, {}
    for name in places:
        if any(near.innovations(far).minus2 < least + ROUGH for far in _away(fit.model, name, MOVES[-1])):
            number = number_of(fit.model, name)
            unknown[name] = UNKNOWN * (number.high - number.low)
    return replace(fit, stderr={**fit.stderr, **unknown})


def _at_effects(body: BodyFilter, model: BodyModel) -> BodyFilter:
    """The part of a record in which an effect in one ring acts, and NEAR_S around it; all of it without one."""
    r, rows = np.hypot(*body.pictures.y.T), np.zeros(len(body.pictures), dtype=bool)
    for term in (term for term in model.terms if not term.idle):
        numbers = term.values()
        if "outer" not in numbers:
            return body
        rows |= (r > numbers["inner"]) & (r < numbers["outer"])
    around = np.ones(2 * round(NEAR_S / body.pictures.dt) + 1)
    return body.part(np.convolve(rows, around, "same") > 0.0) if rows.any() else body


def _fitted_again(
    body: BodyFilter, model: BodyModel, free: Sequence[str], others: Callable[[BodyModel], list[BodyModel]],
    part: BodyFilter,
) -> BodyFit:  # fmt: skip
    """A fit, and again from the likeliest of `others` of its result, as long as that is clearly likelier.

    part: of the record, on which `others` differ"""
    fit = fit_body(body, model, free, POLISH, ENOUGH)
    for _ in range(MAX_AGAIN):
        there = others(fit.model)
        minus2 = [one.minus2 for one in side_by_side(part.innovations, there)]
        if not there or min(minus2) > part.innovations(fit.model).minus2 - ROUGH:
            break
        fit = fit_body(body, there[int(np.argmin(minus2))], free, POLISH, ENOUGH)
    return fit


def _away(model: BodyModel, name: str, steps: float) -> list[BodyModel]:
    """The model with a number that is larger or smaller by so many of its steps, within its bounds."""
    number = number_of(model, name)
    ends = (value_of(model, name) + sign * steps * number.step for sign in (1.0, -1.0))
    return [with_values(model, {name: to}) for to in ends if number.low <= to <= number.high]


def fitted(body: BodyFilter, base: BodyModel, free: Sequence[str], c: Candidate) -> BodyFit:
    """The likeliest numbers of a candidate, fitted together with the numbers in `free`."""
    used = {name.partition(".")[0] for name in (*free, *c.free) if "." in name}
    model = base._replace(terms=tuple(term for term in base.terms if term.name in used or not term.idle))
    if c.fitted_first:
        model = fit_body(body, model, (*free, *c.fitted_first), STEPS, ENOUGH).model
    return fit_body(body, model, (*free, *c.fitted), STEPS, ENOUGH)


def fit_start(
    body: BodyFilter, base: BodyModel, c: Candidate, places: Mapping[str, Mapping[str, float]]
) -> tuple[float, BodyModel]:
    """-2 log L and the model at which the fit of a candidate starts: a likelier model than the base, which is further
    off; otherwise inf and the base."""
    tried = [dict(places[c.effect])] if c.effect in places else []
    for step in c.far:
        values = {}
        for name, change in zip(c.free, step, strict=False):
            number, at = number_of(base, name), value_of(base, name) + change
            low = max(number.low, body.soonest) if name == "delay" else number.low
            values[name] = min(max(at, low), number.high)
        tried.append(values)
    models = [with_values(base, values) for values in tried]
    scored = [(one.minus2, i) for i, one in enumerate(side_by_side(body.innovations, models))]
    least, i = min(scored, default=(math.inf, 0))
    return (least, models[i]) if models and least < body.innovations(base).minus2 else (math.inf, base)


def without_finding(model: BodyModel, was: Reference, c: Candidate) -> BodyModel:
    """The model with a candidate's numbers as in the reference."""
    before = with_values(model, {name: value_of(was.model, name) for name in c.fitted if "." not in name})
    gone = {name.partition(".")[0] for name in c.free if "." in name}
    return before._replace(terms=tuple(
        next((old for old in was.model.terms if old.name == term.name), None) or Term(term.effect, zero_effect(term))
        if term.name in gone else term for term in before.terms
    ))  # fmt: skip


def zero_effect(term: Term) -> tuple[float, ...]:
    """The numbers of a term with its places, and with sizes that have no effect."""
    pairs = zip(term.effect.parameters.items(), term.numbers, strict=True)
    return tuple(value if name in term.effect.places else p.default for (name, p), value in pairs)


def gain_estimates(
    body: BodyFilter, model: BodyModel, free: Sequence[str], left: Sequence[Candidate]
) -> dict[Candidate, float]:
    """The gain of -2 log L by each candidate, if -2 log L were a parabola."""
    names = [*free, *(name for c in left for name in c.sizes)]
    scores, given, out = score_search(body, model, names), np.arange(len(free)), {}
    g, F = scores.each.sum(axis=0), scores.information
    for c in left:
        own = np.array([names.index(name) for name in c.sizes])
        B = F[np.ix_(own, given)] @ np.linalg.pinv(F[np.ix_(given, given)])
        slope, curve = g[own] - B @ g[given], F[np.ix_(own, own)] - B @ F[np.ix_(given, own)]
        out[c] = float(slope @ np.linalg.pinv(curve, rcond=1e-9) @ slope)
    return out
