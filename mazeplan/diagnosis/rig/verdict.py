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

import numpy as np

from mazeplan.control.estimation.rigid_body_filter import BodyFilter, Filtered
from mazeplan.control.estimation.rigid_body_fit import fit_body
from mazeplan.control.estimation.rigid_body_parameters import value_of, with_values
from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.effect_entry import Entry, effect_entry, values_of, with_plan
from mazeplan.diagnosis.record import RingRecord, record_of
from mazeplan.diagnosis.rig.camera import check_map
from mazeplan.diagnosis.rig.candidates import CANDIDATES, CONTACT, Candidate
from mazeplan.diagnosis.rig.differences import search_against
from mazeplan.diagnosis.rig.entry_words import BY_SENSOR
from mazeplan.diagnosis.rig.fitting import ENOUGH, NOISE, POLISH
from mazeplan.diagnosis.rig.imbalance import also_in, imbalance_entry, unbalanced
from mazeplan.diagnosis.rig.notes import notes_on
from mazeplan.diagnosis.rig.record import filter_of, residual_summary, seconds_of, whole_record
from mazeplan.diagnosis.rig.reference import RigReference, fit_reference, kind_of
from mazeplan.diagnosis.rig.registry import registry_entry
from mazeplan.diagnosis.rig.result import REMAINS, TWICE, RigVerdict, Unknown
from mazeplan.diagnosis.rig.scores import BETTER, HeldOut, held_out, on_test
from mazeplan.diagnosis.rig.search import NEEDED, SearchResult, one_ball_instead, surely_differs
from mazeplan.diagnosis.rig.tilts import as_it_was, felt, gain_of
from mazeplan.diagnosis.rig.unseen_stage import UnseenChange, unseen_change
from mazeplan.diagnosis.stage.comparison import (
    AXES,
    moved_by,
    moved_zero,
    settled_on,
    stage_effects,
)
from mazeplan.diagnosis.stage.navigation import (
    coupling_in_navigation,
    servos_look_changed,
)
from mazeplan.diagnosis.stage.plate_motion import Stage, fit_stage
from mazeplan.learning.unmeasured_tilt import stage_by_ball, tilt_is_measured, with_tilt_by_commands
from mazeplan.maze.geometry import Maze
from mazeplan.physics.dynamics.rigid_body_effects import effects_of
from mazeplan.physics.effect import Effect
from mazeplan.physics.registry import PACKAGED

MEMORY = 0.1  # autocorrelation of innovations above which something is unexplained
LEAST_REMAINS = 1.1  # times the noise; in healthy records, small errors of the reference's numbers cause less
WORSE = 1.7  # minimum error over the error when the model was right, mean over rings, to report it
HEALTHY, SURE = 1.2, 3.5  # the same ratio in healthy records; standard errors by which it has to be higher
HARDLY = 3.0  # maximum change of a small effect, in smallest sizes
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
    blind = not tilt_is_measured(table) and "u_beta" in table and "u_gamma" in table
    if blind:  # the old servos move the plate, and the ball shows what changed
        moves, stage = was.stage.axes() or stage_by_ball(table, maze), None
        table = with_tilt_by_commands(table, moves)
        record = whole_record(table)
    else:
        record = whole_record(table)
        kind = was.stage.kind if was.body.start is None else kind_of(table)
        stage = fit_stage(record, np.ones(len(record), dtype=bool), kind)
        was = replace(was, stage=was.stage.beside(stage))
        stage = settled_on(stage, record, was.stage)
        moves = moved_by(stage, was.stage)
    overtaxed = stage is not None and stage.servos_overtaxed
    body = filter_of(table, record, maze, moves)
    check_map(body, maze, table.place)
    servo, sensor = gain_of(body, record, stage, was)
    measured, body = body, body if sensor is None else felt(body, sensor)
    begun = was.body
    if begun.start is not None:  # a textbook's numbers are far from those of any rig
        begun = replace(begun, start=fit_reference(body, begun.start).model)
    then = was.then
    if overtaxed and then is not None and was.table is not None:  # as in this record, the measured tilt moves the plate
        then = filter_of(was.table, whole_record(was.table), maze, None, then)
    # without a tilt sensor, another ball looks like another gain of both servos, which nobody sees
    known, searched = search_against(body, begun, then, maze, tell, own, ("rolling_inertia",) if blind else ())
    if stage is not None and not overtaxed and servo is None and sensor is None:
        searched = one_ball_instead(body, searched, known)
    unseen = None
    if not overtaxed and (stage is None or not stage.differs):
        like = body
        unseen = unseen_change(
            searched, known, body, moves, lambda axes: filter_of(table, record, maze, axes, like), not blind
        )
    if unseen is not None:
        body, moves = unseen.body, unseen.moves
        known, searched = search_against(body, begun, then, maze, tell, own, ("rolling_inertia",) if blind else ())
    was = replace(was, body=replace(known, start=was.body.start))
    tell("held-out part")
    # the old model does not know of a changed scale of the sensor: it would believe the measured tilts
    old = measured if sensor is not None or unseen is not None else as_it_was(table, maze, was, stage, body)
    held = held_out(body, old, was.body.start or was.body.model, searched, maze)
    # roll-outs through impacts scatter: they refuse what acts at walls only if they are surely worse, so that the gain
    # in held-out blocks has to be sure
    at_walls = all(CONTACT in c.depends_on for c in searched.found)
    sure = held.likelier and (held.z_score > SURELY or not at_walls)
    found = searched.found if sure and held.ball_effects_not_worse(BETTER if at_walls else 1.0) else ()
    radii = _radii(maze, searched.fit.filtered)
    staged = _of_the_stage(record, stage, was, radii, servo, sensor, found, unseen)
    ball, alike = _of_the_ball(was, searched, found, radii, sensor)
    if blind:
        ball, alike = _by_servos(ball, alike, was)
    effects = _with_asymmetry([*staged, *ball]) + _of_open_numbers(body, searched, was, radii)
    effects = [with_plan(effect) for effect in effects]
    for e in effects:
        if e["name"] == "friction_drift":
            e["until_s"] = round(seconds_of(body), 3)
    memory, remaining = residual_summary(body, searched.fit)
    unknown = _unknown(searched, found, memory, remaining, was)
    if unknown is None and not effects and not overtaxed:
        unknown = _worse_than_before(held, was)
    # overtaxed servos: the measured tilt moves the plate, so roll-outs of the ball cannot judge the stage
    by_tilt = {e["name"] for e in staged} if overtaxed else set[str]()
    judged = [e for e in effects if e["name"] not in by_tilt]
    if judged and not held.better:
        names = ", ".join(e["name"].replace("_", " ") for e in judged)
        looks = f"it looks like {names}, but predicts the ball no better"
        if all(_small(e) for e in judged):
            refused.append(looks)
        else:
            unknown = Unknown(looks, ("tilt",))
        effects, alike, found = [e for e in effects if e["name"] in by_tilt], [], ()
    effects += _by_zero(stage, was, effects, radii)
    unknown = _with_servos(unknown, stage, was)
    standing = _standing(searched, found, effects)
    if standing is not searched:
        memory, remaining = residual_summary(body, standing.fit)
    noises = [value_of(model, "noise") for model in (was.body.model, standing.fit.model)]
    if noises[1] > LOUDER * noises[0]:
        refused.append(f"the noise of the camera grew from {1e3 * noises[0]:.2g} to {1e3 * noises[1]:.2g} mm")
    done = RigVerdict(
        tuple(effects), tuple(alike), unknown, held, memory, remaining, standing, body, stage, was,
        (*notes_on(table, stage, was, blind), *refused), sensor=sensor, moves=moves, table=table,
    )  # fmt: skip
    done = _with_imbalance(done, radii)
    return done if test is None else replace(done, test=_on_test(test, maze, done))


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
    if entry is None or (then is not None and also_in(then, done.was.body.model, imbalance, len(done.body.pictures))):
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


def _small(effect: Entry, most: float = HARDLY) -> bool:
    """Whether all changes of an effect are at most so many of its smallest sizes."""
    had, known = effect["known_before"], PACKAGED.get(effect["name"])
    return known is not None and all(
        abs(value - had[key]) <= most * known.parameters[key].smallest for key, value in values_of(effect).items()
    )


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


def _of_the_stage(
    record: RingRecord, stage: Stage | None, was: RigReference, radii: dict[int, float],
    servo: Entry | None, sensor: Entry | None, found: Sequence[Candidate], unseen: UnseenChange | None,
) -> list[Entry]:  # fmt: skip
    """Effects of stage and tilt sensor, the same in all rings."""
    if stage is not None and stage.servos_overtaxed:
        effects = coupling_in_navigation(record, stage, was.stage)
    else:
        effects = stage_effects(stage, was.stage)
    if sensor is not None:
        effects.append(sensor)
    elif servo is not None and not any(c.effect == "tilt_gain" for c in found):
        effects.append(servo)
    effects += [] if unseen is None else [unseen.entry]
    for e in effects:
        e["rings"] = {str(ring): {"after": values_of(e), "before": e["known_before"]} for ring in radii}
    return effects


def _of_the_ball(
    was: RigReference, searched: SearchResult, found: Sequence[Candidate], radii: dict[int, float], sensor: Entry | None
) -> tuple[list[Entry], list[tuple[str, ...]]]:
    """Effects of ball, table and camera, and names that the record cannot tell apart."""
    effects, alike, others = list[Entry](), list[tuple[str, ...]](), {name for c in found for name in c.instead}
    for c, rivals in zip(searched.found, searched.rivals, strict=True):
        if c not in found or not c.effect or c.effect in others or (c.effect == "tilt_gain" and sensor is not None):
            continue
        if any(e["name"] == c.effect for e in effects):  # sliding and rolling at walls: two numbers of one effect
            continue
        entry = registry_entry(c, searched.fit, was.body, radii)
        if _small(entry, 1.0):  # a number of the rigid ball changed with another one, and what it does hardly changed
            continue
        effects.append(entry)
        names = tuple(r.effect for r in rivals if r.effect)
        if names:
            alike.append((c.effect, *names))
    return effects, alike


def _by_servos(
    ball: list[Entry], alike: list[tuple[str, ...]], was: RigReference
) -> tuple[list[Entry], list[tuple[str, ...]]]:
    """The same without a tilt sensor: nothing has a scale, a late command looks like a late picture, and the same gain
    of both servos like another ball."""
    had, out = was.stage.values.get("servo_gain") or dict.fromkeys(AXES, 1.0), list[Entry]()
    for e in ball:
        if e["name"] == "tilt_gain":
            now = {axis: had[axis] / value for axis, value in values_of(e).items()}
            stderr = {axis: now[axis] ** 2 / had[axis] * e["parameters"][axis]["stderr"] for axis in AXES}
            both = {"after": now, "before": had}
            e = effect_entry(PACKAGED["servo_gain"], now, stderr, had, rings=dict.fromkeys(e["rings"], both))
            (one, two), (a, b) = (now[axis] / had[axis] for axis in AXES), stderr.values()
            if abs(one - two) < SURE * math.hypot(a, b):
                alike = [*alike, ("servo_gain", "rolling_inertia")]
        elif e["name"] == "sensor_delay":
            alike = [*alike, ("sensor_delay", "command_delay")]
        out.append(e)
    return out, alike


def _by_zero(stage: Stage | None, was: RigReference, effects: Sequence[Entry], radii: dict[int, float]) -> list[Entry]:
    """The table against a tilt sensor whose zero moved, and the ball does not feel it."""
    moved = moved_zero(stage, was.stage)
    if stage is None or not moved or any(e["name"] == "tilt_offset" for e in effects):
        return []
    had = {axis: value_of(was.body.model, f"tilt_{axis}") for axis in AXES}
    now = {axis: had[axis] - moved[axis] for axis in AXES}
    stderr = {axis: seen.stderr["offset"] for axis, seen in zip(AXES, stage.axes, strict=True)}
    both = {"after": now, "before": had}
    entry = effect_entry(PACKAGED["tilt_offset"], now, stderr, had, rings={str(ring): both for ring in radii})
    return [with_plan(entry | BY_SENSOR)]


def _with_asymmetry(effects: list[Entry]) -> list[Entry]:
    """Replace dry friction and a weaker push along the rings by friction with an asymmetry.

    A moving ball feels the same."""
    by_name = {effect["name"]: effect for effect in effects}
    friction, push = by_name.get("dry_friction"), by_name.get("constant_torque")
    if friction is None or push is None:
        return effects
    numbers, pushed = friction["parameters"], push["parameters"]["acceleration"]
    if abs(pushed["value"]) > numbers["coefficient"]["value"]:
        return effects
    numbers["asymmetry"] = {**pushed, "value": -pushed["value"]}
    friction["known_before"]["asymmetry"] = -push["known_before"]["acceleration"]
    for ring, both in friction["rings"].items():
        for when in ("before", "after"):
            both[when] = {**both[when], "asymmetry": -push["rings"][ring][when]["acceleration"]}
    return [effect for effect in effects if effect is not push]


def _of_open_numbers(
    body: BodyFilter, searched: SearchResult, was: RigReference, radii: dict[int, float]
) -> list[Entry]:
    """Effects of numbers that the reference does not know.

    Against a textbook ball, these are all numbers that differ from it. Against a model of beads, this is friction, if
    it is far from the model's friction."""
    fit = searched.fit
    if was.body.start is not None:
        some = [c for c in CANDIDATES if c.effect and set(c.free) <= {*was.body.open, "inertia"}]
        some = [c for c in some if c not in searched.found]
        sure = [c for c in some if surely_differs(fit.model, fit.stderr, was.body, c.free)]
        return [registry_entry(c, fit, was.body, radii) for c in sure]
    if was.friction is None:
        return []
    value, (low, high) = value_of(fit.model, "rolling"), was.friction
    if low <= value <= high:
        return []
    nearest = with_values(fit.model, {"rolling": min(max(value, low), high)})
    rest = [name for name in fit.free if name != "rolling"]
    if fit_body(body, nearest, rest or NOISE, POLISH, ENOUGH).minus2 - fit.minus2 < NEEDED:
        return []
    (friction,) = [c for c in CANDIDATES if c.effect == "dry_friction"]
    return [registry_entry(friction, fit, was.body, radii)]


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
