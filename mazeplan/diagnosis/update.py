"""From a model and the effects that were found, a new model that has them: the old one but for their entries.

| effect | entry |
|---|---|
| of stage, tilt sensor, camera | where its definition says (`Effect.entry`) |
| of the ball, the same everywhere (`common`) | of every ring |
| of the ball, others | of the rings where they were found; rolling, dry and viscous friction with `common` of all |
| friction_drift | viscous friction, as it was when the record ended |

What was found in several rings is their mean, weighted by the standard errors. A value outside what the model allows
becomes the nearest that it may be. Processes stay as they are: what they add was learned on top of the old effects, at
the edges and joints of the maze, which are where they were.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from mazeplan.constants import FREE_ROLLING, SOLID
from mazeplan.maze.geometry import Maze
from mazeplan.models.modelfile import RigModel
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effect import BALL
from mazeplan.physics.entries import with_part
from mazeplan.physics.registry import EFFECTS, make_term
from mazeplan.physics.stage import StageModel

Parameters = dict[str, dict[str, Any]]  # parameter -> {"value", "stderr", "unit"}
Found = Mapping[int, Sequence[Mapping[str, Any]]]  # ring -> effects as in the JSON of a diagnosis
OF_THE_BALL = ("rolling_inertia", "dry_friction", "viscous_friction")
DRIFT, FRICTION, UNTIL = "friction_drift", "viscous_friction", "until_s"


def not_planned(names: Iterable[str]) -> list[str]:
    """Those names of effects that a planner cannot use."""
    return [name for name in names if name not in EFFECTS or not EFFECTS[name].planned]


def base_model(
    maze: Maze, ring: int | None, declared: Mapping[str, Mapping[str, float]], stage: StageModel | None
) -> RigModel:
    """The model that declarations stand for, of one ring (None: 1): effects and delay as declared, the stage as it was
    fitted to the record, or textbook values without commands."""
    effects = tuple(make_term(name, values) for name, values in declared.items() if EFFECTS[name].acts in BALL)
    model = RigModel(stage or StageModel(), {ring or 1: BallModel(effects)}, kind="pi")
    for name, values in declared.items():
        if EFFECTS[name].acts not in BALL:
            model = with_part(model, EFFECTS[name], values, {})
    return model


def merged(found: Found, name: str) -> Parameters:
    """The parameters of an effect that is one thing in all rings: weighted means and their standard errors."""
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


def updated(model: RigModel, maze: Maze, found: Found, *, common: bool = False) -> RigModel:
    """The model with what was found. common: what belongs to the ball was found in enough rings to count in all."""
    for name in dict.fromkeys(str(e["name"]) for effects in found.values() for e in effects):
        effect = EFFECTS.get(name)
        if effect is None:
            continue
        if effect.acts not in BALL:
            p = merged(found, name)
            model = with_part(model, effect, _values(p), _stderr(p))
        elif name == DRIFT:
            model = _balls(model, maze, FRICTION, _at_the_end(model, found), common)
        else:
            model = _balls(model, maze, name, found, common)
    return model


def _at_the_end(model: RigModel, found: Found) -> Found:
    """Viscous friction as a drift left it when the record ended."""
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


def _balls(model: RigModel, maze: Maze, name: str, found: Found, common: bool) -> RigModel:
    """The model, and in its rings an effect on the ball as found."""
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
    if common and name in OF_THE_BALL:
        key = "factor" if name == "rolling_inertia" else "coefficient"
        for ring in balls.keys() - here.keys():
            elsewhere = [
                _carried(name, p[key]["value"], r, ring, model, maze) for r, p in here.items() if r in model.balls
            ]
            if elsewhere:
                known = next((e.values() for e in balls[ring].effects if e.name == name), {})
                values = {**known, key: sum(elsewhere) / len(elsewhere)}
                balls[ring] = with_effect(balls[ring], name, values, {})
    return replace(model, balls=balls)


def _carried(name: str, value: float, ring: int, other: int, model: RigModel, maze: Maze) -> float:
    """What a value found in a ring says of another ring, by how far it is from what the model said there.

    Friction changes by as many m/s^2 (dry) or 1/s (viscous). Of the rolling factor 1 / (1 + l c) the ring has l (1 on
    the floor alone, about 2 along a wall), the ball its inertia c m r^2."""
    if name == "rolling_inertia":
        was, there = (model.ball(r).parameter(name, "factor", FREE_ROLLING) for r in (ring, other))
        inertia = SOLID * (1.0 / value - 1.0) / (1.0 / was - 1.0)
        return 1.0 / (1.0 + (1.0 / there - 1.0) / SOLID * inertia)
    change = value - model.ball(ring).parameter(name, "coefficient", 0.0)
    if name == "dry_friction":
        here, at = (max(maze.track_radius(r), 0.5 * maze.ring(r).outer_radius) for r in (ring, other))
        change *= here / at
    return model.ball(other).parameter(name, "coefficient", 0.0) + change


def with_effect(ball: BallModel, name: str, values: Mapping[str, float], stderr: Mapping[str, float]) -> BallModel:
    """The ball with an effect at these values, each within what a model may have."""
    allowed = EFFECTS[name].parameters
    inside = {key: min(max(v, allowed[key].low), allowed[key].high) for key, v in values.items() if key in allowed}
    new, errors = make_term(name, inside), {**ball.stderr, name: dict(stderr)}
    if any(e.name == name for e in ball.effects):
        return BallModel(tuple(new if e.name == name else e for e in ball.effects), errors)
    return BallModel((*ball.effects, new), errors)
