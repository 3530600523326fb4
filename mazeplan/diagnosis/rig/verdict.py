"""The verdict on a record of a rig: what differs from the rig when its model was right.

1. Commands and measured tilt alone show what differs in the stage.
2. The fitted stage moves the plate. The search finds what differs in ball, table and camera (`search`).
   Where the camera seems later, a change of the stage that no tilt sensor shows is tried instead (`unseen_stage`).
3. A changed gain of the stage belongs to the servo. If the ball felt tilts of the old size, it belongs to the tilt
   sensor, whose scale is wrong.
4. The findings have to predict: held-out blocks of time must be likelier with the findings than without.
5. The residual is compared with the camera's noise, and with the residual when the model was right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from mazeplan.control.estimation.rigid_body_filter import Filtered
from mazeplan.control.estimation.rigid_body_parameters import value_of
from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.effect_entry import Entry, with_plan
from mazeplan.diagnosis.record import record_of
from mazeplan.diagnosis.rig.candidates import CONTACT, Candidate
from mazeplan.diagnosis.rig.differences import search_against
from mazeplan.diagnosis.rig.entry_words import plain
from mazeplan.diagnosis.rig.findings import (
    by_zero,
    of_open_numbers,
    of_the_ball,
    of_the_stage,
    small,
    with_asymmetry,
)
from mazeplan.diagnosis.rig.fitting import Reference
from mazeplan.diagnosis.rig.imbalance import also_in, imbalance_entry, unbalanced
from mazeplan.diagnosis.rig.moved_plate import MovedPlate, moved_plate
from mazeplan.diagnosis.rig.notes import notes_on
from mazeplan.diagnosis.rig.record import filter_of, residual_summary, seconds_of, whole_record
from mazeplan.diagnosis.rig.reference import RigReference, fit_reference
from mazeplan.diagnosis.rig.result import REMAINS, TWICE, RigVerdict, Unknown
from mazeplan.diagnosis.rig.scores import BETTER, HeldOut, held_out, on_test
from mazeplan.diagnosis.rig.search import SearchResult, one_ball_instead
from mazeplan.diagnosis.rig.tilts import as_it_was, felt
from mazeplan.diagnosis.rig.unseen_stage import unseen_change
from mazeplan.diagnosis.stage.navigation import servos_look_changed
from mazeplan.diagnosis.stage.plate_motion import Stage
from mazeplan.maze.geometry import Maze
from mazeplan.physics.dynamics.rigid_body_effects import effects_of
from mazeplan.physics.effect import Effect

MEMORY = 0.1  # autocorrelation of innovations above which something is unexplained
LEAST_REMAINS = 1.1  # times the noise; in healthy records, small errors of the reference's numbers cause less
WORSE = 1.7  # minimum error over the error when the model was right, mean over rings, to report it
HEALTHY, SURE = 1.2, 3.5  # the same ratio in healthy records; standard errors by which it has to be higher
SURELY = 4.0  # standard errors of the gain in held-out blocks
LOUDER = 1.5  # times the camera's noise when the model was right
AS_BEFORE = 1.3  # residual over the residual when the model was right: up to this ratio, it is no news


def verdict_on(
    table: Table, maze: Maze, was: RigReference, tell: Callable[[str], None] = lambda text: None,
    test: Table | None = None, own: Sequence[Effect] = (),
) -> RigVerdict:  # fmt: skip
    """What differs from a reference. Raises TableError.

    was: the reference
    tell: reports progress
    test: a further record, for errors before and after
    own: effects of a user, to look for as well"""
    own, refused = _for_a_rigid_body(own)
    was = replace(was, body=replace(was.body, misfit=max(was.remaining, 1.0)))
    tell("stage")
    plate, was = moved_plate(table, maze, was)
    plate, known, searched = _searched(plate, was, maze, tell, own)
    was = replace(was, body=replace(known, start=was.body.start))
    tell("held-out part")
    held = held_out(plate.body, plate.as_it_was(maze, was), was.body.start or was.body.model, searched, maze)
    found = _predicting(searched, held)
    radii = _radii(maze, searched.fit.filtered)
    staged = of_the_stage(plate, was, radii, found)
    ball, alike = of_the_ball(plate, was, searched, found, radii)
    effects = with_asymmetry([*staged, *ball]) + of_open_numbers(plate.body, searched, was, radii)
    effects = [with_plan(effect) for effect in effects]
    for e in effects:
        if e["name"] == "friction_drift":
            e["until_s"] = round(seconds_of(plate.body), 3)
    memory, remaining = residual_summary(plate.body, searched.fit)
    unknown = _unknown(searched, found, memory, remaining, was)
    if unknown is None and not effects and not plate.overtaxed:
        unknown = _worse_than_before(held, was)
    # overtaxed servos: the measured tilt moves the plate, so roll-outs of the ball cannot judge the stage
    by_tilt = staged if plate.overtaxed else []
    judged = [e for e in effects if e["name"] not in {e["name"] for e in by_tilt}]
    if judged and not held.better:
        names = ", ".join(plain(e["name"]) for e in judged)
        looks = f"it looks like {names}, but predicts the ball no better"
        if all(small(e) for e in judged):
            refused.append(looks)
        else:
            unknown = Unknown(looks, ("tilt",))
        effects, alike, found = [e for e in effects if e not in judged], [], ()
    effects += by_zero(plate.stage, was, effects, radii)
    unknown = _with_servos(unknown, plate.stage, was)
    standing = _standing(searched, found, effects)
    if standing is not searched:
        memory, remaining = residual_summary(plate.body, standing.fit)
    notes = (*notes_on(plate.table, plate.stage, was, plate.blind), *refused, *_louder(was, standing))
    done = RigVerdict(
        tuple(effects), tuple(alike), unknown, held, memory, remaining, standing, plate.body, plate.stage, was, notes,
        sensor=plate.sensor, moves=plate.moves, table=plate.table,
    )  # fmt: skip
    done = _with_imbalance(done, radii)
    return done if test is None else replace(done, test=_on_test(test, maze, done))


def _searched(
    plate: MovedPlate, was: RigReference, maze: Maze, tell: Callable[[str], None], own: Sequence[Effect]
) -> tuple[MovedPlate, Reference, SearchResult]:
    """What differs in ball, table and camera, on the plate that explains it best; and the reference."""
    begun, then = was.body, was.then
    if begun.start is not None:  # a textbook's numbers are far from those of any rig
        begun = replace(begun, start=fit_reference(plate.body, begun.start).model)
    if plate.overtaxed and then is not None and was.table is not None:  # as in this record, the measured tilt moves it
        then = filter_of(was.table, whole_record(was.table), maze, None, then)
    # without a tilt sensor, another ball looks like another gain of both servos, which nobody sees
    without = ("rolling_inertia",) if plate.blind else ()
    known, searched = search_against(plate.body, begun, then, maze, tell, own, without)
    if plate.stage is not None and not plate.overtaxed and plate.servo is None and plate.sensor is None:
        searched = one_ball_instead(plate.body, searched, known)
    if plate.stage_is_known and plate.moves is not None:
        on = partial(plate.filter_on, maze)
        unseen = unseen_change(searched, known, plate.moves, on, not plate.blind)
        if unseen is not None:
            plate = plate.behind(unseen)
            known, searched = search_against(plate.body, begun, then, maze, tell, own, without)
    return plate, known, searched


def _predicting(searched: SearchResult, held: HeldOut) -> tuple[Candidate, ...]:
    """The candidates if they predict held-out parts better, none otherwise.

    Roll-outs through impacts scatter: they refuse what acts at walls only if they are surely worse, so that the gain in
    held-out blocks has to be sure."""
    at_walls = all(CONTACT in c.depends_on for c in searched.found)
    sure = held.likelier and (held.z_score > SURELY or not at_walls)
    return searched.found if sure and held.ball_effects_not_worse(BETTER if at_walls else 1.0) else ()


def _louder(was: RigReference, standing: SearchResult) -> list[str]:
    """A note if the camera is noisier than it was."""
    before, now = (value_of(model, "noise") for model in (was.body.model, standing.fit.model))
    grown = f"the noise of the camera grew from {1e3 * before:.2g} to {1e3 * now:.2g} mm"
    return [grown] if now > LOUDER * before else []


def _with_servos(unknown: Unknown | None, stage: Stage | None, was: RigReference) -> Unknown | None:
    """What is unknown, with what overtaxed servos do that they did not do before."""
    words = servos_look_changed(stage, was.stage) if stage is not None and stage.servos_overtaxed else ()
    if not words:
        return unknown
    look = "Look at the servos and their linkage, or learn the model again from a record of mazeplan collect"
    other = unknown or Unknown()
    return Unknown(other.description, (*other.depends_on, "command"), (*other.look, look), tuple(words))


def _standing(searched: SearchResult, found: Sequence[Candidate], effects: Sequence[Entry]) -> SearchResult:
    """The search, with the fit for a new model: without the candidates if effects of the stage alone stand."""
    return replace(searched, fit=searched.without) if effects and not found else searched


def _with_imbalance(done: RigVerdict, radii: Mapping[int, float]) -> RigVerdict:
    """The verdict with an unbalanced ball, if nothing else with a name differs.

    Neither predictions nor fit know the imbalance. More than twice the noise has another cause, too."""
    if done.effects or (done.unknown is not None and done.unknown.depends_on):
        return done
    imbalance = unbalanced(done.body, done.searched.without)
    entry = imbalance_entry(imbalance, done.was.imbalance, radii)
    then = done.was.then
    if entry is None or (then is not None and also_in(then, done.was.body.model, imbalance)):
        return replace(done, imbalance=imbalance)
    searched = replace(done.searched, found=(), gains=(), rivals=(), fit=done.searched.without)
    memory, remaining = residual_summary(done.body, searched.fit)
    return replace(
        done, effects=(with_plan(entry),), unknown=done.unknown if remaining > TWICE else None, searched=searched,
        held=replace(done.held, after=done.held.before, gain=np.zeros_like(done.held.gain)), memory=memory,
        remaining=remaining, imbalance=imbalance,
    )  # fmt: skip


def _worse_than_before(held: HeldOut, was: RigReference) -> Unknown | None:
    """Something without a name, if the ball is predicted much worse than when the model was right, ring by ring."""
    rings = [ring for ring in held.by_ring if was.errors.get(ring)]
    if not rings:
        return None
    now, old = (np.array([held.by_ring[ring] for ring in rings]).T, np.array([was.errors[ring] for ring in rings]))
    worse, stderr = float(np.mean(now[0] / old)), math.sqrt(float(np.sum((now[1] / old) ** 2))) / len(rings)
    if worse < WORSE or worse - SURE * stderr < HEALTHY:
        return None
    what = f"the ball is predicted {worse:.1f} times as badly as when the model was right"
    return Unknown(what, look=("Look at the ball: is it round, clean and evenly heavy?",))


def _for_a_rigid_body(own: Sequence[Effect]) -> tuple[list[Effect], list[str]]:
    """The user's effects that can act on a rigid ball, and notes on the others."""
    good, notes = [], []
    for effect in own:
        try:
            effects_of([effect()])
        except ValueError as problem:
            notes.append(f"{effect.name} was not looked for: {problem}")
        else:
            good.append(effect)
    return good, notes


def _on_test(test: Table, maze: Maze, done: RigVerdict) -> HeldOut:
    """Predictions of a further record, by the old model and by the new one."""
    new = filter_of(test, record_of(test), maze, done.moves)
    new = new if done.sensor is None else felt(new, done.sensor)
    old = as_it_was(test, maze, done.was, done.stage, new)
    return on_test(old, done.was.body.start or done.was.body.model, new, done.searched.fit.model, maze)


def _radii(maze: Maze, filtered: Filtered) -> dict[int, float]:
    """Track radii (m) of the rings in which the ball was, the ring with most pictures first."""
    r = np.hypot(*filtered.state[np.isfinite(filtered.nu[:, 0]), :2].T)
    rings = [ring for ring in maze.rings if ring.track_radius]
    counts = {ring.number: int(np.sum((r > ring.inner_radius) & (r < ring.outer_radius))) for ring in rings}
    seen = sorted((n for n in counts if counts[n]), key=lambda n: -counts[n])
    return {number: maze.track_radius(number) for number in seen}


def _unknown(
    searched: SearchResult, found: Sequence[Candidate], memory: float, remaining: float, was: RigReference
) -> Unknown | None:
    """Something without a name: a candidate without a name, or innovations that are larger or more correlated than
    before. Otherwise None."""
    nameless = [c for c in found if not c.effect]
    if nameless:
        words = "; ".join(c.description(searched.fit.model) for c in nameless)
        depends = tuple(sorted({on for c in nameless for on in c.depends_on}))
        return Unknown(words, depends, tuple(c.look for c in nameless if c.look), cause=True)
    alike = memory > max(MEMORY, AS_BEFORE * was.memory) and remaining > LEAST_REMAINS
    if alike or remaining > max(REMAINS, AS_BEFORE * was.remaining):
        return Unknown(f"what remains is {remaining:.1f} times the noise, and is alike from picture to picture")
    return None
