"""Which numbers of a ball with a body differ from what they were in a reference, all rings of a record at once.

One candidate after the other is added to what was found. Which ones are worth a fit, a score test says:

    g' F^-1 g,  g = gradient of -log L by the candidate's numbers, F = their information, both given the numbers found

The best fit has to gain `NEEDED` of -2 log L. That likelihood is rough (`estimation.bodyfit`): on healthy records the
best candidate gains up to about 50. Its numbers have to move further than `SURE` standard errors of both records, and
further than is worth a word; and records are fitted with what is unexplained free, so that an effect cannot stand in
for noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mazeplan.diagnosis.bodycamera import camera_starts
from mazeplan.diagnosis.bodycandidates import CANDIDATES, CONTACT, Candidate, of_effect
from mazeplan.diagnosis.planefloors import started_terms
from mazeplan.estimation.bodyfilter import BodyFilter, BodyModel
from mazeplan.estimation.bodyfit import BodyFit, fit_body, score_search
from mazeplan.estimation.bodynumbers import number_of, value_of, with_values
from mazeplan.maze.geometry import Maze
from mazeplan.physics.bodyeffects import idle
from mazeplan.physics.effect import Effect, Term

NOISE = ("noise", "plane")  # `strike` stays: it would hide walls that are elsewhere
NEEDED = 150.0  # of -2 log L
PRICE = 15.0  # of -2 log L, of each number: more than the roughness of the likelihood
LIKE = 0.85  # share of the best one's gain from which another candidate explains the record as well
SURE = 3.5  # standard errors of both records, each taken ROUGH times
ROUGH = 2.0  # how much further values scatter from record to record than standard errors say
WORTH, MOST_FITTED = 0.12, 3  # share of the best score from which a candidate is fitted, and how many at most
STEPS, POLISH, ENOUGH, MOST_FOUND = 8, 20, 4.0, 4
PLANE = 3e-4  # m^2/s^3, with which a search begins
LEAST_SCORE = 25.0
FURTHER, LEAPS = (0.8, 0.9, 0.95, 1.05, 1.12, 1.25, 1.5), 3


@dataclass(frozen=True)
class Reference:
    """The body as it was when the model was right. stderr: of its numbers, where known; open: numbers that it does not
    know, which are fitted along; start: where a fit begins, None for the model itself."""

    model: BodyModel
    stderr: dict[str, float] = field(default_factory=dict)
    open: tuple[str, ...] = ()
    start: BodyModel | None = None


@dataclass(frozen=True)
class Searched:
    """found: in the order in which they were; gains: of each, in -2 log L; rivals: candidates that gained nearly as
    much as one found, by its place; fit: with all of them; first: without any."""

    found: tuple[Candidate, ...]
    gains: tuple[float, ...]
    rivals: tuple[tuple[Candidate, ...], ...]
    fit: BodyFit
    first: BodyFit


def smallest(model: BodyModel, name: str) -> float:
    """Least change of a number that is worth a word, in its unit."""
    if "." in name:
        effect, _, key = name.partition(".")
        (places,) = (term.effect.places for term in model.terms if term.name == effect)
        return math.inf if key in places else number_of(model, name).step
    number = number_of(model, name)
    return max(
        number.origin[0].smallest * (0.1 if number.unit == "m/s^2" else 1.0) if number.effect else 0.0, number.step
    )


def moved(model: BodyModel, stderr: dict[str, float], was: Reference, free: Sequence[str]) -> bool:
    """Whether one of these numbers surely differs from the reference, by more than its smallest size."""
    for name in free:
        before = known_value(was.model, name)
        sigma = ROUGH * math.hypot(stderr.get(name, 0.0), was.stderr.get(name, 0.0))
        if abs(value_of(model, name) - before) > max(smallest(model, name), SURE * sigma):
            return True
    return False


def known_value(model: BodyModel, name: str) -> float:
    """A number of a model, as it is without the term where the model has none."""
    try:
        return value_of(model, name)
    except KeyError:
        return 0.0


def search_body(
    body: BodyFilter, was: Reference, maze: Maze, tell: Callable[[str], None] = lambda text: None,
    own: Sequence[Effect] = (),
) -> Searched:  # fmt: skip
    """What differs from the reference. tell: progress; own: effects of a user's own that are looked for, too."""
    candidates = (*CANDIDATES, *(of_effect(effect) for effect in own))
    known = (*NOISE, *was.open)
    places = camera_starts(body, (was.start or was.model).view, maze)
    first = best = fit_body(body, _noisy(was.start or was.model), known, POLISH, ENOUGH)
    found, gains, rivals = list[Candidate](), list[float](), list[tuple[Candidate, ...]]()
    while len(found) < MOST_FOUND:
        tell(f"{len(found)} found, next")
        base = _with_starts(body, best, maze, own)
        free = _free(known, found)
        left = [c for c in candidates if not set(c.free) & set(free) and not (found and CONTACT in c.depends_on)]
        begins = {c: _begun(body, base, c, places) for c in left}
        scores = _scores(body, base, free, left)
        scores = {c: max(scores[c], best.minus2 - begins[c][0]) - PRICE * len(c.free) for c in left}
        ranked = sorted((c for c in left if scores[c] > LEAST_SCORE), key=lambda c: -scores[c])
        tried = [c for c in ranked[:MOST_FITTED] if scores[c] > WORTH * scores[ranked[0]]]
        simpler = {name for c in tried for name in c.simpler}
        tried += [c for c in left if c.effect in simpler and c not in tried]
        fits = {c: _fitted(body, begins[c][1], free, c) for c in tried}
        gained = {c: best.minus2 - fit.minus2 for c, fit in fits.items()}
        sure = [
            c for c in tried
            if gained[c] >= NEEDED and moved(fits[c].model, fits[c].stderr, was, c.free)
        ]  # fmt: skip
        if not sure:
            break
        worth = {c: gained[c] - PRICE * len(c.free) for c in sure}
        best_worth = max(worth.values())
        close = [c for c in sure if worth[c] > LIKE * best_worth]
        chosen = min(close, key=lambda c: (len(c.free), -worth[c]))  # of those that explain as well, the simplest
        rivals.append(tuple(c for c in close if c is not chosen and len(c.free) == len(chosen.free)))
        found.append(chosen)
        gains.append(gained[chosen])
        tell(f"{len(found)} found, its size")
        best = _polished(body, fits[chosen].model, was, (*free, *chosen.fitted))
        for c in _needless(body, best, was, known, found):
            i = found.index(c)
            del found[i], gains[i], rivals[i]
            rivals[-1] = ()  # they were rivals beside what is gone
            best = fit_body(body, _without(best.model, was, c), _free(known, found), POLISH, ENOUGH)
    return Searched(tuple(found), tuple(gains), tuple(rivals), best, first)


def _free(known: Sequence[str], found: Sequence[Candidate]) -> tuple[str, ...]:
    return tuple(dict.fromkeys((*known, *(name for c in found for name in c.fitted))))


def _needless(
    body: BodyFilter, best: BodyFit, was: Reference, known: Sequence[str], found: Sequence[Candidate]
) -> list[Candidate]:
    """Candidates found earlier that the last one has made needless."""
    out = []
    for c in found[:-1]:
        rest = [other for other in found if other is not c and other not in out]
        without = fit_body(body, _without(best.model, was, c), _free(known, rest), STEPS, ENOUGH)
        if without.minus2 - best.minus2 < NEEDED:
            out.append(c)
    return out


def _without(model: BodyModel, was: Reference, c: Candidate) -> BodyModel:
    """The model with a candidate's numbers as they were."""
    before = with_values(model, {name: value_of(was.model, name) for name in c.fitted if "." not in name})
    gone = {name.partition(".")[0] for name in c.free if "." in name}
    return before._replace(terms=tuple(
        next((old for old in was.model.terms if old.name == term.name), None) or Term(term.effect, _nought(term))
        if term.name in gone else term for term in before.terms
    ))  # fmt: skip


def _nought(term: Term) -> tuple[float, ...]:
    """The numbers of a term without any size, where it is."""
    pairs = zip(term.effect.parameters.items(), term.numbers, strict=True)
    return tuple(value if name in term.effect.places else p.default for (name, p), value in pairs)


def _begun(
    body: BodyFilter, base: BodyModel, c: Candidate, places: Mapping[str, Mapping[str, float]]
) -> tuple[float, BodyModel]:
    """-2 log L and the model where the fit of a candidate begins: the base, or one further off that is likelier."""
    tried = [places[c.effect]] if c.effect in places else []
    if c.far:
        number, at = number_of(base, c.free[0]), value_of(base, c.free[0])
        tried += [{c.free[0]: min(max(at + step, number.low), number.high)} for step in c.far]
    models = [with_values(base, values) for values in tried]
    scored = [(body.run(model).minus2, i) for i, model in enumerate(models)]
    least, i = min(scored, default=(math.inf, 0))
    return (least, models[i]) if models and least < body.run(base).minus2 else (math.inf, base)


def _noisy(model: BodyModel) -> BodyModel:
    """The model with enough that is unexplained for a search: its likelihood is flat where there is nearly none."""
    return model._replace(wander=model.wander._replace(plane=max(model.wander.plane, PLANE)))


def _with_starts(body: BodyFilter, best: BodyFit, maze: Maze, own: Sequence[Effect]) -> BodyModel:
    """The model with the terms that it has, and the others at nought where they would begin."""
    have = {term.name: term for term in best.model.terms if not idle(term)}
    started = (*started_terms(body, best.filtered, best.model.view.delay, maze), *(effect() for effect in own))
    return best.model._replace(terms=tuple(have.get(term.name, term) for term in started))


def _scores(
    body: BodyFilter, model: BodyModel, free: Sequence[str], left: Sequence[Candidate]
) -> dict[Candidate, float]:
    """What each candidate would gain of -2 log L if that were a parabola."""
    names = [*free, *(name for c in left for name in (c.first or c.free))]
    scores = score_search(body, model, names)
    g, F = scores.each.sum(axis=0), scores.information
    known = np.arange(len(free))
    out = {}
    for c in left:
        own = np.array([names.index(name) for name in (c.first or c.free)])
        B = F[np.ix_(own, known)] @ np.linalg.pinv(F[np.ix_(known, known)])
        slope, curve = g[own] - B @ g[known], F[np.ix_(own, own)] - B @ F[np.ix_(known, own)]
        out[c] = float(slope @ np.linalg.pinv(curve, rcond=1e-9) @ slope)
    return out


def _polished(body: BodyFilter, model: BodyModel, was: Reference, free: Sequence[str]) -> BodyFit:
    """The likeliest numbers, also where small steps see no way on: numbers further from the reference, or nearer to it,
    are tried as well."""
    fit = fit_body(body, model, free, POLISH, ENOUGH)
    numbers = [name for name in free if name not in NOISE and "." not in name]
    for _ in range(LEAPS if numbers else 0):
        there = [_leapt(fit.model, was.model, numbers, factor) for factor in FURTHER]
        minus2 = [body.run(m).minus2 for m in there]
        least = int(np.argmin(minus2))
        if minus2[least] > fit.minus2 - ENOUGH:
            break
        fit = fit_body(body, there[least], free, POLISH, ENOUGH)
    return fit


def _leapt(model: BodyModel, was: BodyModel, names: Sequence[str], factor: float) -> BodyModel:
    """The model with numbers so many times as far from the reference, within their bounds."""
    values = {}
    for name in names:
        number, old = number_of(model, name), value_of(was, name)
        values[name] = min(max(old + factor * (value_of(model, name) - old), number.low), number.high)
    return with_values(model, values)


def _fitted(body: BodyFilter, base: BodyModel, free: Sequence[str], c: Candidate) -> BodyFit:
    """The likeliest numbers of a candidate together with those found before."""
    used = {name.partition(".")[0] for name in (*free, *c.free) if "." in name}
    model = base._replace(terms=tuple(term for term in base.terms if term.name in used or not idle(term)))
    if c.first:
        model = fit_body(body, model, (*free, *c.first), STEPS, ENOUGH).model
    return fit_body(body, model, (*free, *c.fitted), STEPS, ENOUGH)
