from __future__ import annotations

import math

import pytest

from mazeplan.control.opening import aligned, opening_command, opening_frame
from mazeplan.control.tilt import Plate
from mazeplan.core.constants import GRAVITY
from mazeplan.core.records import State
from mazeplan.maze.geometry import Opening
from mazeplan.run.settings import load_settings

OPENING = Opening("1-2@135", 1, 2, math.radians(135.0), 0.0153)
PLATE = Plate(limit=math.radians(5.0))
OPTIONS = load_settings().leaves.gate


def beside(across: float, across_speed: float = 0.0, along: float = 0.089) -> State:
    c, s = math.cos(OPENING.angle), math.sin(OPENING.angle)
    return State(
        0.0, c * along - s * across, s * along + c * across, -s * across_speed, c * across_speed, 0.0, 0.0, 0.0, 0.0, 1
    )


def acceleration(command) -> tuple[float, float]:
    """(along, across) the opening, m/s^2, that a command gives a frictionless point."""
    ax, ay = GRAVITY * command.u_beta, -GRAVITY * command.u_gamma
    c, s = math.cos(OPENING.angle), math.sin(OPENING.angle)
    return c * ax + s * ay, -s * ax + c * ay


def test_frame_is_along_and_across_the_opening():
    frame = opening_frame(beside(0.004, -0.02), OPENING)
    assert (frame.along, frame.across) == pytest.approx((0.089, 0.004))
    assert (frame.along_speed, frame.across_speed) == pytest.approx((0.0, -0.02))


@pytest.mark.parametrize(("towards", "sign"), [(2, -1.0), (1, 1.0)])
def test_pushes_straight_through_towards_the_ring_asked_for(towards, sign):
    along, across = acceleration(opening_command(beside(0.0), OPENING, towards, PLATE, OPTIONS))
    assert sign * along > 0.8 * GRAVITY * math.radians(OPTIONS.push_deg)
    assert across == pytest.approx(0.0, abs=1e-12)


def test_holds_the_ball_across_the_opening():
    _, across = acceleration(opening_command(beside(0.002, 0.01), OPENING, 2, PLATE, OPTIONS))
    assert across == pytest.approx(-(OPTIONS.kp * 0.002 + OPTIONS.kd * 0.01))


def test_holding_comes_before_pushing():
    far = opening_command(beside(0.02), OPENING, 2, PLATE, OPTIONS)
    along, across = acceleration(far)
    assert across < -0.9 * GRAVITY * PLATE.limit
    assert abs(along) < 0.8 * GRAVITY * math.radians(OPTIONS.push_deg)


def test_aligned_needs_place_and_speed_and_the_right_side():
    assert aligned(beside(0.9 * 1e-3 * OPTIONS.window_mm), OPENING, OPTIONS)
    assert not aligned(beside(1.1 * 1e-3 * OPTIONS.window_mm), OPENING, OPTIONS)
    assert not aligned(beside(0.0, 1.1 * OPTIONS.window_speed_m_s), OPENING, OPTIONS)
    assert not aligned(beside(0.0, along=-0.089), OPENING, OPTIONS)
