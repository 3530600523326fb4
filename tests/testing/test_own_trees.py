"""The packaged trees, tested with the kit as a user would: every leaf and every recovery happens, and does what it
promises. What a mishap does stands above its run.

What is claimed is claimed by the kit: `visits`, `never`, `reaches`, `covers` ... raise AssertionError."""

from __future__ import annotations

import math
from functools import cache

import pytest

from mazeplan.apps.testing import LightRig, run_tree, tick_tree
from mazeplan.behavior.registry import REGISTRY
from mazeplan.core.records import LEVEL
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")


BEYOND = MAZE.walls[0].outer_radius + 2.0 * MAZE.ball.radius  # m, outside the maze


def teleport(ring, theta_deg, when):
    """A mishap: the ball is put to rest elsewhere, once."""
    done = []

    def happen(rig):
        if not done and when(rig):
            done.append(rig.t)
            rig.place(ring, math.radians(theta_deg))

    return happen


def smooth():
    return run_tree().reaches().never("Recover")


def already_there():
    return run_tree(start=5).reaches().within(0.5).never("PlanRoute")


def stuck():
    """Held for a second and a half, then shaken free."""
    record = run_tree(mishap=lambda rig: setattr(rig, "glued", rig.t < 1.5))
    record.visits("Track", "Dither", "PlanRoute", "Settle").reaches().within(6.0).never("LevelPlate", "AvoidOpening")
    assert record.failures == ["stuck"]
    tilts = [math.hypot(t.command.u_beta, t.command.u_gamma) for t in record.ticks if t.leaf == "Dither"]
    assert len(tilts) == 15  # half a second
    assert max(tilts) > math.radians(3.0)
    return record


def stuck_for_good():
    """Shaken six times, then another opening; in the end the run gives up, with the reason."""
    record = (
        run_tree(mishap=lambda rig: setattr(rig, "glued", rig.t >= 0.3))
        .ends_with("stuck")
        .visits("Dither", "AvoidOpening")
    )
    assert record.recoveries[:7] == ["dither"] * 6 + ["avoid_opening"]
    assert len(record.failures) == 20  # the attempts of the tree
    return record


def blind():
    """The plate is level while nobody knows where the ball is."""
    record = run_tree(mishap=lambda rig: setattr(rig, "hidden", 1.0 <= rig.t + 1e-9 < 2.4))
    record.visits("BallSeen", "LevelPlate", "PlanRoute")
    assert record.failures == ["ball_lost"]
    waiting = [t for t in record.ticks if t.leaf == "LevelPlate"]
    assert waiting[0].t == pytest.approx(1.5, abs=0.1)
    assert waiting[-1].t == pytest.approx(2.4, abs=0.1)
    assert all(t.command.u_beta == t.command.u_gamma == 0.0 for t in waiting)
    assert "HALTED" in record.statuses("Track")
    return record.reaches()


def blind_for_good():
    """It waits five seconds at a time, with a level plate."""
    record = run_tree(mishap=lambda rig: setattr(rig, "hidden", rig.t >= 1.0), time_limit=8.0).ends_with("out_of_time")
    assert record.statuses("LevelPlate").count("FAILURE") == 1
    return record.visits("LevelPlate", "BallSeen", "LevelPlate")


def blocked():
    """Once more, once from the other side, then by another opening."""
    record = run_tree(mishap=lambda rig: rig.block(frozenset({"1-2@45"})), start_angle_deg=40)
    record.visits("PassOpening", "Replan", "PassOpening", "BackOff", "ChooseOpening", "PassOpening").reaches().within(
        8.0
    )
    assert record.failures[0] == "missed_opening"
    assert record.openings[0] != "1-2@45"
    return record


def fell_back():
    """A new route from where it is."""
    record = run_tree(mishap=teleport(1, 120.0, lambda rig: rig.ring == 3))
    record.visits("Replan", "PlanRoute", "Settle").reaches()
    assert record.failures == ["fell_back"]
    assert record.result.replans == 1
    return record


def pushed_out_of_the_goal():
    record = run_tree(mishap=teleport(3, 0.0, lambda rig: rig.ring == 5)).visits("Settle", "Replan", "Settle")
    assert record.failures[0] == "fell_back"
    return record.reaches()


def put_back():
    def out_and_back(rig):
        if 0.5 <= rig.t < 1.5:
            rig.put(BEYOND, 0.0)
        elif rig.ring == 1 and math.hypot(*rig.z[:2]) > 0.9 * BEYOND:
            rig.place(2, 0.0)

    rig = LightRig(MAZE, mishap=out_and_back)
    rig.out_s = 3.0  # somebody may put it back
    record = run_tree(rig=rig)
    record.visits("BallSeen", "LevelPlate", "Track")
    assert record.failures[0] == "ball_out"
    return record.reaches()


def not_put_back():
    def out(rig):
        if rig.t >= 0.5:
            rig.put(BEYOND, 0.0)

    record = run_tree(mishap=out).ends_with("ball_out")
    assert record.failures == ["ball_out"]
    assert record.recoveries == ["level_plate"]
    return record.within(0.6)


def no_way():
    record = run_tree(closed=["4-5@180"]).ends_with("no_route").never("Recover")
    assert len(record.ticks) == 1
    return record


RUNS = (
    smooth, already_there, stuck, stuck_for_good, blind, blind_for_good, blocked,
    fell_back, pushed_out_of_the_goal, put_back, not_put_back, no_way,
)  # fmt: skip


@cache
def made(run):
    """The record of a run, made once; the run asserts what it promises."""
    return run()


@pytest.mark.slow
@pytest.mark.parametrize("run", RUNS, ids=lambda run: run.__name__)
def test_what_a_recovery_promises(run):
    assert made(run).ticks  # the run itself asserts the rest


# leaves of other trees than `navigate`: test_follow_policy, test_ball_leaves
ELSEWHERE = {"FollowPolicy", "BallsStay", "ChooseBall", "LeadBall"}


@pytest.mark.slow
def test_every_leaf_succeeds_and_those_that_can_fail_do():
    ends = {
        (record.nodes[step.node].kind, step.what) for record in map(made, RUNS) for step in record.steps if step.ticked
    }
    assert {(name, "SUCCESS") for name in REGISTRY.keys() - ELSEWHERE} <= ends
    failing = {"BallSeen", "InRing", "FailureIs", "PlanRoute", "Track", "PassOpening", "LevelPlate", "Settle"}
    assert {(name, "FAILURE") for name in failing} <= ends


def test_the_tree_of_waypoints_ends_in_the_goal_ring():
    run = run_tree("waypoints").visits("each ring", "Travel", "Settle").never("Recover")
    assert run.time_s < 6.0
    run.reaches().within(6.0)


def test_the_tree_of_two_balls_brings_each_and_ends_in_the_goal_ring():
    run = run_tree("two_balls").visits("one ball after the other", "LeadBall", "Travel", "Settle")
    assert run.time_s < 8.0
    run.reaches().within(8.0).never("Recover", "bring it back")


# -- the tree Recover alone, on every kind of failure ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("failures", "leaf"),
    [
        (["ball_lost"], "LevelPlate"),
        (["ball_out"], "LevelPlate"),
        (["stuck"], "Dither"),
        (["stuck"] * 6, "Dither"),
        (["stuck"] * 7, "AvoidOpening"),
        (["missed_opening"], "Replan"),
        (["missed_opening"] * 2, "BackOff"),
        (["missed_opening"] * 3, "AvoidOpening"),
        (["fell_back"], "Replan"),
        (["wrong_ring"], "Replan"),
        (["plan_failed"], "Replan"),
        (["opening_closed"], "Replan"),
        (["stuck", "fell_back"], "Replan"),
    ],
)
def test_the_recovery_goes_by_the_kind_and_the_number_of_failures(failures, leaf):
    recoveries = {"LevelPlate", "Dither", "BackOff", "AvoidOpening", "Replan"}
    record = tick_tree(main="Recover", failures=failures, ball=lambda t: (1, 15.0 * t))
    done = {record.nodes[step.node].kind for step in record.steps if step.ticked} & recoveries
    assert done == {leaf}
    record.ends_with("SUCCESS").within(1.0)


def test_waiting_for_the_ball_is_over_as_soon_as_it_is_seen_and_not_without_end():
    leaf = '<Delay delay_msec="600"><LevelPlate timeout_s="2"/></Delay>'  # lost after half a second
    tree = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{leaf}</BehaviorTree></root>'
    record = tick_tree(tree, ball=lambda t: (1, 0.0) if t > 0.999 else None).ends_with("SUCCESS")
    assert record.time_s == pytest.approx(1.0)
    assert all(tick.command == LEVEL for tick in record.ticks if tick.leaf)
    assert tick_tree(tree, ball=lambda t: None).ends_with("FAILURE").time_s == pytest.approx(2.6)
