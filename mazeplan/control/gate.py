"""Through an opening: hold the ball in front of it and push it along the opening's middle line.

With n the radial direction at the opening and e the direction across it, the wish is

    first:  -(kp s + kd s_dot) e          s: offset of the ball across the opening, m
    then:   +-push n                      towards the other ring

The state is taken `lead` s ahead (planar model, last command held), because the servo needs that long to follow.
A gate takes the ball at up to about 0.1 m/s across it, under tilt towards it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mazeplan.constants import GRAVITY
from mazeplan.control.tilt import Plate
from mazeplan.maths.fields import check_numbers
from mazeplan.maze.geometry import Opening
from mazeplan.records import Command, State


@dataclass(frozen=True)
class GateOptions:
    """kp 1/s^2 and kd 1/s: PD across the opening; push_deg: tilt towards the other ring; window_mm and
    window_speed_m_s: inside both the ball is aligned and may be pushed; lead_s: servo lag to look ahead; entry_s:
    before the ball is in the next ring by so much the next move begins, if it gets there from entry_doubt_mm to either
    side, too. Raises SettingsError."""

    kp: float = 90.0
    kd: float = 16.0
    push_deg: float = 5.0
    window_mm: float = 12.0
    window_speed_m_s: float = 0.10
    lead_s: float = 0.08
    entry_s: float = 0.12
    entry_doubt_mm: float = 0.6

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, slots=True)
class GateFrame:
    """Where the ball is, seen from an opening: along its middle line (from the centre outwards) and across it, m,
    m/s."""

    along: float
    across: float
    along_speed: float
    across_speed: float


def gate_frame(state: State, opening: Opening) -> GateFrame:
    """Position and velocity in the opening's frame."""
    c, s = math.cos(opening.angle), math.sin(opening.angle)
    return GateFrame(
        along=c * state.x + s * state.y,
        across=-s * state.x + c * state.y,
        along_speed=c * state.vx + s * state.vy,
        across_speed=-s * state.vx + c * state.vy,
    )


def aligned(state: State, opening: Opening, options: GateOptions) -> bool:
    """Whether the ball is in front of the opening, slow enough to be pushed."""
    frame = gate_frame(state, opening)
    return (
        frame.along > 0.0
        and abs(frame.across) <= 1e-3 * options.window_mm
        and abs(frame.across_speed) <= options.window_speed_m_s
    )


def gate_command(
    state: State, opening: Opening, towards: int, plate: Plate, options: GateOptions, *, push_deg: float | None = None
) -> Command:
    """The command that holds the ball across the opening and pushes it towards ring `towards`."""
    frame = gate_frame(state, opening)
    c, s = math.cos(opening.angle), math.sin(opening.angle)
    hold = -(options.kp * frame.across + options.kd * frame.across_speed)
    strength = GRAVITY * math.radians(options.push_deg if push_deg is None else push_deg)
    sign = -1.0 if towards == opening.inner else 1.0
    return plate.command_along((-s * hold, c * hold), (sign * strength * c, sign * strength * s))
