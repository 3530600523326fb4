"""The search for numbers of the ball that differ from a reference, in all rings of a record at once.

The search adds one candidate after the other. A score test says which candidates are worth a fit:

    g' F^-1 g,  g = gradient of -log L by the candidate's numbers, F = their information, both given the numbers found

The best fit has to gain `NEEDED` of -2 log L. The likelihood is rough (`rigid_body_fit`): even with nothing wrong, the
best candidate gains up to about 50. The candidate's numbers have to change by more than `SURE` standard errors of both
records, and by more than their smallest size. Every fit includes the unexplained noise, so that no effect stands in for
noise.

What a model lacks acts in the record of the reference alike. So each finding is fitted to both records under the same
model, and counts only if the two sizes differ beyond their errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mazeplan.control.estimation.rigid_body_filter import BodyFilter, BodyModel
from mazeplan.control.estimation.rigid_body_fit import BodyFit, fit_body, score_search, value_of, with_values
from mazeplan.diagnosis.rig.candidates import CANDIDATES, CONTACT, Candidate, of_effect
from mazeplan.diagnosis.rig.fitting import (
    ENOUGH,
    HALF_GAIN_SHARE,
    HOLLOW,
    NEEDED,
    NOISE,
    POLISH,
    ROUGH,
    SOLID,
    STDERR_SCALE,
    STEPS,
    SURE,
    Reference,
    alternate,
    fit_start,
    fitted,
    gain_estimates,
    placed,
    polished,
    smallest_reportable,
    surely_differs,
    with_likeliest_noise,
    without_finding,
    zero_effect,
)
from mazeplan.diagnosis.rig.starts import camera_starts, started_terms
from mazeplan.learning.rigid_body_entries import PARAMETERS
from mazeplan.maze.geometry import Maze
from mazeplan.physics.effect import Effect, Term
from mazeplan.physics.effects.local_forces import table_swing

PRICE = 15.0  # of -2 log L, for each number: more than the roughness of the likelihood
RIVAL_SHARE = 0.92  # a candidate with this share of the best gain explains the record as well: a rival
HOPEFUL_SHARE = 0.7  # candidates with this share of the best gain are fitted until nothing more is gained
MIN_SCORE_SHARE = 0.12  # a candidate with less than this share of the best score is not fitted
MOST_FITTED = 3  # maximum number of candidates that are fitted in a round, apart from simpler ones
MOST_FOUND = 4  # maximum number of effects
LEAST_SCORE = 12.0  # of -2 log L; a candidate with a lower score is not fitted
CHOOSING_S = 300.0  # s of a long record that choose candidates: a sector of one ring is seen in 3 % of them
# minimum gain over that of the largest finding: a large change shows what the model lacks in other places and ways,
# above all at walls, against which it leans the ball more or less than before
BESIDE_SHARE, WALLS_SHARE = 0.02, 0.2
WALLS = {"wall", "wall_rolling", "restitution", "hold", "spin"}
# a ball that is braked at walls looks like one that the floor brakes more; another ball has another friction
FLOOR = {"rolling", "viscous", "quadratic"}
# another ball, or two sensors that change alike: the ball is likelier if it is nearly a solid or a hollow one
ONE_BALL, BOTH_SENSORS, USUAL = "rolling_inertia", "tilt_gain", 0.03
ALIKE, MOST_KEPT = 0.03, 0.5  # difference of their changes; share of their gain that another ball has to explain
NO_RETEST_FACTOR = 3.0  # a finding that gains so many times NEEDED is not tested again on the whole record
TOO_LITTLE, WITHIN_ERRORS = "it explains too little", "its change is within the errors of the fits"
BEATEN = "another explains the record better"
THE_SAME = "the reference shows it as well"
STOOD_IN = "in the reference, its number stood in for something else: here it has its textbook value"
VALLEY = 3.0  # times further than a parabola says that a fit may come
TEXTBOOK = ("viscous", "quadratic", "tilt_beta", "tilt_gamma", "gain_beta", "gain_gamma", "angle", "scale", "bend")
Tried = dict[Candidate, tuple[float, str]]  # candidates that were not taken: gain of -2 log L, and why not


@dataclass(frozen=True)
class Finding:
    """A found candidate, its gain of -2 log L, and those that gained nearly as much, with the model of each."""

    candidate: Candidate
    gain: float
    rivals: Mapping[Candidate, BodyModel]


@dataclass(frozen=True)
class SearchResult:
    """What a search found, in its order; the fit with all of it, and the fit without any of it; what was not taken."""

    found: tuple[Finding, ...]
    fit: BodyFit
    without: BodyFit
    tried: Tried

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """What was found."""
        return tuple(finding.candidate for finding in self.found)


def search_against(
    body: BodyFilter, was: Reference, then: BodyFilter | None, maze: Maze,
    tell: Callable[[str], None] = lambda text: None, own: Sequence[Effect] = (), without: Container[str] = (),
) -> tuple[Reference, SearchResult]:  # fmt: skip
    """Find what differs from the reference, whose record is `then` (None: not kept).

    What is found is fitted to the record of the reference, too. What this record shows as well is no news: it becomes a
    part of the reference, and the search begins anew. So what the model lacks in both records cancels."""
    searched, no_news = search_rig(body, was, maze, tell, own, without), Tried()
    for _ in range(MOST_FOUND):
        if then is None or not searched.found:
            break
        gains = {finding.candidate: finding.gain for finding in searched.found}
        stood_in = [c for c in searched.candidates[1:] if _is_textbook(c, was, searched.fit)]
        if stood_in:
            now = {name: value_of(searched.fit.model, name) for c in stood_in for name in c.sizes}
            was = replace(was, model=with_values(was.model, now))
            no_news |= {c: (gains[c], STOOD_IN) for c in stood_in}
        else:
            tell("what was found, in the reference")
            was, news = _in_reference(then, was, searched)
            if len(news) == len(searched.found):
                break
            no_news |= {c: (gain, THE_SAME) for c, gain in gains.items() if c not in news}
        searched = search_rig(body, was, maze, tell, own, without)
    tried = {c: one for c, one in {**searched.tried, **no_news}.items() if c not in searched.candidates}
    return was, replace(searched, tried=tried)


def _is_textbook(c: Candidate, was: Reference, fit: BodyFit) -> bool:
    """Whether a number that was fitted to the reference goes to its textbook value, within its errors.

    A lean or a friction hardly vanishes when something else changes. Rather, the number of the reference stood in for
    something that the model lacks."""
    return set(c.sizes) <= set(TEXTBOOK) and all(
        abs(value_of(fit.model, name) - value_of(BodyModel(), name))
        <= max(SURE * STDERR_SCALE * was.misfit * fit.stderr[name], smallest_reportable(fit.model, name))
        for name in c.sizes
    )


def _in_reference(then: BodyFilter, was: Reference, searched: SearchResult) -> tuple[Reference, list[Candidate]]:
    """The reference with the numbers that were found, as its record shows them; and the findings that are news."""
    now, sizes = searched.fit.model, [name for c in searched.candidates for name in c.sizes]
    known = {term.name: term for term in was.model.terms if not term.idle}
    terms = [known.get(term.name, Term(term.effect, zero_effect(term))) for term in now.terms if not term.idle]
    terms += [term for name, term in known.items() if name not in {t.name for t in now.terms}]
    part = alternate(then)
    start = with_likeliest_noise(part, was.model._replace(terms=tuple(terms)))
    found = with_values(start, {name: value_of(now, name) for name in sizes})
    # a number that was fitted to the reference is right, unless a step as in the record makes it likelier there
    there, here = part.innovations(start).minus2, part.innovations(found).minus2
    missed = here < there
    names = [name for name in was.stderr if name in PARAMETERS and name not in (*NOISE, *sizes, "strike")]
    free, fit = sizes if missed else [name for name in sizes if name not in was.stderr], None
    # its fit may have ended in another valley: are the found numbers likelier with all others free?
    if not missed and here - VALLEY * _fall(part, found, (*NOISE, *names)) < there:
        every = (*NOISE, *sizes, *names)
        other = fit_body(part, found, every, STEPS, ROUGH)
        if other.minus2 < there - _fall(part, start, every) - NEEDED:
            fit = fit_body(part, other.model, every, enough=ENOUGH)
    if fit is None and not free:
        return was, list(searched.candidates)
    fit = fit or fit_body(part, found if missed else start, (*NOISE, *free), STEPS, ENOUGH)

    def reference(fit: BodyFit) -> Reference:
        return replace(was, model=fit.model, stderr={**was.stderr, **{name: fit.stderr[name] for name in fit.free}})

    moved = reference(fit)
    news = [c for c in searched.candidates if surely_differs(now, searched.fit.stderr, moved, c.sizes)]
    if len(news) < len(searched.found):  # their numbers change the others
        moved = reference(fit_body(then, fit.model, (*NOISE, *sizes, *names), STEPS, ENOUGH))
    return moved, news


def _fall(part: BodyFilter, model: BodyModel, free: Sequence[str]) -> float:
    """The fall of -2 log L if these numbers became the likeliest ones and -2 log L were a parabola."""
    scores = score_search(part, model, free)
    slope = scores.each.sum(axis=0)
    return float(slope @ np.linalg.pinv(scores.information, rcond=1e-9) @ slope)


def search_rig(
    body: BodyFilter, was: Reference, maze: Maze, tell: Callable[[str], None] = lambda text: None,
    own: Sequence[Effect] = (), without: Container[str] = (),
) -> SearchResult:  # fmt: skip
    """Find what differs from the reference.

    tell: reports progress
    own: effects of a user, to look for as well
    without: names of effects that are not looked for"""
    candidates = [c for c in (*CANDIDATES, *(of_effect(effect) for effect in own)) if c.effect not in without]
    always = (*NOISE, *was.open)
    start = was.start or was.model
    places = camera_starts(body, start.view, maze)
    first = fit_body(body, with_likeliest_noise(body, start), always, POLISH, ENOUGH)
    part, best, least = alternate(body, round(CHOOSING_S / body.pictures.dt)), first, NEEDED
    if part is not body:
        best, least = fit_body(part, first.model, always, STEPS, ENOUGH), HALF_GAIN_SHARE * NEEDED
    refused, chosen, tried = set[Candidate](), list[Finding](), Tried()
    while len(chosen) < MOST_FOUND:
        tell(f"looking for difference {len(chosen) + 1}")
        found = [c.candidate for c in chosen]
        free, taken = _free(always, chosen), {name for c in found for name in c.free}
        left = [c for c in candidates if not (c in refused or c in found or taken & set(c.free))]
        left = [c for c in left if not c.after or c.after in {c.effect for c in found}]
        left = [c for c in left if not (found and CONTACT in c.depends_on)]
        base = _with_starts(body, best.model, maze, own)
        new, model = _best(part, base, best.minus2, was, free, left, places, least, tried)
        if new is None:
            break
        tell(f"size of difference {len(chosen) + 1}")
        with_it = polished(part, model, was, (*free, *new.candidate.fitted))
        new = replace(new, gain=best.minus2 - with_it.minus2)
        needed = max([least, *(_share_beside(c.candidate, new.candidate) * c.gain for c in chosen)])
        if new.gain < needed or not _still_differs(with_it, was, new):
            refused.add(new.candidate)
            tried[new.candidate] = new.gain, TOO_LITTLE if new.gain < needed else WITHIN_ERRORS
            continue
        best, chosen = with_it, [*chosen, new]
        best, chosen = _pruned(part, best, was, always, chosen, chosen[:-1], least)
    if chosen and part is not body:
        best, chosen = _confirmed(body, part, best, was, always, chosen, first)
    found = [c.candidate for c in chosen]
    tried = {c: one for c, one in tried.items() if c not in found}
    return SearchResult(tuple(chosen), best if chosen else first, first, tried)


def _confirmed(
    body: BodyFilter, part: BodyFilter, best: BodyFit, was: Reference, always: Sequence[str], chosen: list[Finding],
    first: BodyFit,
) -> tuple[BodyFit, list[Finding]]:  # fmt: skip
    """The findings in a part of the record, fitted to the whole record, without those that it does not confirm."""
    best = placed(body, best.model, _free(always, chosen))
    chosen = [replace(c, gain=c.gain * len(body.pictures) / len(part.pictures)) for c in chosen]
    if len(chosen) == 1:
        chosen = [replace(chosen[0], gain=first.minus2 - best.minus2)]
    best, chosen = _or_a_rival(body, best, was, always, chosen, first)
    weak = [c for c in chosen if c.gain < NO_RETEST_FACTOR * NEEDED or not _still_differs(best, was, c)]
    return _pruned(body, best, was, always, chosen, weak, NEEDED)


def _or_a_rival(
    body: BodyFilter, best: BodyFit, was: Reference, always: Sequence[str], chosen: list[Finding], first: BodyFit
) -> tuple[BodyFit, list[Finding]]:
    """The findings, or a rival of the first one that explains the whole record better alone.

    Each further finding has to gain NEEDED over the rival, too: one cause rather than several."""
    base, found = best.model, {name for c in chosen for name in c.candidate.free}
    beside = {name: best.value(name) for name in _free((), chosen) if name not in found}
    for c in chosen:
        base = without_finding(base, was, c.candidate)
    for rival, model in chosen[0].rivals.items():
        terms = tuple(term for term in model.terms if not term.idle)
        own = {name: value_of(model, name) for name in rival.free}
        start = with_values(base._replace(terms=terms or base.terms), {**beside, **own})
        alone = polished(body, start, was, tuple(dict.fromkeys((*always, *beside, *rival.fitted))))
        several = chosen[0].candidate.effect == ONE_BALL and rival.effect == BOTH_SENSORS
        usual = several and min(abs(best.value("inertia") - kind) for kind in (SOLID, HOLLOW)) < USUAL
        price = NEEDED if usual else PRICE * (len(rival.free) - len(chosen[0].candidate.free))
        worth = NEEDED * (len(chosen) - 1) - price
        if alone.minus2 - best.minus2 < worth:
            gain = first.minus2 - alone.minus2
            close = len(chosen) == 1 and chosen[0].gain > RIVAL_SHARE * gain
            return alone, [Finding(rival, gain, {chosen[0].candidate: best.model} if close else {})]
    return best, chosen


def one_ball_instead(body: BodyFilter, done: SearchResult, was: Reference) -> SearchResult:
    """The result with another ball instead of two tilt sensors that changed alike, if it explains most of the same.

    For a record whose commands show that the measured tilt follows them as before: both sensors would have to change
    against both servos. A point mass that feels another share of gravity meets walls as before, unlike a ball."""
    by_effect = {one.candidate.effect: one for one in done.found}
    if ONE_BALL in by_effect:
        some = [{r: m for r, m in one.rivals.items() if r.effect != BOTH_SENSORS} for one in done.found]
        return replace(done, found=tuple(replace(one, rivals=r) for one, r in zip(done.found, some, strict=True)))
    sensors = by_effect.get(BOTH_SENSORS)
    if sensors is None:
        return done
    gains = sensors.candidate.free
    grown = [done.fit.value(name) / value_of(was.model, name) for name in gains]
    if abs(grown[0] / grown[1] - 1.0) > max(
        ALIKE, SURE * STDERR_SCALE * math.hypot(*(done.fit.stderr[n] for n in gains))
    ):
        return done
    (ball,) = [c for c in CANDIDATES if c.effect == ONE_BALL]
    inertia = (1.0 + value_of(was.model, "inertia")) * 2.0 / (grown[0] + grown[1]) - 1.0
    start = with_values(done.fit.model, {**{n: value_of(was.model, n) for n in gains}, "inertia": max(inertia, 0.0)})
    names = (*(name for name in done.fit.free if name not in gains), *ball.fitted)
    fit = fit_body(body, start, tuple(dict.fromkeys(names)), STEPS, ENOUGH)
    lost = fit.minus2 - done.fit.minus2
    if lost > (1.0 - MOST_KEPT) * sensors.gain:
        return done
    one_ball = Finding(ball, sensors.gain - lost, {})
    return replace(done, found=tuple(one_ball if one is sensors else one for one in done.found), fit=fit)


def _share_beside(larger: Candidate, new: Candidate) -> float:
    """The share of an earlier finding's gain that a further one needs beside it."""
    free = set(new.free)
    alike = free <= WALLS or (free <= FLOOR and set(larger.free) <= {*WALLS, "inertia"})
    return WALLS_SHARE if alike else BESIDE_SHARE


def _still_differs(fit: BodyFit, was: Reference, c: Finding) -> bool:
    return surely_differs(fit.model, fit.stderr, was, c.candidate.free)


def _pruned(
    body: BodyFilter, best: BodyFit, was: Reference, always: Sequence[str], chosen: list[Finding],
    doubted: Sequence[Finding], least: float,
) -> tuple[BodyFit, list[Finding]]:  # fmt: skip
    """Drop doubted findings that gain less than `least` beside the others. Returns the fit and the other findings."""
    for c in doubted:
        rest = [other for other in chosen if other is not c]
        free = _free(always, rest)
        without = fit_body(body, without_finding(best.model, was, c.candidate), free, STEPS, ENOUGH)
        if _still_differs(best, was, c) and without.minus2 - best.minus2 >= least:
            continue
        best = fit_body(body, without.model, free, POLISH, ENOUGH)
        # the rivals of the last one stood beside the dropped finding
        chosen = [*rest[:-1], replace(rest[-1], rivals={})] if rest else []
    return best, chosen


def _best(
    part: BodyFilter,
    base: BodyModel,
    minus2: float,
    was: Reference,
    free: Sequence[str],
    left: Sequence[Candidate],
    places: Mapping[str, Mapping[str, float]],
    least: float,
    told: Tried,
) -> tuple[Finding | None, BodyModel]:
    """The candidate that explains a part of the record best, and the model with it. None if no candidate gains `least`.
    Writes the others into `told`.

    base: the likeliest model with the earlier findings
    minus2: -2 log L of the base"""
    begins = {c: fit_start(part, base, c, places) for c in left}
    scores = gain_estimates(part, base, free, left)
    scores = {c: max(scores[c], minus2 - begins[c][0]) - PRICE * len(c.free) for c in left}
    ranked = sorted((c for c in left if scores[c] > LEAST_SCORE), key=lambda c: -scores[c])
    tried = [c for c in ranked[:MOST_FITTED] if scores[c] > MIN_SCORE_SHARE * scores[ranked[0]]]
    simpler = {name for c in tried for name in c.simpler}
    tried += [c for c in left if c.effect in simpler and c not in tried]
    fits = {c: fitted(part, begins[c][1], free, c) for c in tried}
    most = max((minus2 - fit.minus2 for fit in fits.values()), default=0.0)
    hopeful = [c for c, fit in fits.items() if minus2 - fit.minus2 > HOPEFUL_SHARE * most]
    if len(hopeful) > 1:  # a fit that got stuck decides nothing
        fits |= {c: polished(part, fits[c].model, was, (*free, *c.fitted)) for c in hopeful}
    gained = {c: minus2 - fit.minus2 for c, fit in fits.items()}
    for c in left:
        gain = gained.get(c, max(scores[c] + PRICE * len(c.free), 0.0))
        told[c] = gain, TOO_LITTLE if gain < least else WITHIN_ERRORS
    sure = [c for c in tried if gained[c] >= least and surely_differs(fits[c].model, fits[c].stderr, was, c.free)]
    if not sure:
        return None, base
    worth = {c: gained[c] - PRICE * len(c.free) for c in sure}
    close = [c for c in sure if worth[c] > RIVAL_SHARE * max(worth.values())]
    chosen = min(close, key=lambda c: (len(c.free), -worth[c]))  # the simplest of those that explain as well
    told.update({c: (gained[c], BEATEN) for c in sure})
    rivals = {c: fits[c].model for c in close if c is not chosen and chosen.effect not in c.simpler}
    return Finding(chosen, gained[chosen], rivals), fits[chosen].model


def _free(always: Sequence[str], found: Sequence[Finding]) -> tuple[str, ...]:
    return tuple(dict.fromkeys((*always, *(name for one in found for name in one.candidate.fitted))))


def _with_starts(body: BodyFilter, model: BodyModel, maze: Maze, own: Sequence[Effect]) -> BodyModel:
    """The model with its terms, and with all other terms at their likely places and without effect."""
    have = {term.name: term for term in model.terms if not term.idle}
    swings = value_of(model, "table_swing.frequency") if table_swing.name in have else 0.0
    started = (*started_terms(body, body.run(model), model.view.delay, maze, swings), *(effect() for effect in own))
    return model._replace(terms=tuple(have.get(term.name, term) for term in started))
