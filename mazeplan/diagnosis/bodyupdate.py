"""From a rig's model and what differs from its reference, the model of the rig as it is now.

The model of beads has its own numbers for what a body does (its inertia is that of a ball that leans on walls), so it
is moved by as much as the body's numbers moved, and not set to them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mazeplan.constants import FREE_ROLLING
from mazeplan.diagnosis.bodyreference import RigReference
from mazeplan.diagnosis.bodysearch import Reference
from mazeplan.diagnosis.bodyverdict import BodyVerdict
from mazeplan.diagnosis.update import DRIFT, UNTIL, not_planned, updated
from mazeplan.estimation.bodynumbers import with_body
from mazeplan.maze.geometry import Maze
from mazeplan.models.modelfile import RigModel
from mazeplan.physics.effect import BALL, STAGE
from mazeplan.physics.entries import part_values
from mazeplan.physics.registry import EFFECTS

INERTIA, PLACED = "rolling_inertia", ("surface_bump", "table_rocking", "local_friction", "gate_loss", DRIFT)
FACTORS = ("camera_scale", "tilt_gain")  # scales multiply


def changes_model(effects: Sequence[Mapping[str, Any]]) -> bool:
    """Whether one of some effects has a place in a model."""
    return any(effect["name"] == DRIFT or not not_planned([effect["name"]]) for effect in effects)


def moved_model(model: RigModel, maze: Maze, effects: Sequence[Mapping[str, Any]], fit: Any) -> RigModel:
    """The model with effects as `bodyverdict` names them; fit: the body found, which a model that has one gets."""
    bodied, had_body = model, model.body is not None
    for effect in effects:
        if effect["name"] != DRIFT and not_planned([effect["name"]]):
            continue
        found = {int(ring): [_entry(bodied, int(ring), effect, both)] for ring, both in effect["rings"].items()}
        bodied = updated(bodied, maze, {ring: e for ring, e in found.items() if e[0] is not None})
    return with_body(bodied, fit.model, fit.stderr) if had_body else bodied


def reference_after(done: BodyVerdict) -> RigReference:
    """What the rig is like with what was found, for the next diagnosis."""
    body = done.was.body
    found = Reference(done.searched.fit.model, {**body.stderr, **done.searched.fit.stderr})
    return RigReference(found, done.was.stage, done.memory, done.remaining)


def _entry(model: RigModel, ring: int, effect: Mapping[str, Any], both: Mapping[str, Any]) -> Any:
    """An effect of a ring as the JSON has it, with the model's own numbers moved; None where it is too small there."""
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
        values = own | {
            key: own[key] * value / before[key] if name in FACTORS else own[key] + value - before[key]
            for key, value in now.items()
        }
    told, parameters = effect["parameters"], {}
    for key, value in values.items():
        stderr = told[key]["stderr"] if key in told else None
        parameters[key] = {"value": value, "stderr": stderr, "unit": kind.parameters[key].unit}
    if name == "local_friction":
        parameters["ring"] = {"value": float(ring), "stderr": None, "unit": "1"}
    return {"name": name, "parameters": parameters, UNTIL: effect.get(UNTIL, 0.0)}


def _own(model: RigModel, ring: int, name: str) -> dict[str, float]:
    """What the model says of an effect, in a ring."""
    effect = EFFECTS[name]
    if effect.acts not in BALL:
        return part_values(model, effect)
    ball = model.ball(ring)
    return {key: ball.parameter(name, key, p.default) for key, p in effect.parameters.items()}
