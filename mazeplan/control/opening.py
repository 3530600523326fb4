"""Passage of an opening: hold the ball in front of it and push it along the opening's middle line.

With n the radial direction at the opening and e the direction across it, the wanted acceleration is

    first:  -(kp s + kd s_dot) e          s: offset of the ball across the opening, m
    then:   +-push n                      towards the other ring

The caller predicts the state `lead_s` ahead (planar model, last command held), because the servo needs that long.
The ball falls in at up to about 0.1 m/s across the opening, with the plate tilted towards it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mazeplan.control.tilt import Plate
from mazeplan.core.constants import GRAVITY
from mazeplan.core.field_checks import check_numbers
from mazeplan.core.records import Command, State
from mazeplan.maze.geometry import Opening

AWAY = 0.2  # of the tilt limit, away from an edge that holds the ball


@dataclass(frozen=True)
class OpeningOptions:
    """Settings `gate` of the passage. Raises SettingsError.

    kp, kd:                       PD gains across the opening, 1/s^2 and 1/s
    window_mm, window_speed_m_s:  offset and speed across the opening, mm and m/s; a ball inside both is aligned and
                                  may be pushed"""

    kp: float
    kd: float
    push_deg: float  # tilt towards the other ring, deg
    window_mm: float
    window_speed_m_s: float
    lead_s: float  # lag of the servo to look ahead, s
    entry_s: float  # the next move begins this long before the ball enters the next ring, s
    entry_doubt_mm: float  # condition for that: a ball this far to either side would enter, too, mm

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, slots=True)
class OpeningFrame:
    """Position (m) and velocity (m/s) of the ball along the opening's middle line, outwards, and across it."""

    along: float
    across: float
    along_speed: float
    across_speed: float


def opening_frame(state: State, opening: Opening) -> OpeningFrame:
    """Position and velocity in the opening's frame."""
    c, s = math.cos(opening.angle), math.sin(opening.angle)
    return OpeningFrame(
        along=c * state.x + s * state.y,
        across=-s * state.x + c * state.y,
        along_speed=c * state.vx + s * state.vy,
        across_speed=-s * state.vx + c * state.vy,
    )


def aligned(state: State, opening: Opening, options: OpeningOptions) -> bool:
    """Whether the ball is in front of the opening and slow enough to be pushed."""
    frame = opening_frame(state, opening)
    near = frame.along > 0.0 and abs(frame.across) <= 1e-3 * options.window_mm
    return near and abs(frame.across_speed) <= options.window_speed_m_s


def opening_command(
    state: State,
    opening: Opening,
    towards: int,
    plate: Plate,
    options: OpeningOptions,
    *,
    push_deg: float | None = None,
) -> Command:
    """The command that holds the ball across the opening and pushes it towards ring `towards`."""
    frame = opening_frame(state, opening)
    c, s = math.cos(opening.angle), math.sin(opening.angle)
    hold = -(options.kp * frame.across + options.kd * frame.across_speed)
    strength = GRAVITY * math.radians(options.push_deg if push_deg is None else push_deg)
    sign = -1.0 if towards == opening.inner else 1.0
    return plate.command_along((-s * hold, c * hold), (sign * strength * c, sign * strength * s))


def freeing_command(state: State, opening: Opening, towards: int, plate: Plate) -> Command:
    """The command that frees a ball held by the edge of an opening: across it, to the middle line, and a little away
    from the edge, where a push would only cause friction."""
    frame = opening_frame(state, opening)
    c, s = math.cos(opening.angle), math.sin(opening.angle)
    full = GRAVITY * plate.limit
    across, along = -math.copysign(full, frame.across), AWAY * full * (1.0 if towards == opening.inner else -1.0)
    return plate.command_along((-s * across, c * across), (along * c, along * s))
