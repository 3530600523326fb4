"""Interface of a rig's model, and access to the effects of stage, tilt sensor and camera in it.

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
from mazeplan.physics.effects.rig import FAMILY
from mazeplan.physics.rig.stage import StageModel

AXES = ("beta", "gamma")
DEAD_TIME = 0.005  # s; a smaller dead time does not count as an effect
ALWAYS = ("servo_gain", "servo_lag")  # effects of every model
TAKEN_OFF = ("camera_offset", "camera_scale", "lens_distortion")  # corrected in measured positions before a fit
DELAY = "camera_delay_s"


class RigNumbers(Protocol):
    """What the equations need of a rig's model (`learning.modelfile.RigModel`). The fields camera and tilt_sensor are
    accessed only through the entries of effects."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def stage(self) -> StageModel:
        """The stage in measured tilts."""
        ...

    @property
    def true_stage(self) -> StageModel:
        """The stage in true tilts."""
        ...

    @property
    def balls(self) -> dict[int, BallModel]:
        """Known ball models, by ring."""
        ...

    @property
    def camera_delay(self) -> float:
        """Delay of the ball's position behind the tilt sensor, s. If the sensor is later than the camera, it is
        negative, down to minus the dead time of the commands: no picture shows the ball before it was there."""
        ...

    @property
    def camera_delay_stderr(self) -> float | None:
        """Standard error of `camera_delay`, s; None if unknown."""
        ...

    def ball(self, ring: int) -> BallModel:
        """The ball model of a ring, or of the nearest ring that has a model."""
        ...

    def by_effects(self, ring: int) -> bool:
        """Whether effects describe a ring; False if a Gaussian process alone describes it."""
        ...


Rig = TypeVar("Rig", bound=RigNumbers)


def declared_parts(model: RigNumbers) -> dict[str, dict[str, float]]:
    """Effects of stage, tilt sensor and camera in a model, without neutral ones: {effect: {parameter: value}}."""
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
    """Values of the parameters of an effect in a model."""
    return {name: min(_read(model, place), effect.parameters[name].high) for name, place in effect.entry.items()}


def part_stderr(model: RigNumbers, effect: Effect) -> dict[str, float]:
    """Standard errors of the parameters of an effect in a model; NaN if unknown."""
    return {name: _stderr(model, place) for name, place in effect.entry.items()}


def with_part(model: Rig, effect: Effect, values: Mapping[str, float], stderr: Mapping[str, float]) -> Rig:
    """The model with new parameters of an effect, clipped to their bounds."""
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
        return replace(model, camera_delay=max(value, -model.stage.dead_time), camera_delay_stderr=stderr)
    part, *rest = place.split(".")
    owner = getattr(model, part)
    if part != "stage":
        return replace(model, **{part: _changed(owner, rest[0], value, stderr)})
    axes = AXES if rest[0] == "*" else (rest[0],)
    stderr *= math.sqrt(len(axes))  # `_stderr` reads the error of the mean of independent axes
    stage = replace(owner, **{axis: _changed(getattr(owner, axis), rest[1], value, stderr) for axis in axes})
    return replace(model, stage=stage)


def _changed(owner: Any, name: str, value: float, stderr: float) -> Any:
    return replace(owner, **{name: value}, stderr={**owner.stderr, name: stderr})
