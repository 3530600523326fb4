"""Effects on the ball: gravity, forces along the ring, friction."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from mazeplan.core.constants import GRAVITY as G
from mazeplan.core.constants import WALL_ROLLING
from mazeplan.physics.effect import DRAG, DRY, FORCE, GRAVITY, WALL, Effect, Parameter
from mazeplan.physics.formulas.symbols import cos, exp, sin, size, tanh, wrap

TURN = 2.0 * math.pi
EDGE = 0.01  # rad, over which a sector begins and ends
RIPPLES = range(4, 10)  # harmonics of `surface_ripple`
NO_CLOCK = "a plan does not know the time of the record"


def pressing(s: Any) -> Any:
    """Normal force of a wall divided by mass and track radius, N / (m R), rad/s^2; positive outwards:

    theta_d^2 + f (g / R) (sin(beta) cos(theta) - sin(gamma) sin(theta)),  f = 5/9 for rolling on floor and wall."""
    pull = sin(s.beta) * cos(s.theta) - sin(s.gamma) * sin(s.theta)
    return s.theta_dot**2 + WALL_ROLLING * G / s.radius * pull


def _waves(s: Any, p: Any, harmonics: Any) -> Any:
    """Sum over n of cos_n cos(n theta) + sin_n sin(n theta)."""
    return sum(getattr(p, f"cos{n}") * cos(n * s.theta) + getattr(p, f"sin{n}") * sin(n * s.theta) for n in harmonics)


def _wave_parameters(harmonics: Any) -> dict[str, Parameter]:
    """Parameters for the amplitudes of harmonics."""
    wave = Parameter("rad/s^2", 0.0, -20.0, 20.0, smallest=0.06, step=1e-3)
    return {f"{kind}{n}": wave for n in harmonics for kind in ("cos", "sin")}


def _bump(s: Any, p: Any) -> Any:
    e = wrap(s.theta - p.centre) / p.width
    return p.height * e * exp(0.5 - e**2 / 2)


def _sector(s: Any, p: Any) -> Any:
    half = (wrap(p.end - p.start - math.pi) + math.pi) / 2
    inside = half - size(wrap(s.theta - p.start - half))
    return p.coefficient * (1 + tanh(inside / (2 * EDGE))) / 2


def spread_angles(count: int) -> list[float]:
    """Angles spread evenly over the circle, rad."""
    return [-math.pi + TURN * (i + 0.5) / count for i in range(count)]


_TILT = Parameter("rad", 0.0, -0.15, 0.15, smallest=0.0004, step=1e-5)
_FORCE = Parameter("m/s^2", 0.0, -1.0, 1.0, smallest=0.004, step=1e-4)
_AMPLITUDE = Parameter("rad", 0.0, -0.1, 0.1, smallest=0.001, step=1e-5)

rolling_inertia = Effect(
    "rolling_inertia",
    {"factor": Parameter("1", 1.0, 0.05, 1.5, smallest=0.007, step=1e-4, words="factor of the gravity part")},
    GRAVITY, lambda s, p: {"factor": p.factor}, by_radius={"factor": 0},
    text="gravity moves the ball less because it has to turn: 1 a sliding point, 5/7 a solid sphere that rolls on the "
    "floor, 5/9 one that rolls on floor and wall at once",
    source="Lagrange: 1 / (1 + k) with inertia k m R^2, 1 / (1 + 2 k) along a wall",
)  # fmt: skip
viscous_friction = Effect(
    "viscous_friction", {"coefficient": Parameter("1/s", 0.0, 0.0, 20.0, smallest=0.02, step=1e-4)}, DRAG,
    lambda s, p: p.coefficient, by_radius={"coefficient": 0}, text="friction in proportion to the speed",
    source="linear friction",
)  # fmt: skip
dry_friction = Effect(
    "dry_friction",
    {
        "coefficient": Parameter("rad/s^2", 0.0, 0.0, 20.0, smallest=0.035, step=1e-3),
        "asymmetry": Parameter("rad/s^2", 0.0, -10.0, 10.0, smallest=0.035, step=1e-3),
    },
    DRY, lambda s, p: p.coefficient + p.asymmetry * s.direction, by_radius={"coefficient": -1, "asymmetry": -1},
    starts=((0.1, 0.0),), text="friction of the same size at every speed, which can hold the ball; asymmetry: by how "
    "much it is larger forwards than on average",
    source="Coulomb, by time stepping (Moreau)",
)  # fmt: skip
quadratic_drag = Effect(
    "quadratic_drag", {"coefficient": Parameter("1/rad", 0.0, 0.0, 5.0, smallest=0.01, step=1e-4)}, DRAG,
    lambda s, p: p.coefficient * s.speed, by_radius={"coefficient": 1}, text="drag with the square of the speed",
    source="Newton's law of drag",
)  # fmt: skip
wall_friction = Effect(
    "wall_friction", {"coefficient": Parameter("1", 0.0, 0.0, 2.0, smallest=0.01, step=1e-4)}, WALL,
    lambda s, p: p.coefficient * size(pressing(s)), by_radius={"coefficient": 0}, starts=((0.02,),),
    text="dry friction at the wall: the coefficient times what presses the ball against it, its turning and gravity "
    "across the ring",
    source="Coulomb",
)  # fmt: skip
local_friction = Effect(
    "local_friction",
    {
        "ring": Parameter("1", 0.0, 0.0, 1000.0, fixed=True, words="ring"),
        "start": Parameter("rad", 0.0, -TURN, TURN, step=1e-3),
        "end": Parameter("rad", 1.0, -TURN, TURN, step=1e-3),
        "coefficient": Parameter("rad/s^2", 0.0, 0.0, 20.0, smallest=0.1, step=1e-3),
    },
    DRY, _sector, places=("start", "end"), starts=tuple((0.0, a - 0.35, a + 0.35, 0.3) for a in spread_angles(12)),
    text="dry friction in a sector of a ring, from start to end counter-clockwise: dirt, a worn floor",
    source="Coulomb",
)  # fmt: skip
tilt_offset = Effect(
    "tilt_offset",
    {"beta": replace(_TILT, words="down at +x"), "gamma": replace(_TILT, words="up at +y")},
    GRAVITY,
    lambda s, p: {"beta": p.beta, "gamma": p.gamma},
    by_radius={"beta": 0, "gamma": 0},
    common=True,
    text="the table is not level",
    source="geometry",
)
constant_force = Effect(
    "constant_force", {"x": _FORCE, "y": _FORCE}, GRAVITY, lambda s, p: {"x": p.x, "y": p.y},
    by_radius={"x": 0, "y": 0}, common=True, rivals=("tilt_offset",),
    text="a steady horizontal force that does not turn with the maze: a draught; the same as a table that is not level "
    "unless the maze is turned",
    source="Newton",
)  # fmt: skip
table_rocking = Effect(
    "table_rocking",
    {
        "frequency": Parameter("Hz", 0.0, 0.0, 15.0, step=1e-5), "beta": _AMPLITUDE, "gamma": _AMPLITUDE,
        "phase": Parameter("rad", 0.0, -TURN, TURN, step=1e-3),
    },
    GRAVITY,
    lambda s, p: {axis: getattr(p, axis) * sin(TURN * p.frequency * s.t + p.phase) for axis in ("beta", "gamma")},
    why_not="its phase is known only while it is measured", common=True, places=("frequency", "phase"),
    text="the table swings under the rig, and the tilt sensor does not see it", source="harmonic motion",
)  # fmt: skip
constant_torque = Effect(
    "constant_torque", {"acceleration": Parameter("rad/s^2", 0.0, -10.0, 10.0, smallest=0.03, step=1e-4)}, FORCE,
    lambda s, p: p.acceleration, by_radius=None, text="a push along the ring, the same everywhere", source="Newton",
)  # fmt: skip
surface_profile = Effect(
    "surface_profile", _wave_parameters((1, 2, 3)), FORCE, lambda s, p: _waves(s, p, (1, 2, 3)), by_radius=None,
    text="the floor is not flat: a force along the ring, harmonics 1 to 3", source="Fourier series",
)  # fmt: skip
surface_ripple = Effect(
    "surface_ripple", _wave_parameters(RIPPLES), FORCE, lambda s, p: _waves(s, p, RIPPLES), by_radius=None,
    text="the floor is uneven near openings: harmonics 4 to 9", source="Fourier series",
)  # fmt: skip
surface_bump = Effect(
    "surface_bump",
    {
        "centre": Parameter("rad", 0.0, -TURN, TURN, step=1e-3),
        "width": Parameter("rad", 0.2, math.radians(2.0), 1.5, step=1e-3),
        "height": Parameter("rad/s^2", 0.0, -50.0, 50.0, smallest=0.075, step=1e-3),
    },
    FORCE, _bump, by_radius=None, places=("centre", "width"), starts=tuple((a, 0.25, 0.1) for a in spread_angles(24)),
    text="one hill (positive height: off it) or one hollow, or a magnet; height: the largest force, on its flanks",
    source="derivative of a Gaussian bell",
)  # fmt: skip
friction_drift = Effect(
    "friction_drift",
    {
        "rate": Parameter("1/s^2", 0.0, -0.1, 0.1, smallest=0.00025, step=1e-6),
        "start": Parameter("1/s", 0.0, -20.0, 20.0, step=1e-4),
    },
    DRAG, lambda s, p: p.start + p.rate * s.t, why_not=f"{NO_CLOCK}; the new model has the viscous friction at its end",
    places=("start",), text="viscous friction that changes with time: start is what comes to the known one at time 0",
    source="linear friction",
)  # fmt: skip
ball_imbalance = Effect(
    "ball_imbalance",
    {
        "amplitude": Parameter("rad/s^2", 0.0, -20.0, 20.0, smallest=0.1, step=1e-3),
        "phase": Parameter("rad", 0.0, -TURN, TURN, step=1e-3),
    },
    FORCE, lambda s, p: p.amplitude * sin(s.theta * s.radius / s.ball_radius + p.phase), places=("phase",),
    why_not="the phase is lost whenever the ball slips", starts=tuple((0.2, a) for a in spread_angles(6)),
    text="the ball's centre of mass is off its middle, so that it speeds up and slows down with every turn",
    source="rolling without slip: it has turned by theta R / r",
)  # fmt: skip

FAMILY = (
    rolling_inertia, viscous_friction, dry_friction, wall_friction, quadratic_drag, tilt_offset, constant_torque,
    surface_profile, surface_ripple, surface_bump, friction_drift, constant_force, table_rocking, local_friction,
    ball_imbalance,
)  # fmt: skip
