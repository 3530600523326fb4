"""Effects on the rigid-body ball at places of the plate or in time.

They are formulas in the plane, so one set of numbers holds for all rings:

    floor_warp      the floor has the height z = a (x^2 - y^2) + 2 b x y + c (x^2 + y^2)
    floor_bump      a pull of at most `depth` times gravity towards (x, y), derivative of a Gaussian bell of `width`
    floor_dirt      dry friction in a sector of a ring: radii `inner` to `outer`, from the angle `start` to `end`
    floor_kerb      a ball that passes an angle of a ring loses a share 1 - exp(-size) of its speed
    floor_ripple    a force along the rings with n = `waves` waves per turn: c cos(n theta) + s sin(n theta), m/s^2
    table_swing     the table tilts by bs sin wt + bc cos wt (beta), gs sin wt + gc cos wt (gamma); w = 2 pi `frequency`
    drag_drift      viscous friction that changes with time: start + rate t
    ring_push       a push along the rings: force + turn r, m/s^2

Four more show a change without a named cause:

    table_beat      a second `table_swing` at twice or three times the frequency of the first: repeated pushes
    swing_along     a force along the ring that oscillates in time
    lean_drift      the table tilts more and more: beta t, gamma t
    moving_friction dry friction in proportion to the speed of the plate
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from mazeplan.physics.effect import DRAG, DRY, FORCE, GRAVITY, Effect, Parameter
from mazeplan.physics.effects.ball import NO_CLOCK
from mazeplan.physics.formulas.symbols import cos, exp, sin, size, sqrt, tanh, wrap

BUMP_WIDTH_M = 0.015  # m, default width of a bump
STEEP = Parameter("1/m", 0.0, -1.0, 1.0, smallest=0.004, step=2e-3)
PLACE = Parameter("m", 0.0, -0.2, 0.2, step=5e-4)
DEPTH = Parameter("1", 0.0, -0.2, 0.2, smallest=0.002, step=1e-3)
SWING = Parameter("rad", 0.0, -0.1, 0.1, smallest=0.001, step=5e-4)
FREQUENCY = Parameter("Hz", 0.0, 0.0, 15.0, step=1e-4)
ANGLE = Parameter("rad", 0.0, -2.0 * math.pi, 2.0 * math.pi, step=2e-2)
RADIUS = Parameter("m", 0.0, 0.0, 1.0, step=1e-3, fixed=True)
DIRT_EDGE_RAD = 0.005  # rad, over which dirt begins and ends
KERB = 0.05  # rad, width of a kerb
BORDER = 1e-3  # m along the radius, over which dirt and kerb begin and end


def _warp(s: Any, p: Any) -> dict[str, Any]:
    x, y = s.radius * cos(s.theta), s.radius * sin(s.theta)
    return {"beta": -2.0 * (p.a * x + p.b * y + p.c * x), "gamma": 2.0 * (p.b * x - p.a * y + p.c * y)}


def _bump(s: Any, p: Any) -> dict[str, Any]:
    x, y = (s.radius * cos(s.theta) - p.x) / p.width, (s.radius * sin(s.theta) - p.y) / p.width
    pull = p.depth * exp(0.5 - 0.5 * (x * x + y * y))  # the tilt is largest, `depth`, at one width from the middle
    return {"beta": -pull * x, "gamma": pull * y}


def _dirt(s: Any, p: Any) -> Any:
    away = size(wrap(s.theta - (p.start + p.end) / 2))
    along = 1 + tanh(((p.end - p.start) / 2 - away) / (2 * DIRT_EDGE_RAD))
    return p.coefficient / s.radius * along * _across(s, p) / 2


def _across(s: Any, p: Any) -> Any:
    return (1 + tanh((s.radius - p.inner) / (2 * BORDER))) * (1 + tanh((p.outer - s.radius) / (2 * BORDER))) / 4


def _kerb(s: Any, p: Any) -> Any:
    away = wrap(s.theta - p.centre) / KERB
    return p.size * s.speed * exp(-0.5 * away**2) / (KERB * math.sqrt(2.0 * math.pi)) * _across(s, p)


def _swing(s: Any, p: Any) -> dict[str, Any]:
    phase = 2.0 * math.pi * p.frequency * s.t
    return {"beta": p.bs * sin(phase) + p.bc * cos(phase), "gamma": p.gs * sin(phase) + p.gc * cos(phase)}


def _along(s: Any, p: Any) -> Any:
    phase = 2.0 * math.pi * p.frequency * s.t
    return (p.s * sin(phase) + p.c * cos(phase)) / s.radius


MOVED = Parameter("m/s^2", 0.0, -2.0, 2.0, smallest=0.01, step=5e-3)

floor_warp = Effect("floor_warp", {"a": STEEP, "b": STEEP, "c": STEEP}, GRAVITY, _warp, text="the floor is not flat")
floor_bump = Effect(
    "floor_bump",
    {"x": PLACE, "y": PLACE, "depth": DEPTH, "width": Parameter("m", BUMP_WIDTH_M, 0.004, 0.06, step=5e-4)},
    GRAVITY, _bump, places=("x", "y", "width"), text="one hill or hollow, or a magnet",
)  # fmt: skip
floor_dirt = Effect(
    "floor_dirt",
    {
        "start": ANGLE, "end": replace(ANGLE, default=0.6), "inner": RADIUS, "outer": RADIUS,
        "coefficient": Parameter("m/s^2", 0.0, 0.0, 5.0, smallest=0.02, step=1e-2),
    },
    DRY, _dirt, places=("start", "end", "inner", "outer"), text="dry friction in a sector of a ring",
)  # fmt: skip
floor_kerb = Effect(
    "floor_kerb",
    {
        "centre": ANGLE, "inner": RADIUS, "outer": RADIUS,
        "size": Parameter("1", 0.0, 0.0, 3.0, smallest=0.03, step=0.03),
    },
    DRAG, _kerb, places=("centre", "inner", "outer"), text="speed is lost in passing one angle of a ring",
)  # fmt: skip
floor_ripple = Effect(
    "floor_ripple",
    {
        "waves": Parameter("1", 4.0, 1.0, 20.0, fixed=True),
        "c": MOVED, "s": MOVED,
    },
    FORCE, lambda s, p: (p.c * cos(p.waves * s.theta) + p.s * sin(p.waves * s.theta)) / s.radius,
    places=("waves",), text="the floor is uneven, with waves around",
)  # fmt: skip
table_swing = Effect(
    "table_swing", {"frequency": FREQUENCY, "bs": SWING, "bc": SWING, "gs": SWING, "gc": SWING},
    GRAVITY, _swing, places=("frequency",), text="the table rocks", why_not=NO_CLOCK,
)  # fmt: skip
table_beat = replace(table_swing, name="table_beat", text="the table is pushed repeatedly")
drag_drift = Effect(
    "drag_drift",
    {
        "rate": Parameter("1/s^2", 0.0, -0.1, 0.1, smallest=2e-4),
        "start": Parameter("1/s", 0.0, -5.0, 5.0, smallest=0.03),
    },
    DRAG, lambda s, p: p.start + p.rate * s.t, places=("start",), text="viscous friction that changes with time",
    why_not=NO_CLOCK,
)  # fmt: skip
ring_push = Effect(
    "ring_push",
    {
        "force": Parameter("m/s^2", 0.0, -2.0, 2.0, smallest=0.004, step=4e-3),
        "turn": Parameter("rad/s^2", 0.0, -20.0, 20.0, smallest=0.05, step=0.05),
    },
    FORCE, lambda s, p: p.turn + p.force / s.radius, text="a push along the rings",
)  # fmt: skip
swing_along = Effect(
    "swing_along", {"frequency": FREQUENCY, "s": MOVED, "c": MOVED}, FORCE, _along, places=("frequency",),
    text="a force along the ring that swings in time", why_not=NO_CLOCK,
)  # fmt: skip
lean_drift = Effect(
    "lean_drift", dict.fromkeys(("beta", "gamma"), Parameter("rad/s", 0.0, -1e-3, 1e-3, smallest=4e-6)), GRAVITY,
    lambda s, p: {"beta": p.beta * s.t, "gamma": p.gamma * s.t}, text="the table leans more and more",
    why_not=NO_CLOCK,
)  # fmt: skip
moving_friction = Effect(
    "moving_friction", {"coefficient": Parameter("m/s^2 / (rad/s)", 0.0, 0.0, 20.0, smallest=0.1)}, DRY,
    lambda s, p: p.coefficient / s.radius * sqrt(s.beta_dot**2 + s.gamma_dot**2),
    text="dry friction in proportion to how fast the plate moves",
)  # fmt: skip

FAMILY: dict[str, Effect] = {e.name: e for e in list(globals().values()) if isinstance(e, Effect)}
