"""What the equations ask of a rig's model; where in it the effects of stage, tilt sensor and camera stand, and how they
are read and written.

An effect names the place of each of its parameters (`Effect.entry`): `stage.beta.gain`, `camera.angle`,
`camera_delay_s`; a star stands for both axes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar, Protocol, TypeVar

from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effect import Effect
from mazeplan.physics.rig import FAMILY
from mazeplan.physics.stage import StageModel

AXES = ("beta", "gamma")
DEAD_TIME = 0.005  # s of commands, below which there is no need to call it an effect
ALWAYS = ("servo_gain", "servo_lag")  # known of every model
TAKEN_OFF = ("camera_offset", "camera_scale", "lens_distortion")  # of measured positions, before anything is fitted
DELAY = "camera_delay_s"


class RigNumbers(Protocol):
    """A rig's model as the equations see it (`models.modelfile.RigModel` is one). camera, tilt_sensor: named by the
    effects' entries alone."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def stage(self) -> StageModel:
        """In tilts as they are measured."""
        ...

    @property
    def true_stage(self) -> StageModel:
        """In tilts as they are."""
        ...

    @property
    def balls(self) -> dict[int, BallModel]:
        """By ring, those that are known."""
        ...

    @property
    def camera_delay(self) -> float:
        """s that the ball's position is behind the tilt sensor."""
        ...

    @property
    def camera_delay_stderr(self) -> float | None:
        """s; None where nobody says."""
        ...

    def ball(self, ring: int) -> BallModel:
        """That of a ring, or of the nearest that has one."""
        ...

    def by_effects(self, ring: int) -> bool:
        """Whether effects say how the ball moves in a ring, and not a process in their place."""
        ...


Rig = TypeVar("Rig", bound=RigNumbers)


def declared_parts(model: RigNumbers) -> dict[str, dict[str, float]]:
    """What a model says of stage, tilt sensor and camera, as {effect: {parameter: value}}, where it says something."""
    found = {}
    for effect in FAMILY:
        values = part_values(model, effect)
        neutral = {name: p.default for name, p in effect.parameters.items()}
        if effect.name in TAKEN_OFF or (values == neutral and effect.name not in ALWAYS):
            continue
        if effect.name == "command_delay" and values["delay"] <= DEAD_TIME:
            continue
        found[effect.name] = values
    return found


def part_values(model: RigNumbers, effect: Effect) -> dict[str, float]:
    """The parameters of an effect as a model has them."""
    return {name: _read(model, place) for name, place in effect.entry.items()}


def part_stderr(model: RigNumbers, effect: Effect) -> dict[str, float]:
    """Their standard errors, NaN where the model does not say."""
    return {name: _stderr(model, place) for name, place in effect.entry.items()}


def with_part(model: Rig, effect: Effect, values: Mapping[str, float], stderr: Mapping[str, float]) -> Rig:
    """The model with parameters of an effect, each within what the effect allows."""
    for name, value in values.items():
        p = effect.parameters[name]
        inside = min(max(value, p.low), p.high)
        model = _write(model, effect.entry[name], inside, stderr.get(name, math.inf))
    return model


def _read(model: RigNumbers, place: str) -> float:
    if place == DELAY:
        return model.camera_delay
    part, *rest = place.split(".")
    if rest[0] == "*":
        return sum(getattr(getattr(model.stage, axis), rest[1]) for axis in AXES) / len(AXES)
    owner: Any = getattr(model, part)
    for name in rest:
        owner = getattr(owner, name)
    return float(owner)


def _stderr(model: RigNumbers, place: str) -> float:
    if place == DELAY:
        return math.nan if model.camera_delay_stderr is None else model.camera_delay_stderr
    part, *rest = place.split(".")
    if part != "stage":
        return getattr(model, part).stderr.get(rest[0], math.nan)
    axes = AXES if rest[0] == "*" else (rest[0],)
    known = [getattr(model.stage, axis).stderr.get(rest[1], math.nan) for axis in axes]
    return math.hypot(*known) / len(known)


def _write(model: Rig, place: str, value: float, stderr: float) -> Rig:
    if place == DELAY:
        return replace(model, camera_delay=max(value, 0.0), camera_delay_stderr=stderr)
    part, *rest = place.split(".")
    owner = getattr(model, part)
    if part != "stage":
        return replace(model, **{part: _changed(owner, rest[0], value, stderr)})
    axes = AXES if rest[0] == "*" else (rest[0],)
    stage = replace(owner, **{axis: _changed(getattr(owner, axis), rest[1], value, stderr) for axis in axes})
    return replace(model, stage=stage)


def _changed(owner: Any, name: str, value: float, stderr: float) -> Any:
    return replace(owner, **{name: value}, stderr={**owner.stderr, name: stderr})
