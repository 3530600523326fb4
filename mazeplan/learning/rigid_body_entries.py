"""The parameters of a ball modelled as a rigid body: names, units and bounds.

A parameter with a counterpart in the registry of effects takes its description, unit and bounds from there. They are
converted to the ball itself: rad/s^2 on a ring become m/s^2 on the floor, a factor of gravity becomes an inertia, and a
gain of the tilt sensor becomes its inverse.

A rig's model may hold a rigid body (section `body` of model.yaml), identified from a record of all rings at once. It
belongs to the effects that the rings had at that time, and counts as missing in a model with other effects.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from mazeplan.core.errors import one_of
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effect import Parameter, Term
from mazeplan.physics.registry import PACKAGED

RADIUS_M = 0.1  # m; radius for the conversion of bounds in rad
LEAST_INERTIA = 0.05  # minimum; a ball with less has no spin
ALONG = {("rad/s^2", -1): "m/s^2", ("1/rad", 1): "1/m"}  # unit along the track, by unit and power of the radius
SAME, SCALE, INERTIA = "same", "scale", "inertia"  # conversion from the registry: x, 1 / x, 1 / x - 1


@dataclass(frozen=True)
class Number:
    """One parameter of `BodyModel`, at `part` and `field`.

    low, high:  bounds
    step:       step of finite differences
    words:      its name in reports
    log:        whether a search uses the logarithm, with a relative step
    effect:     its counterpart EFFECT.PARAMETER in the registry, or ""
    how:        conversion from the counterpart: SAME, SCALE or INERTIA"""

    part: str
    field: str
    unit: str
    low: float
    high: float
    step: float
    words: str = ""
    log: bool = False
    effect: str = ""
    how: str = SAME

    @property
    def origin(self) -> tuple[Parameter, int]:
        """The counterpart in the registry, and its power of the radius from ring to ring."""
        name, _, key = self.effect.partition(".")
        return PACKAGED[name].parameters[key], (PACKAGED[name].by_radius or {}).get(key, 0)


def _named(part: str, field: str, effect: str, step: float, words: str = "", how: str = SAME) -> Number:
    """A parameter with a counterpart in the registry."""
    origin, power = Number(part, field, "", 0.0, 0.0, step, effect=effect).origin
    unit = ALONG.get((origin.unit, power), origin.unit)
    ends = [to_body_unit(x, how, power, RADIUS_M) for x in (origin.low, origin.high)]
    low, high = max(min(ends), LEAST_INERTIA) if how == INERTIA else min(ends), max(ends)
    return Number(part, field, unit, low, high, step, words or origin.words, False, effect, how)


def to_body_unit(value: float, how: str, power: int, radius: float) -> float:
    """A value of the registry, converted to the rigid body."""
    if how == SAME:
        return value / radius**power
    return 1.0 / value - (1.0 if how == INERTIA else 0.0)


PARAMETERS: dict[str, Number] = {
    "rolling": _named("ball", "rolling", "dry_friction.coefficient", 4e-3, "rolling friction"),
    "viscous": _named("ball", "viscous", "viscous_friction.coefficient", 2e-2, "friction in proportion to the speed"),
    "quadratic": _named("ball", "quadratic", "quadratic_drag.coefficient", 0.2, "drag with the square of the speed"),
    "inertia": _named("ball", "inertia", "rolling_inertia.factor", 1e-2, "inertia over m R^2", INERTIA),
    "wall": _named("ball", "wall", "wall_friction.coefficient", 2e-2, "friction at walls"),
    "wall_rolling": Number("ball", "wall_rolling", "1", 0.0, 1.0, 2e-3, "rolling friction at walls"),
    "restitution": Number("ball", "restitution", "1", 0.0, 0.95, 4e-2, "speed kept by a slow impact"),
    "hold": Number("ball", "hold", "m/s", 0.0, 1.0, 3e-3, "grip of the floor in an impact"),
    "spin": Number("ball", "spin", "m/s^2", 0.0, 2.0, 4e-3, "friction against spinning"),
    "height": Number("ball", "height", "m", -0.2, 0.2, 1e-3, "ball above the pivot"),
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
    "bend": _named("view", "bend", "lens_distortion.k", 5e-2, "bend of the camera's lens"),
    "delay": _named("view", "delay", "sensor_delay.delay", 1e-3),
    "noise": Number("view", "noise", "m", 1e-5, 2e-2, 2e-2, "camera noise", log=True),
    "plane": Number("wander", "plane", "m^2/s^3", 1e-9, 10.0, 0.3, "unexplained, rolling", log=True),
    "spin_wander": Number("wander", "spin", "m^2/s^3", 1e-9, 10.0, 0.3, "unexplained, spinning", log=True),
    "strike": Number("wander", "strike", "1", 1e-4, 1.0, 0.3, "unexplained, at impacts", log=True),
}
# parameters in a model file: those that a run needs; `delay` is added to camera_delay_s of the model
KEPT = (
    "rolling", "spin", "viscous", "quadratic", "inertia", "wall", "wall_rolling", "restitution", "hold",
    "tilt_beta", "tilt_gamma", "delay", "noise", "plane", "strike",
)  # fmt: skip
# numbers that a file leaves out do not act: they are 0, and from a `hold` of 1 m/s on, walls return all that the
# restitution says; a noise is the usual one then
ABSENT = {
    **dict.fromkeys(("rolling", "viscous", "quadratic", "wall", "wall_rolling", "restitution", "spin", "delay"), 0.0),
    "hold": 1.0,
}
BOUND = 1e-6  # share of its range by which a number is at its bound


def determined(name: str, value: float, stderr: float | None) -> bool:
    """Whether a record determines a number: it does not have the value without effect, is not at its upper bound, and
    not as uncertain as its range. A noise is not at its lower bound, either."""
    number = PARAMETERS[name]
    wide = number.high - number.low
    at_end = name in ABSENT and name != "delay" and min(abs(value - ABSENT[name]), number.high - value) < BOUND * wide
    at_end |= number.log and not (1.0 + BOUND) * number.low < value < (1.0 - BOUND) * number.high
    return math.isfinite(value) and not at_end and not (stderr is not None and stderr > wide)


@dataclass(frozen=True)
class Body:
    """The rigid body of a model. Raises ValueError for a value out of bounds.

    values:  by name, a name in KEPT
    of:      `stamp` of the rings with which the body was identified
    stderr:  standard errors by name, if known
    terms:   further effects on the body (`effects.local_forces`, or a user's)"""

    values: dict[str, float]
    of: str
    stderr: dict[str, float] = field(default_factory=dict, compare=False)
    terms: tuple[Term, ...] = ()

    def __post_init__(self) -> None:
        for name, value in self.values.items():
            if name not in KEPT:
                raise ValueError(f"got {name}, expected {one_of(KEPT, name)}")
            number = PARAMETERS[name]
            low = -number.high if name == "delay" else number.low
            if not low <= value <= number.high:  # also refuses NaN
                raise ValueError(f"{name}: got {value:g}, expected {low:g} to {number.high:g} {number.unit}")


def stamp(balls: Mapping[int, BallModel]) -> str:
    """Short hash of the effects of all rings, at the precision of a model file."""
    known = [
        (ring, term.name, key, f"{value:.6g}")
        for ring, ball in sorted(balls.items()) for term in ball.effects for key, value in term.values().items()
    ]  # fmt: skip
    return hashlib.sha256(repr(known).encode()).hexdigest()[:16]
