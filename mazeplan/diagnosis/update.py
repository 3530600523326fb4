"""From a model and the effects that were found, a new model that has them: the old one but for their entries.

| effect | entry |
|---|---|
| tilt_offset | of every ring: the table is one |
| rolling_inertia, dry_friction, viscous_friction | of the rings where they were found; with `common` of all |
| other effects of the ball | of the ring in which they were found |
| sensor_delay | camera_delay_s |
| camera_offset, axis_misalignment | camera |
| tilt_gain | tilt_sensor |
| command_delay, backlash | stage |
| friction_drift | none: it was a process in time, and the record is over |
| wall_friction, gates of a wall, surface_ripple, effects of a user's own | none: planning does not know them |

What was found in several rings is their mean, weighted by the standard errors. A value outside what the model allows
becomes the nearest that it may be. Processes stay as they are: what they add was learned on top of the old effects, at
the edges and joints of the maze, which are where they were.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from mazeplan.maze.geometry import Maze
from mazeplan.models.ball import BallModel
from mazeplan.models.effects import EFFECTS, make_effect
from mazeplan.models.modelfile import RigModel
from mazeplan.models.sensors import Camera, TiltSensor
from mazeplan.models.stage import StageModel

Parameters = dict[str, dict[str, Any]]  # parameter -> {"value", "stderr", "unit"}
Found = Mapping[int, Sequence[Mapping[str, Any]]]  # ring -> effects as in the JSON of a diagnosis
LONGEST = 0.5  # s, of a delay
SOLID = 0.4  # inertia of a solid sphere over m r^2
ELSEWHERE = ("sensor_delay", "camera_offset", "axis_misalignment", "tilt_gain", "command_delay", "backlash")
OF_THE_BALL = ("rolling_inertia", "dry_friction", "viscous_friction")


def without_place(names: Iterable[str]) -> list[str]:
    """Those names of effects that a model file has no entry for, so that a new model would lack them."""
    return [name for name in names if name not in (*ELSEWHERE, *EFFECTS)]


def base_model(
    maze: Maze, ring: int | None, declared: Mapping[str, Mapping[str, float]], stage: StageModel | None
) -> RigModel:
    """The model that declarations stand for, of one ring (None: 1): effects and delay as declared, the stage as it was
    fitted to the record, or textbook values without commands."""
    effects = tuple(make_effect(name, values) for name, values in declared.items() if name in EFFECTS)
    model = RigModel(stage or StageModel(), {ring or 1: BallModel(effects)}, kind="pi")
    numbers = {
        name: {key: {"value": value, "stderr": math.inf, "unit": ""} for key, value in values.items()}
        for name, values in declared.items()
        if name not in EFFECTS
    }
    return updated(model, maze, {ring or 1: [{"name": n, "parameters": p} for n, p in numbers.items()]})


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
    names = list(dict.fromkeys(str(e["name"]) for effects in found.values() for e in effects))
    for name in names:
        p = merged(found, name)
        if name == "sensor_delay":
            delay = min(max(p["delay"]["value"], 0.0), LONGEST)
            model = replace(model, camera_delay=delay, camera_delay_stderr=p["delay"]["stderr"])
        elif name in ("camera_offset", "axis_misalignment"):
            model = replace(model, camera=_camera(model.camera, name, p))
        elif name == "tilt_gain":
            gains = {f"gain_{axis}": number for axis, number in p.items()}
            model = replace(model, tilt_sensor=TiltSensor(**_values(gains), stderr=_stderr(gains)))
        elif name in ("command_delay", "backlash"):
            model = replace(model, stage=_stage(model.stage, name, p))
        elif name in EFFECTS:
            model = replace(model, balls=_balls(model, maze, name, found, common))
    return model


def _values(p: Parameters) -> dict[str, float]:
    return {key: float(number["value"]) for key, number in p.items()}


def _stderr(p: Parameters) -> dict[str, float]:
    return {key: float(number["stderr"]) for key, number in p.items()}


def _camera(camera: Camera, name: str, p: Parameters) -> Camera:
    """An offset comes to the one that was known, which was taken off the positions before; an angle is the whole."""
    if name == "axis_misalignment":
        return replace(camera, angle=p["angle"]["value"], stderr={**camera.stderr, "angle": p["angle"]["stderr"]})
    stderr = {**camera.stderr, "offset_x": p["x"]["stderr"], "offset_y": p["y"]["stderr"]}
    x, y = camera.offset_x + p["x"]["value"], camera.offset_y + p["y"]["value"]
    return replace(camera, offset_x=x, offset_y=y, stderr=stderr)


def _stage(stage: StageModel, name: str, p: Parameters) -> StageModel:
    def axis(which: str) -> Any:
        old = getattr(stage, which)
        number = p["delay"] if name == "command_delay" else p.get(which)
        if number is None:
            return old
        key = "dead_time" if name == "command_delay" else "backlash"
        return replace(old, **{key: max(number["value"], 0.0)}, stderr={**old.stderr, key: number["stderr"]})

    return StageModel(axis("beta"), axis("gamma"))


def _balls(model: RigModel, maze: Maze, name: str, found: Found, common: bool) -> dict[int, BallModel]:
    """The balls of all rings with an effect as found."""
    if name == "tilt_offset":
        p = merged(found, name)
        return {ring: with_effect(ball, name, _values(p), _stderr(p)) for ring, ball in model.balls.items()}
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
    return balls


def _carried(name: str, value: float, ring: int, other: int, model: RigModel, maze: Maze) -> float:
    """What a value found in a ring says of another ring, by how far it is from what the model said there.

    Friction changes by as many m/s^2 (dry) or 1/s (viscous). Of the rolling factor 1 / (1 + l c) the ring has l (1 on
    the floor alone, about 2 along a wall), the ball its inertia c m r^2."""
    if name == "rolling_inertia":
        was, there = (model.ball(r).parameter(name, "factor", 5.0 / 7.0) for r in (ring, other))
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
    inside = {key: min(max(value, allowed[key].low), allowed[key].high) for key, value in values.items()}
    new, errors = make_effect(name, inside), {**ball.stderr, name: dict(stderr)}
    if any(e.name == name for e in ball.effects):
        return BallModel(tuple(new if e.name == name else e for e in ball.effects), errors)
    return BallModel((*ball.effects, new), errors)
