from __future__ import annotations

import math

import pytest

from mazeplan.constants import GRAVITY
from mazeplan.control.tilt import Plate

PLATE = Plate(limit=math.radians(5.0), offset_beta=0.004, offset_gamma=-0.002)


def test_command_gives_the_wished_acceleration_on_a_table_that_is_not_level():
    command = PLATE.command(0.3, -0.2)
    beta, gamma = command.u_beta + PLATE.offset_beta, command.u_gamma + PLATE.offset_gamma
    assert GRAVITY * beta == pytest.approx(0.3)
    assert -GRAVITY * gamma == pytest.approx(-0.2)


def test_commands_stay_inside_the_limit():
    command = PLATE.command(50.0, 50.0)
    assert (command.u_beta, command.u_gamma) == (PLATE.limit, -PLATE.limit)


def test_what_is_asked_first_is_not_bent_by_what_comes_then():
    plate = Plate(limit=0.08)
    first = (0.5, 0.0)
    both = plate.command_along(first, (2.0, 0.3))
    assert both.u_beta == pytest.approx(plate.limit)  # as much of the second as there is room for
    share = (plate.limit - 0.5 / GRAVITY) / (2.0 / GRAVITY)
    assert both.u_gamma == pytest.approx(-share * 0.3 / GRAVITY)  # the second keeps its direction


def test_second_wish_is_whole_when_there_is_room():
    both = Plate(limit=0.08).command_along((0.1, 0.1), (0.2, -0.3))
    assert (both.u_beta, both.u_gamma) == pytest.approx((0.3 / GRAVITY, 0.2 / GRAVITY))


def test_nothing_is_left_for_the_second_when_the_first_takes_all():
    both = Plate(limit=0.08).command_along((5.0, 0.0), (1.0, 1.0))
    assert both.u_beta == pytest.approx(0.08)
    assert both.u_gamma == pytest.approx(0.0)
