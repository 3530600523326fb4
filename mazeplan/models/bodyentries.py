"""The numbers of a ball with a body by name: what they are called, in which unit, within which bounds.

Where the registry has an effect that says the same, its words, unit and bounds stand here, too, brought over to the
ball itself: a bead's rad/s^2 on a ring become m/s^2 on the floor (the registry's power of the radius), a factor of
gravity an inertia, a scale of the tilt sensor what the tilt has to be multiplied by.

A rig's model may hold a body (`Body`, section `body` of model.yaml): numbers found in a record of that rig, all rings
at once. It belongs to the rings that the model had then: one whose rings were changed goes without.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effect import Parameter
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
    ends = [brought(x, how, power, REACH) for x in (origin.low, origin.high)]
    low, high = max(min(ends), LEAST_INERTIA) if how == INERTIA else min(ends), max(ends)
    return Number(part, field, unit, low, high, step, False, words or origin.words, effect, how)


def brought(value: float, how: str, power: int, radius: float) -> float:
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
    "bend": _named("view", "bend", "lens_distortion.k", 5e-2, "bend of the camera's lens"),
    "delay": _named("view", "delay", "sensor_delay.delay", 1e-3),
    "noise": _own("view", "noise", "m", (1e-5, 2e-2), 2e-2, "camera noise", log=True),
    "plane": _own("wander", "plane", "m^2/s^3", WANDER, 0.3, "unexplained, rolling", log=True),
    "spin_wander": _own("wander", "spin", "m^2/s^3", WANDER, 0.3, "unexplained, spinning", log=True),
    "strike": _own("wander", "strike", "1", (1e-4, 1.0), 0.3, "unexplained, at impacts", log=True),
}
# of a model file: what a run needs; `delay` there is what comes to the model's own camera_delay_s
KEPT = (
    "rolling", "spin", "viscous", "quadratic", "inertia", "wall", "restitution", "hold", "tilt_beta", "tilt_gamma",
    "delay", "noise", "plane", "strike",
)  # fmt: skip


@dataclass(frozen=True)
class Body:
    """values: numbers by name, of KEPT, `delay` as what comes to the camera's delay that the model has; stderr: where
    known; of: `stamp` of the rings with which it was found. Raises ValueError for what is out of bounds."""

    values: dict[str, float]
    of: str
    stderr: dict[str, float] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        for name, value in self.values.items():
            if name not in KEPT:
                raise ValueError(f"got {name}, expected one of {', '.join(KEPT)}")
            number = PARAMETERS[name]
            low = -number.high if name == "delay" else number.low
            if not low <= value <= number.high:  # also refuses NaN
                raise ValueError(f"{name}: got {value:g}, expected {low:g} to {number.high:g} {number.unit}")


def stamp(balls: Mapping[int, BallModel]) -> str:
    """Short hash of the effects of all rings, as precise as a model file has them."""
    told = [
        (ring, term.name, key, f"{value:.6g}")
        for ring, ball in sorted(balls.items()) for term in ball.effects for key, value in term.values().items()
    ]  # fmt: skip
    return hashlib.sha256(repr(told).encode()).hexdigest()[:16]


def read_body(reader: Any, node: Any) -> Body | None:
    """The section `body` of a model file; reader: `modelfile._Reader`, which tells what is wrong, and where."""
    if node is None:
        return None
    known = reader.section(node, ("body",), ("of", *KEPT), ("of",))
    entries = {name: value for name, value in known.items() if name != "of"}
    found = {k: reader.number(v, "body", k, unit=PARAMETERS[k].unit) for k, v in entries.items()}
    try:
        values = {name: value for name, (value, _) in found.items()}
        return Body(values, str(known["of"]), {name: s for name, (_, s) in found.items() if s is not None})
    except ValueError as problem:
        raise reader.fail(str(problem), "body") from None


def body_entries(body: Body, entry: Callable[[float, float | None, str], dict[str, Any]]) -> dict[str, Any]:
    """That section; entry: how a value with standard error and unit is written."""
    return {"of": body.of, **{k: entry(v, body.stderr.get(k), PARAMETERS[k].unit) for k, v in body.values.items()}}
