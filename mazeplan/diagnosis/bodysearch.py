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
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from mazeplan.diagnosis.planefloors import floor_bump, floor_warp, started_terms, table_swing
from mazeplan.estimation.bodyfilter import BodyFilter, BodyModel
from mazeplan.estimation.bodyfit import BodyFit, fit_body, score_search
from mazeplan.estimation.bodynumbers import number_of, value_of, with_values
from mazeplan.maze.geometry import Maze

NOISE = ("noise", "plane")  # `strike` stays: it would hide walls that are elsewhere
NEEDED = 150.0  # of -2 log L
LIKE = 0.85  # share of the best one's gain from which another candidate explains the record as well
SURE = 3.5  # standard errors of both records, each taken ROUGH times
ROUGH = 2.0  # how much further values scatter from record to record than standard errors say
WORTH, MOST_FITTED = 0.12, 3  # share of the best score from which a candidate is fitted, and how many at most
STEPS, POLISH, ENOUGH, MOST_FOUND = 8, 20, 4.0, 4
PLANE = 3e-4  # m^2/s^3, with which a search begins
LEAST_SCORE = 25.0
FURTHER, LEAPS = (0.8, 0.9, 0.95, 1.05, 1.12, 1.25, 1.5), 3


@dataclass(frozen=True)
class Candidate:
    """effect: name in the registry, "" for what has none; free: numbers that it changes; first: those that are fitted
    before the others, without which these say nothing; words: for what has no name in the registry."""

    effect: str
    free: tuple[str, ...]
    first: tuple[str, ...] = ()
    words: str = ""


CANDIDATES = (
    Candidate("dry_friction", ("rolling",)),
    Candidate("viscous_friction", ("viscous",)),
    Candidate("quadratic_drag", ("quadratic",)),
    Candidate("rolling_inertia", ("inertia",)),
    Candidate("wall_friction", ("wall",)),
    Candidate("tilt_offset", ("tilt_beta", "tilt_gamma")),
    Candidate("tilt_gain", ("gain_beta", "gain_gamma")),
    Candidate("camera_offset", ("offset_x", "offset_y")),
    Candidate("axis_misalignment", ("angle",)),
    Candidate("camera_scale", ("scale",)),
    Candidate("sensor_delay", ("delay",)),
    Candidate("surface_profile", ("floor_warp.a", "floor_warp.b", "floor_warp.c")),
    Candidate(
        "surface_bump", ("floor_bump.depth", "floor_bump.x", "floor_bump.y", "floor_bump.width"), ("floor_bump.depth",)
    ),
    Candidate(
        "table_rocking",
        ("table_swing.bs", "table_swing.bc", "table_swing.gs", "table_swing.gc", "table_swing.frequency"),
        ("table_swing.bs", "table_swing.bc", "table_swing.gs", "table_swing.gc"),
    ),
    Candidate("", ("restitution", "hold"), words="walls throw the ball back differently"),
    Candidate("", ("spin",), words="the ball spins against another friction"),
    Candidate("", ("cross_beta", "cross_gamma"), words="the plate tilts about other axes than it is measured in"),
)
SIZES = {floor_warp.name: ("a", "b", "c"), floor_bump.name: ("depth",), table_swing.name: ("bs", "bc", "gs", "gc")}


@dataclass(frozen=True)
class Reference:
    """The body as it was when the model was right. stderr: of its numbers, where known."""

    model: BodyModel
    stderr: dict[str, float] = field(default_factory=dict)


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
        return number_of(model, name).step if key in SIZES[effect] else math.inf
    number = number_of(model, name)
    return max(
        number.origin[0].smallest * (0.1 if number.unit == "m/s^2" else 1.0) if number.effect else 0.0, number.step
    )


def moved(model: BodyModel, stderr: dict[str, float], was: Reference, free: Sequence[str]) -> bool:
    """Whether one of these numbers surely differs from the reference, by more than its smallest size."""
    for name in free:
        before = 0.0 if "." in name else value_of(was.model, name)
        sigma = ROUGH * math.hypot(stderr.get(name, 0.0), was.stderr.get(name, 0.0))
        if abs(value_of(model, name) - before) > max(smallest(model, name), SURE * sigma):
            return True
    return False


def search_body(
    body: BodyFilter, was: Reference, maze: Maze, tell: Callable[[str], None] = lambda text: None
) -> Searched:
    """What differs from the reference. tell: progress."""
    first = best = fit_body(body, _noisy(was.model._replace(terms=())), NOISE, POLISH, ENOUGH)
    found, gains, rivals = list[Candidate](), list[float](), list[tuple[Candidate, ...]]()
    while len(found) < MOST_FOUND:
        tell(f"{len(found)} found, next")
        base = _with_starts(body, best, found, maze)
        free = (*NOISE, *(name for c in found for name in c.free))
        left = [c for c in CANDIDATES if c not in found]
        scores = _scores(body, base, free, left)
        ranked = sorted((c for c in left if scores[c] > LEAST_SCORE), key=lambda c: -scores[c])
        tried = [c for c in ranked[:MOST_FITTED] if scores[c] > WORTH * scores[ranked[0]]]
        fits = {c: _fitted(body, base, free, c) for c in tried}
        gained = {c: best.minus2 - fit.minus2 for c, fit in fits.items()}
        sure = [
            c for c in tried
            if gained[c] >= NEEDED and moved(fits[c].model, fits[c].stderr, was, c.free)
        ]  # fmt: skip
        if not sure:
            break
        chosen = max(sure, key=lambda c: gained[c])
        rivals.append(tuple(c for c in sure if c is not chosen and gained[c] > LIKE * gained[chosen]))
        found.append(chosen)
        gains.append(gained[chosen])
        tell(f"{len(found)} found, its size")
        best = _polished(body, fits[chosen].model, was, (*free, *chosen.free))
    return Searched(tuple(found), tuple(gains), tuple(rivals), best, first)


def _noisy(model: BodyModel) -> BodyModel:
    """The model with enough that is unexplained for a search: its likelihood is flat where there is nearly none."""
    return model._replace(wander=model.wander._replace(plane=max(model.wander.plane, PLANE)))


def _with_starts(body: BodyFilter, best: BodyFit, found: Sequence[Candidate], maze: Maze) -> BodyModel:
    """The model with the terms that were found, and the others at nought where they would begin."""
    kept = {name.partition(".")[0] for c in found for name in c.free if "." in name}
    have = {term.name: term for term in best.model.terms if term.name in kept}
    started = started_terms(body, best.filtered, best.model.view.delay, maze)
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
    unused = {name for name in SIZES if not any(f.startswith(f"{name}.") for f in (*free, *c.free))}
    model = base._replace(terms=tuple(term for term in base.terms if term.name not in unused))
    if c.first:
        model = fit_body(body, model, (*free, *c.first), STEPS, ENOUGH).model
    return fit_body(body, model, (*free, *c.free), STEPS, ENOUGH)
