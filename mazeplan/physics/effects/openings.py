"""Effects of openings: loss of speed of a passing ball.

The ball touches the outer or the inner wall of its channel, by the sign of the normal force (`ball.pressing`). The far
edge of an opening slows only a ball at that wall. The loss depends on the depth b to which the ball sinks into the
opening while it crosses, as on the floor (f = 5/7). The edge takes the part of the speed v that is normal to it: sin^2
of the angle between the edge and the centre of the ball, which has the radius a:

    d = b / a = s N' / (R v^2),    share = 1 - (1 - d)^2

s is the value of d without gravity: width^2 / (2 R a) if the ball crosses the whole width. N' is the normal force N at
the low-passed tilt, because a ball needs about a tenth of a second from wall to wall.

All openings of a wall are one effect. `pattern` holds their angles in the map. `rotation` turns the map relative to the
camera.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from mazeplan.core.constants import FREE_ROLLING
from mazeplan.core.constants import GRAVITY as G
from mazeplan.physics.effect import OPENING, Effect, Parameter
from mazeplan.physics.effects.ball import TURN, pressing, spread_angles
from mazeplan.physics.formulas.symbols import clip, cos, exp, sin

SIDE_WIDTH = 0.1  # m/s^2; default width of the change of sides; the tilt is known to about 0.5 degrees
SLOWEST = 1e-9  # rad^2/s^2
BEHIND = 0.02  # rad, minimum distance of the far edge behind the middle of an opening
STARTS = 8  # minimum number of start angles for `rotation`, within one period of the openings of a wall
EDGES = "the prediction meets the edges of the map's openings themselves, and a plan along a ring ends in front of one"


@dataclass(frozen=True)
class Openings:
    """Angles (rad) of the openings in the outer and the inner wall of a ring, by the map."""

    outer: tuple[float, ...] = ()
    inner: tuple[float, ...] = ()


def against(s: Any, side: float, width: Any) -> Any:
    """How much the ball lies against a wall: 0 not at all, 1 fully.

    side:  1 for the outer wall, -1 for the inner wall
    width: of the change from one wall to the other, m/s^2
    """
    return 1 / (1 + exp(clip(-side * s.radius * pressing(s) / width, -700.0, 700.0)))


def struck(s: Any, side: float, sinking: Any) -> Any:
    """Share (0 to 1) of the ball's speed that is directed against the far edge of an opening.

    side:    1 for an opening in the outer wall, -1 in the inner wall
    sinking: depth, in radii of the ball, to which the ball sinks in without gravity
    """
    across = sin(s.late_beta) * cos(s.theta) - sin(s.late_gamma) * sin(s.theta)
    depth = sinking * side * (1 + FREE_ROLLING * G / s.radius * across / (s.theta_dot**2 + SLOWEST))
    depth = clip(depth, 0.0, 1.0)
    return depth * (2 - depth)


gate_loss = Effect(
    "gate_loss",
    {
        "angle": Parameter("rad", 0.0, -TURN, TURN, step=0.03),
        "loss": Parameter("1", 0.0, 0.0, 0.9, smallest=0.02, step=1e-3, words="share of the speed lost"),
    },
    OPENING, lambda s, p: {"angle": p.angle, "loss": p.loss}, starts=tuple((angle, 0.1) for angle in spread_angles(24)),
    places=("angle",), text="share of the speed that is lost in passing one angle", source="inelastic impact",
)  # fmt: skip


def _wall(name: str, angles: Sequence[float], side: float) -> Effect:
    """All openings of a wall as one effect: a ball at the wall loses speed; a loss above 1 throws the ball back."""
    period = _period(angles)
    count = max(STARTS, round(period / math.radians(5.0)))
    return Effect(
        name,
        {
            "rotation": Parameter("rad", 0.0, -TURN, TURN, step=0.03),
            "loss": Parameter("1", 0.0, 0.0, 1.8, smallest=0.03, step=1e-3, words="share of the speed lost"),
        },
        OPENING, lambda s, p: {"angle": p.rotation, "loss": p.loss * against(s, side, SIDE_WIDTH)},
        starts=tuple((period * ((i + 0.5) / count - 0.5), 0.3) for i in range(count)), places=("rotation",),
        rivals=(name.replace("gates", "edges"),), why_not=EDGES, pattern=tuple(angles), side=side,
        text="all openings of a wall, turned by rotation against the map: a ball at the wall loses speed",
        source="inelastic impact at the far edge",
    )  # fmt: skip


def wall_library(openings: Openings) -> list[Effect]:
    """Effects of the openings of a ring's walls."""
    walls = (("outer_gates", openings.outer, 1.0), ("inner_gates", openings.inner, -1.0))
    return [_wall(name, angles, side) for name, angles, side in walls if angles]


def closer_library(openings: Openings) -> list[Effect]:
    """Detailed effects of the openings, in two variants.

    The first is that of `wall_library` with a fitted `width` of the change of sides. The second models sinking: the
    ball meets the far edge at `reach` behind the middle; its `loss` holds for a ball that sank in by its radius."""
    found = []
    for plain in wall_library(openings):
        width = {"width": Parameter("m/s^2", SIDE_WIDTH, 2e-3, 1.0, step=0.01)}
        found.append(replace(
            plain, parameters={**plain.parameters, **width}, places=("rotation", "width"),
            formula=lambda s, p, side=plain.side: {"angle": p.rotation, "loss": p.loss * against(s, side, p.width)},
        ))  # fmt: skip
        parameters = {
            **plain.parameters,
            "reach": Parameter("rad", BEHIND, BEHIND, 0.3, step=0.03),
            "sinking": Parameter("1", 0.0, 0.0, 1.0, step=1e-2),  # a ball that sinks in further leaves the ring
        }
        starts = tuple((rotation, 0.5, 0.05, 0.6) for rotation, _ in plain.starts)
        name, places = plain.name.replace("gates", "edges"), ("rotation", "reach", "sinking")
        found.append(replace(
            plain, name=name, parameters=parameters, starts=starts, places=places, rivals=(plain.name,),
            formula=lambda s, p, side=plain.side: {
                "angle": p.rotation + p.reach * s.direction, "loss": p.loss * struck(s, side, p.sinking),
            },
            text="the same openings by the ball's sinking into them: the far edge, reach behind the middle, takes the "
            "share of the speed that goes against it",
            source="geometry of a ball at a corner, inelastic impact",
        ))  # fmt: skip
    return found


def _period(angles: Sequence[float]) -> float:
    """Smallest turn, rad, after which the openings look the same."""
    for parts in range(len(angles), 1, -1):
        moved = [(a + TURN / parts - b) % TURN for a in angles for b in angles]
        if sum(min(d, TURN - d) < math.radians(1.0) for d in moved) == len(angles):
            return TURN / parts
    return TURN


FAMILY = (gate_loss,)
WALLS = (*closer_library(Openings((0.0,), (0.0,))),)  # for lists and documentation, which have no map
