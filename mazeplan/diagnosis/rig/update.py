"""The model of a rig as it is now, from its old model and what differs from the reference.

The numbers in a model of beads differ from those of a rigid ball: a bead has the inertia of a ball that leans on walls.
So the numbers of the beads change by as much as those of the rigid ball changed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mazeplan.control.estimation.rigid_body_fit import BodyFit
from mazeplan.control.estimation.rigid_body_parameters import with_body
from mazeplan.core.constants import FREE_ROLLING
from mazeplan.diagnosis.effect_entry import effect_entry
from mazeplan.diagnosis.rig.reference import RigReference
from mazeplan.diagnosis.rig.result import RigVerdict
from mazeplan.diagnosis.rig.search import Reference
from mazeplan.diagnosis.update import DRIFT, UNTIL, updated
from mazeplan.learning.modelfile import RigModel
from mazeplan.learning.rigid_body_entries import PARAMETERS
from mazeplan.physics.effect import BALL, STAGE, Effect
from mazeplan.physics.registry import EFFECTS
from mazeplan.physics.rig.entries import part_values

INERTIA, PLACED = "rolling_inertia", ("surface_bump", "table_rocking", "local_friction", "gate_loss", DRIFT)
FACTORS = ("camera_scale", "tilt_gain")  # scales multiply
# every reference has these; it may lack other effects, and a fit of records does not look for quadratic drag
NUMBERS = {number.effect for name, number in PARAMETERS.items() if name != "quadratic"}


def changes_model(effects: Sequence[Mapping[str, Any]]) -> bool:
    """Whether a model can hold one of these effects."""
    return any(_in_model(effect["name"]) for effect in effects)


def _in_model(name: str) -> bool:
    return name == DRIFT or (name in EFFECTS and EFFECTS[name].planned)


def moved_model(model: RigModel, effects: Sequence[Mapping[str, Any]], fit: BodyFit) -> RigModel:
    """The model with the effects of a verdict. fit: the rigid ball, for a model that contains one"""
    new = model
    for effect in (e for e in effects if _in_model(e["name"])):
        found = {int(ring): [_entry(new, int(ring), effect, both)] for ring, both in effect["rings"].items()}
        kind = EFFECTS[effect["name"]]
        if kind.acts not in BALL or kind.common:  # one estimate: the same in several rings, it would look surer
            found = dict(list(found.items())[:1])
        new = updated(new, {ring: e for ring, e in found.items() if e[0] is not None})
    return new if model.body is None else with_body(new, fit.model, fit.stderr)


def reference_after(done: RigVerdict) -> RigReference:
    """The reference for the next diagnosis: the rig with what was found."""
    body = done.was.body
    found = Reference(done.searched.fit.model, {**body.stderr, **done.searched.fit.stderr})
    return RigReference(found, done.was.stage, done.memory, done.remaining)


def _entry(model: RigModel, ring: int, effect: Mapping[str, Any], both: Mapping[str, Any]) -> Any:
    """The entry of an effect in a ring, with changed numbers of the model; None if the effect is too small there."""
    name, now, before = effect["name"], both["after"], both["before"]
    kind = EFFECTS[name]
    if name in PLACED or kind.acts == STAGE:
        if name == "surface_bump" and abs(now["height"]) < kind.parameters["height"].smallest:
            return None
        values = dict(now)
    elif name == INERTIA:
        k, was = (1.0 / numbers["factor"] - 1.0 for numbers in (now, before))
        own = model.ball(ring).parameter(name, "factor", FREE_ROLLING)
        values = {"factor": 1.0 / (1.0 + (1.0 / own - 1.0) * k / was)}
    else:
        own = _own(model, ring, name)
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


def _own(model: RigModel, ring: int, name: str) -> dict[str, float]:
    """The numbers of an effect in the model, for a ring."""
    effect = EFFECTS[name]
    if effect.acts not in BALL:
        return part_values(model, effect)
    ball = model.ball(ring)
    return {key: ball.parameter(name, key, p.default) for key, p in effect.parameters.items()}
