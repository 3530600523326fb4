"""The light rig keeps the rules of every rig, and what a mishap does to it happens."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mazeplan.apps.testing import LightRig, run_tree
from mazeplan.core.errors import InputError
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.conformance import check_rig

MAZE = load_map("cme")
TILT = math.radians(3.0)


def driven(mishap=None, seconds=2.0, theta=0.0, u=(0.0, -TILT)):
    """Observations and true places (ring, deg) under a held command; at theta = 0 -gamma drives to positive theta."""
    machine = LightRig(MAZE, mishap=mishap)
    machine.reset(ring=1, theta=theta, rng=np.random.default_rng(0))
    seen, places = [], []
    for _ in range(round(30 * seconds)):
        seen.append(machine.observe())
        machine.command(*u)
        places.append((machine.ring, math.degrees(machine.theta)))
    return seen, places


def test_the_light_rig_is_a_rig():
    assert [(r.name, r.detail) for r in check_rig(LightRig(MAZE), MAZE) if not r.passed] == []


def test_a_glued_ball_stays_and_rolls_again():
    _, places = driven(lambda rig: setattr(rig, "glued", 0.5 <= rig.t < 1.5))
    assert places[40] == places[20]
    assert places[-1][1] > places[40][1] + 3.0


@pytest.mark.parametrize(("shut", "ring"), [("1-2@45", 1), ("1-2@135", 2)])
def test_a_blocked_opening_is_not_passed(shut, ring):
    start, push = math.radians(45.0), (-TILT * math.cos(math.radians(45.0)), TILT * math.sin(math.radians(45.0)))
    _, places = driven(lambda rig: rig.block(frozenset({shut})), theta=start, u=push)
    assert max(found for found, _ in places) >= ring
    assert (max(found for found, _ in places) == 1) == (ring == 1)


def test_a_ball_is_hidden_pushed_and_placed():
    def mishap(rig):
        rig.hidden = 0.45 <= rig.t < 0.85
        if rig.t == 0.0:
            rig.push(0.2, math.radians(90.0))
        if rig.t > 0.99 and rig.ring == 1:
            rig.place(3, math.radians(120.0))

    seen, places = driven(mishap, seconds=1.2, u=(0.0, 0.0))
    assert [k for k, o in enumerate(seen) if o.x is None] == list(range(14, 26))
    assert places[10][1] > 10.0
    assert places[31] == (3, pytest.approx(120.0, abs=3.0))


def test_a_dead_axis_keeps_its_command():
    machine = LightRig(MAZE, mishap=lambda rig: setattr(rig, "dead", frozenset({"gamma"} if rig.t > 0.5 else ())))
    machine.reset(ring=1, theta=0.0, rng=None)
    for k in range(60):
        tilt = machine.observe()
        machine.command(*((TILT, TILT) if k < 20 else (-TILT, -TILT)))
    assert (tilt.beta, tilt.gamma) == (pytest.approx(-TILT, abs=0.01), pytest.approx(TILT, abs=0.01))


def test_a_mishap_needs_the_light_rig():
    with pytest.raises(InputError, match="mishaps happen on the light rig"):
        run_tree(rig=LightRig(MAZE), mishap=lambda rig: None)
