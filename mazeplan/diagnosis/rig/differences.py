"""What is news in a record: the search against a reference whose record was kept.

What a model lacks acts in both records alike. So each finding is fitted to both under the same model, and counts only
if the two sizes differ beyond their errors.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from dataclasses import replace

import numpy as np

from mazeplan.control.estimation.rigid_body_filter import BodyFilter, BodyModel
from mazeplan.control.estimation.rigid_body_fit import BodyFit, fit_body, score_search
from mazeplan.control.estimation.rigid_body_parameters import value_of, with_values
from mazeplan.diagnosis.rig.candidates import Candidate
from mazeplan.diagnosis.rig.fitting import (
    ENOUGH,
    NEEDED,
    NOISE,
    ROUGH,
    STDERR_SCALE,
    STEPS,
    SURE,
    Reference,
    alternate,
    smallest_reportable,
    surely_differs,
    with_likeliest_noise,
    zero_effect,
)
from mazeplan.diagnosis.rig.search import MOST_FOUND, SearchResult, Tried, search_rig
from mazeplan.learning.rigid_body_entries import PARAMETERS
from mazeplan.maze.geometry import Maze
from mazeplan.physics.effect import Effect, Term

THE_SAME = "the reference shows it as well"
STOOD_IN = "in the reference, its number stood in for something else: here it has its textbook value"
VALLEY = 3.0  # times further than a parabola says that a fit may come
TEXTBOOK = ("viscous", "quadratic", "tilt_beta", "tilt_gamma", "gain_beta", "gain_gamma", "angle", "scale", "bend")


def search_against(
    body: BodyFilter, was: Reference, then: BodyFilter | None, maze: Maze,
    tell: Callable[[str], None] = lambda text: None, own: Sequence[Effect] = (), without: Container[str] = (),
) -> tuple[Reference, SearchResult]:  # fmt: skip
    """Find what differs from the reference, whose record is `then` (None: not kept).

    What is found is fitted to the record of the reference, too. What this record shows as well is no news: it becomes a
    part of the reference, and the search begins anew. So what the model lacks in both records cancels."""
    searched, no_news = search_rig(body, was, maze, tell, own, without), list[Tried]()
    for _ in range(MOST_FOUND):
        if then is None or not searched.found:
            break
        gains = dict(zip(searched.found, searched.gains, strict=True))
        stood_in = [c for c in searched.found[1:] if _is_textbook(c, was, searched.fit)]
        if stood_in:
            now = {name: value_of(searched.fit.model, name) for c in stood_in for name in c.sizes}
            was = replace(was, model=with_values(was.model, now))
            no_news += [Tried(c, gains[c], STOOD_IN) for c in stood_in]
        else:
            tell("what was found, in the reference")
            was, news = _in_reference(then, was, searched)
            if len(news) == len(searched.found):
                break
            no_news += [Tried(c, gain, THE_SAME) for c, gain in gains.items() if c not in news]
        searched = search_rig(body, was, maze, tell, own, without)
    again = {one.candidate for one in no_news} | set(searched.found)
    others = tuple(one for one in searched.tried if one.candidate not in again)
    return was, replace(searched, tried=(*(one for one in no_news if one.candidate not in searched.found), *others))


def _is_textbook(c: Candidate, was: Reference, fit: BodyFit) -> bool:
    """Whether a number that was fitted to the reference goes to its textbook value, within its errors.

    A lean or a friction hardly vanishes at the moment when something else changes. Rather, the number of the reference
    stood in for something that the model lacks, and the change made that visible."""
    return set(c.sizes) <= set(TEXTBOOK) and all(
        abs(value_of(fit.model, name) - value_of(BodyModel(), name))
        <= max(SURE * STDERR_SCALE * was.misfit * fit.stderr[name], smallest_reportable(fit.model, name))
        for name in c.sizes
    )


def _fall(part: BodyFilter, model: BodyModel, free: Sequence[str]) -> float:
    """The fall of -2 log L if these numbers became the likeliest ones and -2 log L were a parabola."""
    scores = score_search(part, model, free)
    slope = scores.each.sum(axis=0)
    return float(slope @ np.linalg.pinv(scores.information, rcond=1e-9) @ slope)


def _in_reference(then: BodyFilter, was: Reference, searched: SearchResult) -> tuple[Reference, list[Candidate]]:
    """The reference with the numbers that were found, as its record shows them; and the findings that are news."""
    now, sizes = searched.fit.model, [name for c in searched.found for name in c.sizes]
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
        return was, list(searched.found)
    fit = fit or fit_body(part, found if missed else start, (*NOISE, *free), STEPS, ENOUGH)

    def reference(fit: BodyFit) -> Reference:
        return replace(was, model=fit.model, stderr={**was.stderr, **{name: fit.stderr[name] for name in fit.free}})

    moved = reference(fit)
    news = [c for c in searched.found if surely_differs(now, searched.fit.stderr, moved, c.sizes)]
    if len(news) < len(searched.found):  # their numbers change the others
        moved = reference(fit_body(then, fit.model, (*NOISE, *sizes, *names), STEPS, ENOUGH))
    return moved, news
