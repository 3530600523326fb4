"""What goes wrong on a scripted rig really does: on the light rig and on one simulated in MuJoCo."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mazeplan.apps.testing import BallBehaviour, LightRig, Pass, PlayedRig, run_tree, scripted_rig
from mazeplan.core.errors import InputError
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.conformance import check_rig
from mazeplan.rigs.interface import Rig

MAZE = load_map("cme")
TILT = math.radians(3.0)


def driven(mishaps, seconds=2.0, ring=1, theta=0.0, u=(0.0, -TILT)):
    """Observations and true places (ring, deg) under a held command; at theta = 0 -gamma drives to positive theta."""
    machine = scripted_rig(mishaps, MAZE)
    machine.reset(ring=ring, theta=theta, rng=np.random.default_rng(0))
    seen, places = [], []
    for _ in range(round(30 * seconds)):
        seen.append(machine.observe())
        machine.command(*u)
        places.append((machine.ring, math.degrees(machine.theta)))
    return seen, places


def test_the_light_rig_is_a_rig():
    assert isinstance(LightRig(MAZE), Rig)
    results = check_rig(LightRig(MAZE), MAZE)
    assert [(r.name, r.detail) for r in results if not r.passed] == []


def test_a_ball_is_stuck_where_it_comes_by_and_then_free():
    text = "- ball_stuck: {theta_deg: 30, from_s: 0.3, to_s: 1.5}\n"
    _, places = driven(text)
    _, free = driven([])
    degrees = [theta for _, theta in places]
    held = [theta for theta in degrees if abs(theta - 30.0) < 3.0]  # in MuJoCo it is caught a sample late
    assert len(held) > 15
    assert np.ptp(degrees[-1] - np.array(degrees[-3:])) > 0.3  # rolls again
    assert max(degrees) < max(theta for _, theta in free)
    k = next(k for k, theta in enumerate(degrees) if theta > 28.5)
    assert degrees[k : round(30 * 1.45)] == pytest.approx([degrees[k + 1]] * (round(30 * 1.45) - k), abs=2.0)


@pytest.mark.parametrize(("more", "stuck"), [("", True), (", ring: 1", True), (", ring: 2", False)])
def test_it_may_be_stuck_in_one_ring_only(more, stuck):
    _, places = driven(f"- ball_stuck: {{theta_deg: 10{more}}}\n", seconds=1.5)
    assert (abs(places[-1][1] - 10.0) < 1e-6) == stuck


def test_a_ball_on_the_far_side_is_not_stuck():
    _, places = driven("- ball_stuck: {theta_deg: 180}\n", theta=-0.3, seconds=1.0)
    assert 5.0 < places[-1][1] < 90.0


def test_an_opening_is_blocked_for_as_long_as_it_says():
    start, push = math.radians(45.0), (-TILT * math.cos(math.radians(45.0)), TILT * math.sin(math.radians(45.0)))
    for text, last in (
        ([], 2),
        ("- opening_blocked: {opening: 1-2@45}\n", 1),
        ("- opening_blocked: {opening: 1-2@135}\n", 2),
        ("- opening_blocked: {opening: 1-2@45, to_s: 1.0}\n", 2),
    ):
        _, places = driven(text, theta=start, u=push)
        assert (max(ring for ring, _ in places) >= 2) == (last == 2), text
        if isinstance(text, str) and "to_s" in text:
            assert max(ring for ring, _ in places[:28]) == 1


def test_the_camera_is_blind_from_one_moment_to_another():
    seen, _ = driven("- camera_blind: {from_s: 0.5, to_s: 0.9}\n", seconds=1.2)
    assert [round(o.t, 3) for o in seen if o.x is None] == [round(k / 30, 3) for k in range(15, 27)]


def test_a_ball_is_teleported_once_at_its_time_or_ring():
    _, places = driven("- ball_teleported: {ring: 3, theta_deg: 120, at_s: 0.5}\n", seconds=0.7, u=(0.0, 0.0))
    assert {ring for ring, _ in places[:14]} == {1}
    assert {ring for ring, _ in places[16:]} == {3}
    assert places[17][1] == pytest.approx(120.0, abs=3.0)
    _, places = driven("- ball_teleported: {ring: 1, in_ring: 3}\n", seconds=0.4, ring=3, u=(0.0, 0.0))
    assert places[5][0] == 1
    _, places = driven("- ball_teleported: {ring: 1, in_ring: 4}\n", seconds=0.4, ring=3, u=(0.0, 0.0))
    assert places[5][0] == 3


def test_a_ball_is_pushed_once():
    _, places = driven("- ball_pushed: {at_s: 0.2, speed_m_s: 0.2, direction_deg: 90}\n", seconds=0.6, u=(0.0, 0.0))
    assert abs(places[4][1]) < 0.5
    assert places[-1][1] > 15.0


@pytest.mark.parametrize("axis", ["gamma", "both"])
def test_a_dead_axis_keeps_its_command(axis):
    machine = scripted_rig(f"- axis_dead: {{axis: {axis}, from_s: 0.5, to_s: 1.5}}\n", MAZE)
    machine.reset(ring=1, theta=0.0, rng=np.random.default_rng(0))
    tilts = []
    for k in range(75):
        tilts.append(machine.observe())
        machine.command(*((TILT, TILT) if k < 20 else (-TILT, -TILT)))
    assert tilts[42].gamma == pytest.approx(TILT, abs=0.01)
    assert tilts[42].beta == pytest.approx(TILT if axis == "both" else -TILT, abs=0.01)
    assert tilts[74].gamma == pytest.approx(-TILT, abs=0.01)


def test_a_script_begins_anew_with_a_reset():
    machine = scripted_rig("- ball_teleported: {ring: 3, at_s: 0.1}\n- ball_stuck: {from_s: 0.2}\n", MAZE)
    runs = []
    for _ in range(2):
        machine.reset(ring=1, theta=0.0, rng=None)
        runs.append([])
        for _ in range(12):
            runs[-1].append(machine.observe())
            machine.command(0.0, TILT)
    assert runs[0] == runs[1]


def test_a_played_ball_does_what_it_is_told_whatever_is_commanded():
    ball = BallBehaviour(1, 0.0, (Pass("1-2@45"), Pass("2-3@90")), unseen=((0.1, 0.2),))
    rig = PlayedRig(MAZE, ball=ball)
    rig.reset(ring=4, theta=1.0, rng=None)
    rings, unseen = [], []
    for _ in range(120):
        o = rig.observe()
        rig.command(0.01, 0.2)
        rings.append(rig.ring)
        if not o.seen:
            unseen.append(round(30 * o.t))
    assert list(dict.fromkeys(rings)) == [1, 2, 3]
    assert unseen == [3, 4, 5]
    assert (o.beta, o.gamma) == (0.01, 0.2)
    assert math.degrees(rig.theta) == pytest.approx(90.0)


def test_mishaps_rigs_and_balls_that_cannot_go_together_are_refused():
    with pytest.raises(InputError, match="ball: a ball behaviour leaves neither room"):
        run_tree(ball=BallBehaviour(), mishaps="- camera_blind: {}\n")
    with pytest.raises(InputError, match="rig: mishaps happen on the light rig"):
        run_tree(rig=LightRig(MAZE), mishaps="- camera_blind: {}\n")
