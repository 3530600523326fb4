"""The numbers of a `BodyModel` by name: what they are called, in which unit, within which bounds.

Where the registry has an effect that says the same, its words, unit and bounds stand here, too, brought over to the
ball itself: a bead's rad/s^2 on a ring become m/s^2 on the floor (the registry's power of the radius), a factor of
gravity an inertia, a scale of the tilt sensor what the tilt has to be multiplied by. Parameters of a model's own terms
are called EFFECT.PARAMETER.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from mazeplan.estimation.bodyfilter import BodyModel
from mazeplan.maze.geometry import Maze
from mazeplan.models.entries import part_values
from mazeplan.models.modelfile import RigModel
from mazeplan.physics.effect import BALL, Parameter
from mazeplan.physics.registry import PACKAGED

REACH = 0.1  # m from the middle; where bounds in rad hold
LEAST_INERTIA = 0.05  # of k; less has no spin
ALONG = {("rad/s^2", -1): "m/s^2", ("1/rad", 1): "1/m"}  # units without the angle, by power of the radius
SAME, SCALE, INERTIA = "same", "scale", "inertia"  # how a number follows from the registry's: x, 1 / x, 1 / x - 1


@dataclass(frozen=True)
class Number:
    """One number of `BodyModel`: `part` and `field` say where. unit; bounds low, high; step: of finite differences;
    log: whether it is searched for by its logarithm (the step is relative then); words: what reports call it; effect:
    EFFECT.PARAMETER of the registry that says the same, "" where none does; how: it follows from that, see above."""

    part: str
    field: str
    unit: str
    low: float
    high: float
    step: float
    log: bool = False
    words: str = ""
    effect: str = ""
    how: str = SAME

    @property
    def origin(self) -> tuple[Parameter, int]:
        """The registry's parameter, and the power of the radius with which it goes from ring to ring."""
        name, _, key = self.effect.partition(".")
        return PACKAGED[name].parameters[key], (PACKAGED[name].by_radius or {}).get(key, 0)


def _named(part: str, field: str, effect: str, step: float, words: str = "", how: str = SAME) -> Number:
    """A number that the registry knows under the name of an effect."""
    origin, power = Number(part, field, "", 0.0, 0.0, step, effect=effect).origin
    unit = ALONG.get((origin.unit, power), origin.unit)
    ends = [_brought(x, how, power, REACH) for x in (origin.low, origin.high)]
    low, high = max(min(ends), LEAST_INERTIA) if how == INERTIA else min(ends), max(ends)
    return Number(part, field, unit, low, high, step, False, words or origin.words, effect, how)


def _brought(value: float, how: str, power: int, radius: float) -> float:
    """The registry's value as the body has it."""
    if how == SAME:
        return value / radius**power
    return 1.0 / value - (1.0 if how == INERTIA else 0.0)


def _own(
    part: str, field: str, unit: str, bounds: tuple[float, float], step: float, words: str, log: bool = False
) -> Number:
    return Number(part, field, unit, *bounds, step, log, words)


WANDER = (1e-9, 10.0)
PARAMETERS: dict[str, Number] = {
    "rolling": _named("ball", "rolling", "dry_friction.coefficient", 4e-3, "rolling friction"),
    "viscous": _named("ball", "viscous", "viscous_friction.coefficient", 2e-2, "friction in proportion to the speed"),
    "quadratic": _named("ball", "quadratic", "quadratic_drag.coefficient", 0.2, "drag with the square of the speed"),
    "inertia": _named("ball", "inertia", "rolling_inertia.factor", 1e-2, "inertia over m R^2", INERTIA),
    "wall": _named("ball", "wall", "wall_friction.coefficient", 2e-2, "friction at walls"),
    "restitution": _own("ball", "restitution", "1", (0.0, 0.95), 4e-2, "speed kept by a slow impact"),
    "hold": _own("ball", "hold", "m/s", (0.0, 1.0), 3e-3, "grip of the floor in an impact"),
    "spin": _own("ball", "spin", "m/s^2", (0.0, 2.0), 4e-3, "friction against spinning"),
    "height": _own("ball", "height", "m", (-0.2, 0.2), 1e-3, "ball above the pivot"),
    "gain_beta": _named("tilting", "gain_beta", "tilt_gain.beta", 5e-3, "true tilt over measured, beta", SCALE),
    "gain_gamma": _named("tilting", "gain_gamma", "tilt_gain.gamma", 5e-3, "true tilt over measured, gamma", SCALE),
    "cross_beta": _named("tilting", "cross_beta", "axis_coupling.beta_from_gamma", 5e-3, "share of gamma in beta"),
    "cross_gamma": _named("tilting", "cross_gamma", "axis_coupling.gamma_from_beta", 5e-3, "share of beta in gamma"),
    "tilt_beta": _named("tilting", "tilt_beta", "tilt_offset.beta", 5e-4, "table down at +x"),
    "tilt_gamma": _named("tilting", "tilt_gamma", "tilt_offset.gamma", 5e-4, "table up at +y"),
    "offset_x": _named("view", "offset_x", "camera_offset.x", 5e-5, "camera's middle, x"),
    "offset_y": _named("view", "offset_y", "camera_offset.y", 5e-5, "camera's middle, y"),
    "angle": _named("view", "angle", "axis_misalignment.angle", 1e-3, "camera turned"),
    "scale": _named("view", "scale", "camera_scale.factor", 5e-4, "camera's scale"),
    "delay": _named("view", "delay", "sensor_delay.delay", 1e-3),
    "noise": _own("view", "noise", "m", (1e-5, 2e-2), 2e-2, "camera noise", log=True),
    "plane": _own("wander", "plane", "m^2/s^3", WANDER, 0.3, "unexplained, rolling", log=True),
    "spin_wander": _own("wander", "spin", "m^2/s^3", WANDER, 0.3, "unexplained, spinning", log=True),
    "strike": _own("wander", "strike", "1", (1e-4, 1.0), 0.3, "unexplained, at impacts", log=True),
}
LEFT_OVER = ("cross_beta", "cross_gamma")  # of the coupling, that the stage as fitted does not have already
FRICTION = ("rolling", "viscous", "quadratic")  # of a bead they are as they come to the motion, f times as large


def number_of(model: BodyModel, name: str) -> Number:
    """What is known of a number. Raises KeyError for a name that is none."""
    if name in PARAMETERS:
        return PARAMETERS[name]
    i, key = _term(model, name)
    p = model.terms[i].effect.parameters[key]
    return Number("terms", name, p.unit, p.low, p.high, p.smallest or p.step, False, p.words or name, name)


def _term(model: BodyModel, name: str) -> tuple[int, str]:
    """Which term, and which of its parameters."""
    effect, _, key = name.partition(".")
    for i, term in enumerate(model.terms):
        if term.name == effect and key in term.effect.parameters:
            return i, key
    raise KeyError(name)


def value_of(model: BodyModel, name: str) -> float:
    """A number of a model by its name, in its unit."""
    if name not in PARAMETERS:
        i, key = _term(model, name)
        return model.terms[i].values()[key]
    where = PARAMETERS[name]
    return float(getattr(getattr(model, where.part), where.field))


def with_values(model: BodyModel, values: Mapping[str, float]) -> BodyModel:
    """The model with other values of some numbers, in their units."""
    for name, value in values.items():
        if name in PARAMETERS:
            where = PARAMETERS[name]
            part = getattr(model, where.part)._replace(**{where.field: value})
            model = model._replace(**{where.part: part})
            continue
        i, key = _term(model, name)
        term, terms = model.terms[i], list(model.terms)
        terms[i] = replace(term, numbers=tuple((term.values() | {key: value}).values()))
        model = model._replace(terms=tuple(terms))
    return model


def said_by(rig: RigModel, maze: Maze, name: str) -> tuple[float, ...]:
    """What a model of beads says of a number, in the body's unit: for each ring that has the effect, or once for what
    belongs to the rig; nothing where it says nothing."""
    where = PARAMETERS[name]
    effect, _, key = where.effect.partition(".")
    if not effect or name in LEFT_OVER:
        return ()
    power = where.origin[1]
    if PACKAGED[effect].acts not in BALL:
        return (_brought(part_values(rig, PACKAGED[effect])[key], where.how, power, REACH),)
    found = []
    for ring in sorted(rig.balls):
        ball, radius = rig.balls[ring], maze.track_radius(ring)
        value = ball.parameter(effect, key, math.nan)
        if not math.isfinite(value) or radius <= 0.0:
            continue
        share = ball.parameter("rolling_inertia", "factor", 1.0) if name in FRICTION else 1.0
        found.append(_brought(value, where.how, power, radius) / share)
    return tuple(found[:1] if PACKAGED[effect].common else found)
