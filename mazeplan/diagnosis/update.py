"""The new model after a diagnosis: the old model with the entries of the effects that were found.

| effect | entry |
|---|---|
| of stage, tilt sensor, camera | where its definition says (`Effect.entry`) |
| of the ball, the same everywhere (`common`) | in every ring |
| of the ball, others | in the rings where the effect was found |
| friction_drift | viscous friction at the end of the record |

A value outside the model's bounds becomes the nearest bound. Gaussian processes stay: they learned the edges and joints
of the maze on top of the old effects, and these edges and joints have not moved.

A diagnosis of a whole rig has numbers of a rigid ball. Those in a model of beads differ: a bead has the inertia of a
ball that leans on walls. So the numbers of the beads change by as much as those of the rigid ball changed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from mazeplan.control.estimation.rigid_body_filter import BodyModel
from mazeplan.control.estimation.rigid_body_fit import BodyFit, value_of, with_body, with_values
from mazeplan.core.constants import FREE_ROLLING
from mazeplan.diagnosis.document import effect_entry, values_of
from mazeplan.diagnosis.rig.fitting import Reference
from mazeplan.diagnosis.rig.record import seconds_of
from mazeplan.diagnosis.rig.reference import RigReference
from mazeplan.diagnosis.rig.verdict import RigVerdict
from mazeplan.diagnosis.stage.comparison import Known
from mazeplan.learning.modelfile import RigModel
from mazeplan.learning.rig_model import part_values, with_part
from mazeplan.learning.rigid_body_entries import PARAMETERS
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effect import BALL, STAGE, Effect
from mazeplan.physics.effects.ball import NO_CLOCK
from mazeplan.physics.effects.local_forces import FAMILY, drag_drift
from mazeplan.physics.registry import EFFECTS, make_term
from mazeplan.physics.rig.stage import StageModel

Found = Mapping[int, Sequence[Mapping[str, Any]]]  # ring -> effects as in the JSON of a diagnosis
DRIFT, FRICTION, UNTIL = "friction_drift", "viscous_friction", "until_s"
INERTIA, PLACED = "rolling_inertia", ("surface_bump", "table_rocking", "local_friction", "gate_loss", DRIFT)
IN_TIME = tuple(name for name, effect in FAMILY.items() if effect.why_not == NO_CLOCK)  # begin anew with a record
FACTORS = ("camera_scale", "tilt_gain")  # scales multiply
# every reference has these; it may lack other effects, and a fit of records does not look for quadratic drag
NUMBERS = {number.effect for name, number in PARAMETERS.items() if name != "quadratic"}


def base_model(ring: int | None, declared: Mapping[str, Mapping[str, float]], stage: StageModel | None) -> RigModel:
    """The model with the declared effects, for one ring (None: ring 1).

    stage: the fitted stage; None: textbook values"""
    effects = tuple(make_term(name, values) for name, values in declared.items() if EFFECTS[name].acts in BALL)
    model = RigModel(stage or StageModel(), {ring or 1: BallModel(effects)}, kind="pi")
    for name, values in declared.items():
        if EFFECTS[name].acts not in BALL:
            model = with_part(model, EFFECTS[name], values, {})
    return model


def updated(model: RigModel, found: Found) -> RigModel:
    """The model with the found effects."""
    for ring, entry in ((ring, entry) for ring, effects in found.items() for entry in effects):
        effect = EFFECTS.get(entry["name"])
        if effect is None:
            continue
        values = values_of(entry)
        stderr = {key: p["stderr"] or math.inf for key, p in entry["parameters"].items()}
        if effect.name == DRIFT:
            effect, until = EFFECTS[FRICTION], entry.get(UNTIL, 0.0)
            was = model.ball(ring).parameter(FRICTION, "coefficient", 0.0)
            values = {"coefficient": max(was + values["start"] + values["rate"] * until, 0.0)}
            start, rate = (entry["parameters"][key]["stderr"] or 0.0 for key in ("start", "rate"))
            stderr = {"coefficient": math.hypot(start, rate * until)}
        if effect.acts not in BALL:
            model = with_part(model, effect, values, stderr)
            continue
        rings = model.balls if effect.common else (ring,)
        balls = {number: with_effect(model.ball(number), effect.name, values, stderr) for number in rings}
        model = replace(model, balls={**model.balls, **balls})
    return model


def with_effect(ball: BallModel, name: str, values: Mapping[str, float], stderr: Mapping[str, float]) -> BallModel:
    """The ball with an effect at these values, each limited to the bounds of its parameter."""
    allowed = EFFECTS[name].parameters
    inside = {key: min(max(v, allowed[key].low), allowed[key].high) for key, v in values.items() if key in allowed}
    new, errors = make_term(name, inside), {**ball.stderr, name: dict(stderr)}
    if any(e.name == name for e in ball.effects):
        return BallModel(tuple(new if e.name == name else e for e in ball.effects), errors)
    return BallModel((*ball.effects, new), errors)


def kept_in_model(effects: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The effects that a model can hold."""
    return [e for e in effects if e["name"] == DRIFT or (e["name"] in EFFECTS and EFFECTS[e["name"]].planned)]


def moved_model(
    model: RigModel, effects: Sequence[Mapping[str, Any]], fit: BodyFit, zero: Mapping[str, float] | None = None
) -> RigModel:
    """The model with the effects of a verdict.

    fit: the rigid ball, for a model that contains one
    zero: by how much the tilt sensor's zero moved (`RigVerdict.zero`)"""
    new = model
    for effect in kept_in_model(effects):
        found = {int(ring): [_entry(new, int(ring), effect, both)] for ring, both in effect["rings"].items()}
        kind = EFFECTS[effect["name"]]
        if kind.acts not in BALL or kind.common:  # one estimate: the same in several rings, it would look surer
            found = dict(list(found.items())[:1])
        new = updated(new, {ring: e for ring, e in found.items() if e[0] is not None})
    if zero:
        new = _on_zero(new, zero, felt=any(e["name"] == "tilt_offset" and "by" not in e for e in effects))
    if model.body is None:
        return new
    until = max((effect.get(UNTIL, 0.0) for effect in effects), default=0.0)
    now, stderr = _at_the_end(fit.model, fit.stderr, until)
    return with_body(new, _on_plate(now, zero or {}), stderr)


def _on_zero(model: RigModel, zero: Mapping[str, float], felt: bool) -> RigModel:
    """The model in tilts as the sensor shows them now. felt: whether its table has moved with the ball, by commands"""
    stage, balls = model.stage, model.balls
    beta, gamma = (
        replace(axis, offset=axis.offset + zero[name]) for name, axis in (("beta", stage.beta), ("gamma", stage.gamma))
    )
    for ring, ball in balls.items() if felt else ():
        values = {axis: ball.parameter("tilt_offset", axis, 0.0) - moved for axis, moved in zero.items()}
        balls = {**balls, ring: with_effect(ball, "tilt_offset", values, {})}
    return replace(model, stage=StageModel(beta, gamma), balls=balls)


def _on_plate(model: BodyModel, zero: Mapping[str, float]) -> BodyModel:
    """The ball on a table whose lean counts from the tilt sensor's new zero."""
    return with_values(model, {f"tilt_{axis}": value_of(model, f"tilt_{axis}") - d for axis, d in zero.items()})


def reference_after(done: RigVerdict) -> RigReference:
    """The reference for the next diagnosis: the rig with what was found."""
    body, plate, known, zero = done.was.body, done.plate, done.was.stage, done.zero
    fit = done.searched.fit
    model, errors = _at_the_end(fit.model, {**body.stderr, **fit.stderr}, seconds_of(plate.body))
    rig = RigModel(known.kind if plate.moves is None else plate.moves, {}, kind="pi")
    if zero:
        model, rig = _on_plate(model, zero), _on_zero(rig, zero, felt=False)
    if "tilt_gain" in known.values:
        rig = with_part(rig, EFFECTS["tilt_gain"], known.values["tilt_gain"], {})
    if plate.sensor is not None:  # commands and measured tilt move the plate of the next record
        grown = {axis: value / plate.sensor["known_before"][axis] for axis, value in values_of(plate.sensor).items()}
        model = with_values(model, {f"gain_{axis}": value_of(model, f"gain_{axis}") / g for axis, g in grown.items()})
        rig = with_part(rig, EFFECTS["tilt_gain"], values_of(plate.sensor), {})
    kept = plate.moves is not None and plate.sensor is None and not zero
    return RigReference(
        Reference(model, errors), Known.of_model(rig), done.memory, done.remaining,
        imbalance=max(done.imbalance, done.was.imbalance), table=plate.table if kept else None,
        then=plate.body if kept else None,
    )  # fmt: skip


def _at_the_end(model: BodyModel, stderr: Mapping[str, float], until: float) -> tuple[BodyModel, dict[str, float]]:
    """The ball and its standard errors at the end of a record, without terms in the time of this record.

    Drifting friction becomes viscous friction. The phase of what swings is not known any more."""
    known = {name: error for name, error in stderr.items() if name.partition(".")[0] not in IN_TIME}
    drift = next((term.values() for term in model.terms if term.name == drag_drift.name), None)
    if drift is not None:
        number = PARAMETERS["viscous"]
        value = value_of(model, "viscous") + drift["start"] + drift["rate"] * until
        model = with_values(model, {"viscous": min(max(value, number.low), number.high)})
        # the fit held `viscous`, and start and rate are correlated: the end of a line is as uncertain as its start
        known["viscous"] = stderr.get(f"{drag_drift.name}.start", 0.0)
    return model._replace(terms=tuple(term for term in model.terms if term.name not in IN_TIME)), known


def _entry(model: RigModel, ring: int, effect: Mapping[str, Any], both: Mapping[str, Any]) -> Any:
    """The entry of an effect in a ring, with changed numbers of the model; None if the effect is too small there."""
    name, now, before = effect["name"], both["after"], both["before"]
    kind = EFFECTS[name]
    if name in PLACED or kind.acts == STAGE:
        if name == "surface_bump" and abs(now["height"]) < kind.parameters["height"].smallest:
            return None
        # drift of the reference is in the model already
        values = {key: value - before.get(key, 0.0) for key, value in now.items()} if name == DRIFT else dict(now)
    elif name == INERTIA:
        k, was = (1.0 / numbers["factor"] - 1.0 for numbers in (now, before))
        own = model.ball(ring).parameter(name, "factor", FREE_ROLLING)
        values = {"factor": 1.0 / (1.0 + (1.0 / own - 1.0) * k / was)}
    else:
        ball = model.ball(ring)
        own = {key: ball.parameter(name, key, p.default) for key, p in kind.parameters.items()}
        own = own if kind.acts in BALL else part_values(model, kind)
        values = own | {key: _moved(kind, key, own[key], value, before[key]) for key, value in now.items()}
    if name == "local_friction":
        values["ring"] = float(ring)
    stderr = {key: effect["parameters"].get(key, {}).get("stderr") for key in values}
    return effect_entry(kind, values, stderr) | {UNTIL: effect.get(UNTIL, 0.0)}


def _moved(effect: Effect, key: str, own: float, now: float, before: float) -> float:
    """A number of the model that changes as from `before` to `now`."""
    if effect.name in FACTORS:
        return own * now / before
    lacking = f"{effect.name}.{key}" not in NUMBERS and before == effect.parameters[key].default
    if lacking and now != before:  # then `now` is all of it, with the model's own share
        return now
    return own + now - before
