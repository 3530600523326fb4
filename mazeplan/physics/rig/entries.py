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
from mazeplan.physics.effects.rig import AXES, FAMILY
from mazeplan.physics.rig.stage import StageModel

DEAD_TIME = 0.005  # s; a smaller dead time does not count as an effect
ALWAYS = ("servo_gain", "servo_lag")  # effects of every model
TAKEN_OFF = ("camera_offset", "camera_scale", "lens_distortion")  # corrected in measured positions before a fit
DELAY = "camera_delay_s"


class RigNumbers(Protocol):
    """What the equations need of a rig's model (`learning.rig_model.RigModel`). The fields camera and tilt_sensor are
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
        """Delay of the ball's position behind the tilt sensor, s; negative if the sensor is the later one."""
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
        neutral = all(values[name] == p.default for name, p in effect.parameters.items()) and effect.name not in ALWAYS
        at_once = effect.name == "command_delay" and values["delay"] <= DEAD_TIME
        if effect.name not in TAKEN_OFF and not neutral and not at_once:
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


def _owners(model: RigNumbers, place: str) -> tuple[dict[str, Any], str]:
    """The objects that have the number of an entry, by their names in the model or in its stage; and its name there."""
    part, *names = place.split(".")
    if part != "stage":
        return {part: getattr(model, part)}, names[0]
    return {axis: getattr(model.stage, axis) for axis in (AXES if names[0] == "*" else names[:1])}, names[1]


def _read(model: RigNumbers, place: str) -> float:
    if place == DELAY:
        return model.camera_delay
    owners, name = _owners(model, place)
    first, *rest = (float(getattr(owner, name)) for owner in owners.values())
    return (first + sum(rest)) / len(owners) if rest else first


def _stderr(model: RigNumbers, place: str) -> float:
    if place == DELAY:
        return math.nan if model.camera_delay_stderr is None else model.camera_delay_stderr
    owners, name = _owners(model, place)
    return math.hypot(*(owner.stderr.get(name, math.nan) for owner in owners.values())) / len(owners)


def _write(model: Rig, place: str, value: float, stderr: float) -> Rig:
    if place == DELAY:
        return replace(model, camera_delay=max(value, -model.stage.dead_time), camera_delay_stderr=stderr)
    owners, name = _owners(model, place)
    stderr *= math.sqrt(len(owners))  # `_stderr` reads the error of the mean of independent axes
    new = {key: replace(o, **{name: value}, stderr={**o.stderr, name: stderr}) for key, o in owners.items()}
    return replace(model, stage=replace(model.stage, **new)) if place.startswith("stage") else replace(model, **new)
