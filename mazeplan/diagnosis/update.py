"""The new model after a diagnosis: the old model with the entries of the effects that were found.

| effect | entry |
|---|---|
| of stage, tilt sensor, camera | where its definition says (`Effect.entry`) |
| of the ball, the same everywhere (`common`) | in every ring |
| of the ball, others | in the rings where the effect was found |
| friction_drift | viscous friction at the end of the record |

A value outside the model's bounds becomes the nearest bound. Gaussian processes stay: they learned the edges and joints
of the maze on top of the old effects, and these edges and joints have not moved.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from mazeplan.diagnosis.effect_entry import values_of
from mazeplan.learning.modelfile import RigModel
from mazeplan.learning.rig_model import with_part
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effect import BALL
from mazeplan.physics.registry import EFFECTS, make_term
from mazeplan.physics.rig.stage import StageModel

Found = Mapping[int, Sequence[Mapping[str, Any]]]  # ring -> effects as in the JSON of a diagnosis
DRIFT, FRICTION, UNTIL = "friction_drift", "viscous_friction", "until_s"


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
