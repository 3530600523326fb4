"""The new model after a diagnosis: the old model with the entries of the effects that were found.

| effect | entry |
|---|---|
| of stage, tilt sensor, camera | where its definition says (`Effect.entry`) |
| of the ball, the same everywhere (`common`) | in every ring |
| of the ball, others | in the rings where the effect was found |
| friction_drift | viscous friction at the end of the record |

An effect with one value for all rings gets the mean over the rings where it was found, weighted by the standard errors.
A value outside the model's bounds becomes the nearest bound. Gaussian processes stay: they learned the edges and joints
of the maze on top of the old effects, and these edges and joints have not moved.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from mazeplan.learning.modelfile import RigModel
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effect import BALL
from mazeplan.physics.registry import EFFECTS, make_term
from mazeplan.physics.rig.entries import with_part
from mazeplan.physics.rig.stage import StageModel

Parameters = dict[str, dict[str, Any]]  # parameter -> {"value", "stderr", "unit"}
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


def merged(found: Found, name: str) -> Parameters:
    """Weighted means and standard errors of an effect that is the same in all rings."""
    entries = [e["parameters"] for effects in found.values() for e in effects if e["name"] == name]
    out: Parameters = {}
    for key in entries[0] if entries else ():
        numbers = [(e[key]["value"], e[key]["stderr"]) for e in entries]
        weights = [1.0 / s**2 if s and math.isfinite(s) else 0.0 for _, s in numbers]
        known = sum(weights) > 0.0
        stderr = 1.0 / math.sqrt(sum(weights)) if known else math.inf
        weights = weights if known else [1.0] * len(numbers)
        value = sum(w * v for w, (v, _) in zip(weights, numbers, strict=True)) / sum(weights)
        out[key] = {"value": value, "stderr": stderr, "unit": entries[0][key]["unit"]}
    return out


def updated(model: RigModel, found: Found) -> RigModel:
    """The model with the found effects."""
    for name in dict.fromkeys(str(e["name"]) for effects in found.values() for e in effects):
        effect = EFFECTS.get(name)
        if effect is None:
            continue
        if effect.acts not in BALL:
            p = merged(found, name)
            model = with_part(model, effect, _values(p), _stderr(p))
        elif name == DRIFT:
            model = _balls(model, FRICTION, _at_the_end(model, found))
        else:
            model = _balls(model, name, found)
    return model


def _at_the_end(model: RigModel, found: Found) -> Found:
    """Viscous friction at the end of the record, after its drift."""
    out: dict[int, list[dict[str, Any]]] = {}
    for ring, effects in found.items():
        for e in effects:
            if e["name"] == DRIFT:
                rate, start, until = e["parameters"]["rate"], e["parameters"]["start"], e.get(UNTIL, 0.0)
                was = model.ball(ring).parameter(FRICTION, "coefficient", 0.0)
                value = max(was + start["value"] + rate["value"] * until, 0.0)
                stderr = math.hypot(start["stderr"] or 0.0, (rate["stderr"] or 0.0) * until)
                numbers = {"coefficient": {"value": value, "stderr": stderr, "unit": "1/s"}}
                out[ring] = [{"name": FRICTION, "parameters": numbers}]
    return out


def _values(p: Parameters) -> dict[str, float]:
    return {key: float(number["value"]) for key, number in p.items()}


def _stderr(p: Parameters) -> dict[str, float]:
    return {key: math.inf if number["stderr"] is None else float(number["stderr"]) for key, number in p.items()}


def _balls(model: RigModel, name: str, found: Found) -> RigModel:
    """The model with a found effect on the ball in its rings."""
    if EFFECTS[name].common:
        p = merged(found, name)
        balls = {ring: with_effect(ball, name, _values(p), _stderr(p)) for ring, ball in model.balls.items()}
        return replace(model, balls=balls)
    balls = {ring: model.ball(ring) for ring in {*model.balls, *found}}
    here: dict[int, Parameters] = {
        ring: e["parameters"] for ring, effects in found.items() for e in effects if e["name"] == name
    }
    for ring, p in here.items():
        balls[ring] = with_effect(balls[ring], name, _values(p), _stderr(p))
    return replace(model, balls=balls)


def with_effect(ball: BallModel, name: str, values: Mapping[str, float], stderr: Mapping[str, float]) -> BallModel:
    """The ball with an effect at these values, each limited to the bounds of its parameter."""
    allowed = EFFECTS[name].parameters
    inside = {key: min(max(v, allowed[key].low), allowed[key].high) for key, v in values.items() if key in allowed}
    new, errors = make_term(name, inside), {**ball.stderr, name: dict(stderr)}
    if any(e.name == name for e in ball.effects):
        return BallModel(tuple(new if e.name == name else e for e in ball.effects), errors)
    return BallModel((*ball.effects, new), errors)
