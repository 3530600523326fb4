"""Effects of openings: loss of speed of a passing ball.

The ball touches the outer or the inner wall of its channel, by the sign of the normal force (`ball.pressing`). The far
edge of an opening slows only a ball that touches the wall with the opening.

All openings of a wall are one effect. `pattern` holds their angles in the map. `rotation` turns the map relative to the
camera.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from mazeplan.physics.effect import OPENING, Effect, Parameter
from mazeplan.physics.effects.ball import TURN, pressing
from mazeplan.physics.formulas.symbols import clip, exp

WIDTH = 0.1  # m/s^2; default width of the change of sides; the tilt is known to about 0.5 degrees
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


def _angles(count: int) -> list[float]:
    return [-math.pi + TURN * (i + 0.5) / count for i in range(count)]


gate_loss = Effect(
    "gate_loss",
    {
        "angle": Parameter("rad", 0.0, -TURN, TURN, step=0.03),
        "loss": Parameter("1", 0.0, 0.0, 0.9, smallest=0.02, step=1e-3, words="share of the speed lost"),
    },
    OPENING, lambda s, p: {"angle": p.angle, "loss": p.loss}, starts=tuple((angle, 0.1) for angle in _angles(24)),
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
        OPENING, lambda s, p: {"angle": p.rotation, "loss": p.loss * against(s, side, WIDTH)},
        starts=tuple((period * ((i + 0.5) / count - 0.5), 0.3) for i in range(count)), places=("rotation",),
        why_not=EDGES, pattern=tuple(angles), side=side,
        text="all openings of a wall, turned by rotation against the map: a ball at the wall loses speed",
        source="inelastic impact at the far edge",
    )  # fmt: skip


def wall_library(openings: Openings) -> list[Effect]:
    """Effects of the openings of a ring's walls."""
    walls = (("outer_gates", openings.outer, 1.0), ("inner_gates", openings.inner, -1.0))
    return [_wall(name, angles, side) for name, angles, side in walls if angles]


def _period(angles: Sequence[float]) -> float:
    """Smallest turn, rad, after which the openings look the same."""
    for parts in range(len(angles), 1, -1):
        moved = [(a + TURN / parts - b) % TURN for a in angles for b in angles]
        if sum(min(d, TURN - d) < math.radians(1.0) for d in moved) == len(angles):
            return TURN / parts
    return TURN


FAMILY = (gate_loss,)
WALLS = (*wall_library(Openings((0.0,), (0.0,))),)  # for lists and documentation, which have no map
