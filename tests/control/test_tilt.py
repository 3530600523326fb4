from __future__ import annotations

import math

import pytest

from mazeplan.control.tilt import Plate
from mazeplan.core.constants import GRAVITY

PLATE = Plate(limit=math.radians(5.0), offset_beta=0.004, offset_gamma=-0.002)


def test_command_gives_the_wanted_acceleration_on_a_leaning_table():
    command = PLATE.command(0.3, -0.2)
    beta, gamma = command.u_beta + PLATE.offset_beta, command.u_gamma + PLATE.offset_gamma
    assert GRAVITY * beta == pytest.approx(0.3)
    assert -GRAVITY * gamma == pytest.approx(-0.2)


def test_commands_stay_inside_the_limit():
    command = PLATE.command(50.0, 50.0)
    assert (command.u_beta, command.u_gamma) == (PLATE.limit, -PLATE.limit)


SHARE = (0.08 - 0.5 / GRAVITY) / (2.0 / GRAVITY)  # of the second acceleration that the limit allows


@pytest.mark.parametrize(
    ("first", "then", "command"),
    [
        ((0.5, 0.0), (2.0, 0.3), (0.08, -SHARE * 0.3 / GRAVITY)),
        ((0.1, 0.1), (0.2, -0.3), (0.3 / GRAVITY, 0.2 / GRAVITY)),
        ((5.0, 0.0), (1.0, 1.0), (0.08, 0.0)),
    ],
    ids=["keeps its direction", "whole", "no room"],
)
def test_a_second_acceleration_never_changes_the_first(first, then, command):
    both = Plate(limit=0.08).command_along(first, then)
    assert (both.u_beta, both.u_gamma) == pytest.approx(command)
