"""Leaves in rings with radial walls: the way that is free, detours, and what is on the other side of a wall."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from test_leaves import MAZE, Bench, at, failing

from mazeplan.btree.ports import Key
from mazeplan.btree.status import Status
from mazeplan.core.records import FailureKind
from mazeplan.maze.geometry import RadialWall
from mazeplan.maze.graph import RouteGraph


def walled(*walls: tuple[int, float], goal: int = 5) -> Bench:
    """A bench in cme with radial walls, by ring and degrees."""
    found = tuple(RadialWall(f"w{i}", ring, math.radians(angle), 0.005) for i, (ring, angle) in enumerate(walls))
    bench = Bench(goal)
    bench.run.maze = replace(MAZE, radial_walls=found)
    bench.run.graph = RouteGraph(bench.run.maze)
    return bench


def test_the_opening_chosen_is_the_soonest_by_the_way_that_is_free():
    bench = walled((1, 30.0))
    assert bench.tick(bench.leaf("ChooseOpening", goal=5, opening=Key("opening")), at(1, 20.0)) is Status.SUCCESS
    assert bench.board.get("opening") == "1-2@315"  # 1-2@45 is nearer, but behind the wall


def test_the_plan_goes_the_long_way_round_and_so_does_the_next_one():
    bench = walled((1, 30.0))
    leaf = bench.leaf("PlanInRing", opening="1-2@45", plan=Key("plan"))
    assert bench.tick(leaf, at(1, 20.0)) is Status.SUCCESS
    track = bench.leaf("Track", opening="1-2@45", plan=Key("plan"))
    for k in range(3):
        theta = bench.board.get("plan").states[:, 0]
        assert theta[-1] < theta[0] - 0.3
        assert np.all(np.diff(theta) < 0.02)  # never towards the wall
        assert bench.tick(track, at(1, 20.0 - 0.2 * k, t=k / 30.0)) is Status.RUNNING
    assert bench.run.turn_to(MAZE.opening("1-2@45")) < -math.pi


def test_without_a_plan_the_ball_is_driven_the_long_way_too():
    bench = walled((1, 30.0))
    failing(bench)
    bench.tick(bench.leaf("PlanInRing", opening="1-2@45", plan=Key("plan")), at(1, 20.0))
    bench.tick(bench.leaf("Track", opening="1-2@45", plan=Key("plan")), at(1, 20.0))
    u, theta = bench.run.command, math.radians(20.0)
    assert u is not None
    assert bench.run.law == "pd"
    assert u.u_beta * -math.sin(theta) + -u.u_gamma * math.cos(theta) < -0.01  # pushed towards smaller angles


@pytest.mark.parametrize("kind", ["PlanInRing", "Track", "Align"])
def test_an_opening_on_the_other_side_of_a_wall_is_not_tried(kind):
    bench = walled((1, 30.0), (1, 180.0))
    ports = {} if kind == "Align" else {"plan": Key("plan")}
    bench.board.set("plan", None)
    assert bench.tick(bench.leaf(kind, opening="1-2@45", **ports), at(1, 25.0)) is Status.FAILURE
    assert bench.failure() is FailureKind.WRONG_RING
    assert "a radial wall stands between the ball and 1-2@45" in bench.run.history.failures[-1].words


def test_a_detour_outwards_is_confirmed_in_the_outer_ring():
    bench = walled((2, 30.0), (2, 60.0))
    ball = at(2, 45.0)  # between walls that leave only the way out
    assert bench.tick(bench.leaf("ChooseOpening", goal=5, opening=Key("opening")), ball) is Status.SUCCESS
    assert bench.board.get("opening") == "1-2@45"
    confirm = bench.leaf("ConfirmRing", opening="1-2@45")
    assert bench.tick(confirm, at(1, 45.0, t=0.5)) is Status.SUCCESS
    assert bench.tick(bench.leaf("ConfirmRing", opening="1-2@45"), ball) is Status.FAILURE
    assert bench.failure() is FailureKind.WRONG_RING


def test_in_the_right_ring_behind_a_wall_the_opening_was_not_passed():
    bench = walled((2, 30.0), (2, 60.0))
    assert bench.tick(bench.leaf("ConfirmRing", opening="1-2@45"), at(2, 45.0)) is Status.SUCCESS
    assert bench.tick(bench.leaf("ConfirmRing", opening="1-2@45"), at(2, 70.0, t=1.0)) is Status.FAILURE
    assert bench.run.graph.tries("1-2@45")[0] == pytest.approx(1.0, rel=0.02)


def test_it_backs_off_past_the_opening():
    bench = walled()
    bench.run.leg.opening = MAZE.opening("1-2@45")
    assert bench.tick(bench.leaf("BackOff"), at(1, 42.0)) is Status.RUNNING
    u, theta = bench.run.command, math.radians(42.0)
    assert u is not None
    assert (-u.u_beta * math.sin(theta) - u.u_gamma * math.cos(theta)) > 0.01


def test_a_long_way_may_take_longer():
    missed = {}
    for name, bench in (("short", walled()), ("long", walled((1, 30.0)))):
        bench.board.set("plan", None)
        bench.tick(bench.leaf("PlanInRing", opening="1-2@45", plan=Key("plan")), at(1, 25.0))
        track = bench.leaf("Track", opening="1-2@45", plan=Key("plan"))
        for k in range(200):  # it goes on, but does not come near
            theta = 200.0 + 5.0 * (k % 20) if k else 25.0
            if bench.tick(track, at(1, theta, t=k / 30.0)) is Status.FAILURE:
                break
        missed[name] = bench.run.history.failures[-1].t
        assert bench.failure() is FailureKind.MISSED_OPENING
    assert missed["short"] == pytest.approx(4.0, abs=0.1)
    assert missed["long"] > 4.2


@pytest.mark.parametrize(("theta", "ring"), [(45.0, 2), (70.0, 1)])
def test_a_ball_that_rolls_past_the_wall_of_the_sector_it_was_to_fall_into_is_still_outside(theta, ring):
    bench = walled((2, 30.0), (2, 60.0))
    run, state = bench.run, at(1, 45.0)
    run.begin(0.0, state, state)
    run.leg.opening = MAZE.opening("1-2@45")
    run.leg.enter(run.here.ring, 2, run.now)
    state = at(1, theta, t=0.05)
    run.begin(0.05, state, state)
    assert run.here.ring == ring
