"""The verdict on a record of a ball that touches walls: what differs from a reference in which the model was right.

Stage first, from commands and measured tilt alone; then ball, table and camera by `bodysearch`, with the plate moving
as the fitted stage says. A changed gain of the stage belongs to the servo, unless the ball felt tilts of the old size:
then the sensor shows them larger than they are. What was found has to predict: on blocks of time that took no part in
the fit, the record has to be likelier with it than without. What then remains is compared with the camera's noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mazeplan.data.table import Table
from mazeplan.diagnosis.bodyrecord import body_filter, first_guess
from mazeplan.diagnosis.bodysearch import (
    ENOUGH,
    NOISE,
    STEPS,
    Candidate,
    Reference,
    Searched,
    search_body,
)
from mazeplan.diagnosis.bodywords import advice, in_registry, sentence
from mazeplan.diagnosis.parts import Known, changed, stage_effects
from mazeplan.diagnosis.platemotion import Stage
from mazeplan.diagnosis.wording import with_plan
from mazeplan.errors import TableError
from mazeplan.estimation.bodyfilter import BodyFilter, BodyModel, Filtered, Pictures
from mazeplan.estimation.bodyfit import BLOCK_S, ORDINARY, autocorrelation, fit_body
from mazeplan.maths.angles import difference
from mazeplan.maze.geometry import Maze
from mazeplan.models.modelfile import RigModel
from mazeplan.models.rollout import STEPS as AHEAD
from mazeplan.physics import rig
from mazeplan.physics.stage import StageModel
from mazeplan.records import Array, IntArray

FITTED = (*ORDINARY, "gain_beta", "gain_gamma", "inertia", "viscous")  # of a reference
HELD_OUT = 0.5  # each half of a record is predicted from the other
BETTER = 2.0  # standard errors by which held-out blocks have to be likelier
MEMORY = 0.1  # autocorrelation of innovations from which something is left
REMAINS = 1.5  # times the noise, from which something is left
EVERY = 7  # pictures between the starts of roll-outs


@dataclass(frozen=True)
class RigReference:
    """A reference: the body in it, and the stage; pictures: that it had."""

    body: Reference
    stage: Stage
    pictures: int


@dataclass(frozen=True)
class BodyVerdict:
    """What `document` tells as JSON. effects: as in the JSON; unknown: what has no name; before, after: errors of
    roll-outs on what was held out, without and with what was found; remaining: innovations over those of noise alone;
    likelier: standard errors by which held-out blocks are likelier with it."""

    effects: tuple[dict[str, Any], ...]
    alike: tuple[tuple[str, ...], ...]
    unknown: dict[str, Any] | None
    before: dict[str, float]
    after: dict[str, float]
    remaining: float
    likelier: float
    searched: Searched

    @property
    def verdict(self) -> str:
        """As the JSON has it."""
        if self.unknown is not None:
            return "unknown_effect"
        if not self.effects:
            return "nothing_missing"
        return "ambiguous" if self.alike else "effect_found"

    def sentences(self) -> list[str]:
        """What was found, and what to do."""
        first = sentence(self.verdict, self.effects, self.alike, self.unknown, self.before, self.after, self.remaining)
        return [first, *advice(self.effects, self.alike, self.unknown)]

    def document(self) -> dict[str, Any]:
        """As `diagnose --reference --json`. An effect's errors are those of 40 samples, of all that was found."""
        errors = {"before": self.before[f"rollout{AHEAD}"], "after": self.after[f"rollout{AHEAD}"]}
        numbers = sorted({int(ring) for effect in self.effects for ring in effect["rings"]})
        return {
            "verdict": self.verdict, "effects": [effect | errors for effect in self.effects],
            "ambiguous_with": [list(g) for g in self.alike], "unknown": self.unknown,
            "before": {"nrmse": None, **self.before}, "after": {"nrmse": None, **self.after}, "noise_floor": None,
            "held_out": HELD_OUT, "remaining": round(self.remaining, 3), "advice": self.sentences()[1:],
            "rings": {str(ring): self._in_ring(str(ring)) for ring in numbers},
        }  # fmt: skip

    def _in_ring(self, ring: str) -> dict[str, Any]:
        """The verdict is that of all rings; sizes are those of this one."""
        here = []
        for effect in self.effects:
            now, parameters = effect["rings"][ring]["after"], effect["parameters"]
            told = {key: {**parameters[key], "value": value} for key, value in now.items()}
            here.append({"name": effect["name"], "parameters": told})
        return {"verdict": self.verdict, "effects": here}


def reference_of(table: Table, maze: Maze, model: RigModel | None) -> RigReference:
    """The body and the stage of a record in which the model was right. Raises TableError."""
    body, stage = body_filter(table, maze)
    if stage is None:
        raise TableError("got a record without commands that move the plate, expected u_beta and u_gamma",
                         file=table.source.get("file"))  # fmt: skip
    fit = fit_body(body, first_guess(model, maze), FITTED, enough=ENOUGH)
    return RigReference(Reference(fit.model, fit.stderr), stage, len(body.pictures))


def verdict_on(
    table: Table, maze: Maze, was: RigReference, tell: Callable[[str], None] = lambda text: None
) -> BodyVerdict:
    """What differs from a reference. tell: progress. Raises TableError."""
    body, stage = body_filter(table, maze)
    if stage is None:
        raise TableError("got a record without commands that move the plate, expected u_beta and u_gamma",
                         file=table.source.get("file"))  # fmt: skip
    searched = search_body(body, was.body, maze, tell)
    tell("held-out part")
    likelier, before, after = _held_out(body, was, searched, table, maze)
    found = searched.found if not searched.found or likelier > BETTER else ()
    effects, alike = _named(stage, was, searched, found, _radii(maze, searched.fit.filtered))
    remaining = _remaining(body, searched)
    unknown = _unknown(searched, found, remaining)
    if not effects and unknown is None:
        after = dict(before)
    return BodyVerdict(tuple(effects), tuple(alike), unknown, before, after, remaining, likelier, searched)


def _known_stage(was: RigReference) -> Known:
    """What the reference says of the stage."""
    return Known.of_model(RigModel(StageModel(*was.stage.axes), {}, kind="pi"))


def _named(
    stage: Stage, was: RigReference, searched: Searched, found: Sequence[Candidate], radii: dict[int, float]
) -> tuple[list[dict[str, Any]], list[tuple[str, ...]]]:
    """Effects as in the JSON, and names between which the record cannot tell."""
    known = _known_stage(was)
    effects = stage_effects(stage, known)
    gain = changed(stage, rig.servo_gain, known)
    if gain is not None and not any(c.effect == "tilt_gain" for c in found):
        effects.append(gain)
    for e in effects:
        now = {key: number["value"] for key, number in e["parameters"].items()}
        e["rings"] = {str(ring): {"after": now, "before": e["known_before"]} for ring in radii}
    alike = []
    for c, rivals in zip(searched.found, searched.rivals, strict=True):
        if c not in found or not c.effect:
            continue
        effects.append(in_registry(c, searched.fit, was.body, radii))
        names = tuple(r.effect for r in rivals if r.effect)
        if names:
            alike.append((c.effect, *names))
    return [with_plan(effect) for effect in effects], alike


def _radii(maze: Maze, filtered: Filtered) -> dict[int, float]:
    """Track radii of the rings that the ball was in, those with most pictures first, m."""
    r = np.hypot(*filtered.state[np.isfinite(filtered.nu[:, 0]), :2].T)
    rings = [ring for ring in maze.rings if ring.track_radius]
    counts = {ring.number: int(np.sum((r > ring.inner_radius) & (r < ring.outer_radius))) for ring in rings}
    seen = sorted((n for n in counts if counts[n]), key=lambda n: -counts[n])
    return {number: maze.track_radius(number) for number in seen}


def _remaining(body: BodyFilter, searched: Searched) -> float:
    """Root mean square of the innovations, over what it would be if nothing unexplained moved the ball."""
    model = searched.fit.model
    quiet = body.run(model._replace(wander=model.wander._replace(plane=1e-6, strike=1e-3)))
    seen = searched.fit.filtered
    keep = np.isfinite(seen.nu[:, 0]) & np.isfinite(quiet.nu[:, 0])
    return math.sqrt(float(np.mean(seen.nu[keep] ** 2) / np.mean(quiet.S[keep, :2])))


def _unknown(searched: Searched, found: Sequence[Candidate], remaining: float) -> dict[str, Any] | None:
    """What has no name: a candidate without one, or innovations that remember."""
    nameless = [c.words for c in found if not c.effect]
    if nameless:
        return {"depends_on": ["contact"], "description": "; ".join(nameless)}
    memory = float(np.max(np.abs(autocorrelation(searched.fit.filtered))))
    if memory > MEMORY or remaining > REMAINS:
        what = f"what remains is {remaining:.1f} times the noise, and is alike from picture to picture"
        return {"depends_on": [], "description": what}
    return None


def _held_out(
    body: BodyFilter, was: RigReference, searched: Searched, table: Table, maze: Maze
) -> tuple[float, dict[str, float], dict[str, float]]:
    """By how many standard errors blocks of time are likelier with what was found; errors of roll-outs without and with
    it. Each half of the record is predicted with the numbers that the other half tells."""
    n, plain = len(body.pictures), searched.first.filtered
    second = np.arange(n) >= n // 2
    starts = _starts(body, plain, maze)
    old, _ = body_filter(table, maze, was.stage)
    before = _errors(old, was.body.model._replace(wander=searched.first.model.wander), starts)
    if not searched.found:
        return math.inf, _means(before), _means(_errors(body, searched.first.model, starts))
    names = [*NOISE, *(name for c in searched.found for name in c.free)]
    gain, after = np.zeros(n), np.empty_like(before)
    for rows in (second, ~second):
        told = BodyFilter(_part(body.pictures, ~rows), body.plate, body.walls)
        model = fit_body(told, searched.fit.model, names, STEPS, ENOUGH).model
        gain[rows] = (_surprise(plain) - _surprise(body.run(model)))[rows]
        after[:, rows[starts]] = _errors(body, model, starts[rows[starts]])
    blocks = np.add.reduceat(np.nan_to_num(gain), np.arange(0, n, round(BLOCK_S / body.pictures.dt)))
    likelier = float(blocks.mean() / max(blocks.std(ddof=1) / math.sqrt(len(blocks)), 1e-12))
    return likelier, _means(before), _means(after)


def _part(p: Pictures, rows: np.ndarray) -> Pictures:
    return replace(p, t=p.t[rows], y=p.y[rows], first=p.first[rows])


def _starts(body: BodyFilter, filtered: Filtered, maze: Maze) -> IntArray:
    """Pictures from which the ball is followed: outside the disc, with none of the next ones in another stretch."""
    n, first = len(body.pictures), body.pictures.first
    disc = max((ring.outer_radius for ring in maze.rings if ring.is_disc), default=0.0)
    begun = np.cumsum(first)
    good = np.isfinite(filtered.nu[: n - AHEAD, 0]) & (begun[: n - AHEAD] == begun[AHEAD:])
    good &= np.min([np.hypot(*filtered.state[k : n - AHEAD + k, :2].T) for k in (0, AHEAD // 2, AHEAD)], axis=0) > disc
    return np.flatnonzero(good)[::EVERY]


def _means(errors: Array) -> dict[str, float]:
    return {f"rollout{AHEAD // 2}": _mean(errors[0]), f"rollout{AHEAD}": _mean(errors[1])}


def _mean(errors: Array) -> float:
    return round(float(np.nanmean(errors)), 4)


def _surprise(filtered: Filtered) -> Array:
    """nu' S^-1 nu + log det S of each picture, (N,)."""
    (a, b), (xx, yy, xy) = filtered.nu.T, filtered.S.T
    det = xx * yy - xy * xy
    return np.asarray(np.log(det) + (a * a * yy - 2.0 * a * b * xy + b * b * xx) / det)


def _errors(body: BodyFilter, model: BodyModel, starts: IntArray) -> Array:
    """Errors (2, W) of the angle, rad, 20 and 40 samples behind some pictures, along the plate's motion."""
    state, y = body.run(model).state, body.pictures.y
    places, out = body.rolled_out(model, state, starts, AHEAD), []
    for ahead in (AHEAD // 2, AHEAD):
        there, told = y[starts + ahead], places[:, ahead]
        error = difference(np.arctan2(told[:, 1], told[:, 0]), np.arctan2(there[:, 1], there[:, 0]))
        out.append(np.abs(error))
    return np.array(out)
