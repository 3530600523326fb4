"""Stage and tilt sensor of a record against those of the model: what the commands and the measured tilt say alone.

Each number of an axis is compared with the model's, with the standard errors of both. A change of the measured gain has
two possible causes: the servo turns the plate further, or the sensor says that it did. The commands cannot tell; the
ball can, which feels the true tilt: of two likelihoods of the record, one with the scale of the sensor changed by as
much as the gain and one with the scale of the model, the better one decides.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mazeplan.diagnosis.fit import Likelihood, best_q
from mazeplan.diagnosis.platemotion import Stage
from mazeplan.diagnosis.system import Values
from mazeplan.models.modelfile import RigModel
from mazeplan.physics import rig
from mazeplan.physics.effect import Effect
from mazeplan.physics.entries import declared_parts, part_stderr
from mazeplan.physics.stage import StageAxis, StageModel

SURE = 5.0  # standard errors of the difference: the residual of a stage is not white
TOLD = 15.0  # of -2 log L, by which servo or sensor must be the better explanation
AXES: tuple[str, ...] = ("beta", "gamma")
COUPLINGS: dict[str, str] = {"beta": "beta_from_gamma", "gamma": "gamma_from_beta"}
GEARS = (rig.backlash, rig.deadband)
LIKE = (rig.servo_lag, rig.axis_coupling, rig.command_delay, rig.backlash, rig.deadband)


@dataclass(frozen=True)
class Known:
    """What the model says of the stage, with its standard errors where it has them."""

    values: Values
    stderr: Values

    @classmethod
    def of_model(cls, model: RigModel) -> Known:
        """What a rig's model says."""
        values = declared_parts(model)
        return cls(values, {e.name: part_stderr(model, e) for e in rig.FAMILY if e.name in values})

    def axes(self) -> StageModel | None:
        """The stage of the model, in tilts as they are measured; None where only a part of it is known."""
        if "servo_gain" not in self.values or "servo_lag" not in self.values:
            return None
        return StageModel(*(self._axis(axis) for axis in AXES))

    def _axis(self, axis: str) -> StageAxis:
        gain, lag = self.values["servo_gain"][axis], self.values["servo_lag"]
        return StageAxis(
            gain,
            lag[f"{axis}_natural_frequency"],
            lag[f"{axis}_damping"],
            self.values.get("command_delay", {}).get("delay", 0.0),
            backlash=self.values.get("backlash", {}).get(axis, 0.0),
            deadband=self.values.get("deadband", {}).get(axis, 0.0),
            coupling=self.values.get("axis_coupling", {}).get(COUPLINGS[axis], 0.0),
        )


def measured(stage: Stage, effect: Effect) -> tuple[dict[str, float], dict[str, float]]:
    """Parameters of an effect of the stage as a record shows them, and their standard errors."""
    values, stderr = {}, {}
    axes = dict(zip(AXES, stage.axes, strict=True))
    for name, place in effect.entry.items():
        _, which, key = place.split(".")
        chosen = list(axes.values()) if which == "*" else [axes[which]]
        values[name] = sum(getattr(axis, key) for axis in chosen) / len(chosen)
        stderr[name] = math.hypot(*(axis.stderr.get(key, math.inf) for axis in chosen)) / len(chosen)
        if key in ("backlash", "deadband", "coupling") and not values[name]:
            stderr[name] = 0.0  # was looked for, and is not there
    return values, stderr


def changed(stage: Stage, effect: Effect, known: Known) -> dict[str, Any] | None:
    """The effect as the JSON of a diagnosis has it, where the record is surely off what is known; else None."""
    values, stderr = measured(stage, effect)
    had = known.values.get(effect.name)
    if had is None and effect.name in ("servo_gain", "servo_lag"):
        return None  # nobody said what they should be
    had = had or {name: p.default for name, p in effect.parameters.items()}
    was = known.stderr.get(effect.name, {})
    for name, p in effect.parameters.items():
        sigma = math.hypot(stderr[name], _finite(was.get(name)))
        if abs(values[name] - had.get(name, p.default)) > max(p.smallest, SURE * sigma):
            return entry(effect, values, stderr, had)
    return None


def entry(effect: Effect, values: Mapping[str, float], stderr: Mapping[str, float], had: Mapping[str, float]) -> Any:
    """An effect for the JSON."""
    return {
        "name": effect.name,
        "parameters": {
            name: {"value": values[name], "stderr": stderr.get(name, math.inf), "unit": p.unit}
            for name, p in effect.parameters.items()
        },
        "known_before": {name: had.get(name, p.default) for name, p in effect.parameters.items()},
    }


def stage_effects(stage: Stage | None, known: Known) -> list[dict[str, Any]]:
    """What is off with the stage but for its gain."""
    if stage is None:
        return []
    like = [effect for effect in LIKE if effect not in GEARS or _looser(stage, known)]
    found = (changed(stage, effect, known) for effect in like)
    return [effect for effect in found if effect is not None]


def _looser(stage: Stage, known: Known) -> bool:
    """Whether play and dead band together changed by what is worth a word: little of either looks like the other."""
    for axis, seen in zip(AXES, stage.axes, strict=True):
        was = sum(known.values.get(effect.name, {}).get(axis, 0.0) for effect in GEARS)
        if abs(seen.backlash + seen.deadband - was) > rig.backlash.parameters[axis].smallest:
            return True
    return False


def gain_effect(
    stage: Stage | None, known: Known, likelihood: Likelihood
) -> tuple[dict[str, Any] | None, tuple[str, ...]]:
    """What a changed gain comes from: the effect of the servo or of the tilt sensor, None where nothing changed; and
    the names between which this record cannot tell."""
    servo = None if stage is None else changed(stage, rig.servo_gain, known)
    if stage is None or servo is None:
        return None, ()
    had = known.values["servo_gain"]
    scale = known.values.get("tilt_gain", dict.fromkeys(AXES, 1.0))
    ratio = {axis: servo["parameters"][axis]["value"] / had[axis] for axis in AXES}
    allowed = rig.tilt_gain.parameters
    sensor = {axis: min(max(scale[axis] * ratio[axis], allowed[axis].low), allowed[axis].high) for axis in AXES}
    by_servo, by_sensor = (
        likelihood.minus2(values, best_q(likelihood, values)) for values in ({}, {"tilt_gain": sensor})
    )
    close = abs(by_servo - by_sensor) < TOLD
    if by_sensor >= by_servo:
        return servo, ("servo_gain", "tilt_gain") if close else ()
    errors = {axis: servo["parameters"][axis]["stderr"] / had[axis] * scale[axis] for axis in AXES}
    return entry(rig.tilt_gain, sensor, errors, scale), ("tilt_gain", "servo_gain") if close else ()


def _finite(value: float | None) -> float:
    return value if value is not None and math.isfinite(value) else 0.0
