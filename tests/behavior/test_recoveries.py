"""Recoveries and conditions: what they command, how they end, and what they say."""

from __future__ import annotations

import math

import pytest
from test_leaves import MAZE, Bench, at

from mazeplan.btree.status import Status
from mazeplan.control.estimation.sample_check import Out
from mazeplan.core.events import RecoveryChosen
from mazeplan.core.records import LEVEL, Failure, FailureKind


@pytest.fixture
def bench():
    return Bench()


def test_conditions(bench):
    assert bench.tick(bench.leaf("BallSeen"), at(1)) is Status.SUCCESS
    assert bench.tick(bench.leaf("BallSeen"), at(1, lost=True)) is Status.FAILURE
    assert bench.failure() is FailureKind.BALL_LOST
    assert bench.tick(bench.leaf("InRing", ring=2), at(2)) is Status.SUCCESS
    assert bench.tick(bench.leaf("InRing", ring=2), at(3)) is Status.FAILURE
    assert bench.tick(bench.leaf("FailureIs", kinds=["ball_lost", "stuck"]), at(1)) is Status.SUCCESS
    assert bench.tick(bench.leaf("FailureIs", kinds=["stuck"]), at(1)) is Status.FAILURE
    assert bench.tick(bench.leaf("FailureIs", kinds=["ball_lost"], at_most=0), at(1)) is Status.FAILURE


def test_recoveries_name_themselves_and_end(bench):
    bench.run.failed(Failure(FailureKind.STUCK, "Track", 0.0))
    bench.run.leg.opening = MAZE.opening("1-2@45")
    cases = {"Dither": 0.5, "BackOff": 0.35}
    for kind, duration in cases.items():
        leaf = bench.leaf(kind)
        commands = []
        for k in range(40):
            if bench.tick(leaf, at(1, 40.0, t=k / 30)) is Status.SUCCESS:
                break
            commands.append(bench.run.command)
        assert bench.run.now == pytest.approx(duration, abs=0.05)
        assert all(abs(c.u_beta) <= MAZE.tilt_limit and abs(c.u_gamma) <= MAZE.tilt_limit for c in commands)
        assert any(c != LEVEL for c in commands)
    assert [e.recovery for e in bench.events if isinstance(e, RecoveryChosen)] == ["dither", "back_off"]
    assert bench.run.history.failures[-1].recovery == "back_off"


def test_back_off_rolls_past_the_opening(bench):
    bench.run.leg.opening = MAZE.opening("1-2@45")
    bench.tick(bench.leaf("BackOff"), at(1, 40.0))
    command = bench.run.command
    theta = math.radians(40.0)
    assert -command.u_beta * math.sin(theta) - command.u_gamma * math.cos(theta) > 0.0  # towards larger theta


@pytest.mark.parametrize("tilt_deg", [0.0, 1.0, 3.0, 4.5])
def test_back_off_tilts_along_the_ring_by_as_much_as_it_says(bench, tilt_deg):
    bench.run.leg.opening = MAZE.opening("1-2@45")
    for degrees in (40.0, 50.0):  # to either side of the opening: through its front
        bench.tick(bench.leaf("BackOff", tilt_deg=tilt_deg), at(1, degrees))
        theta, command = math.radians(degrees), bench.run.command
        along = -command.u_beta * math.sin(theta) - command.u_gamma * math.cos(theta)
        across = command.u_beta * math.cos(theta) - command.u_gamma * math.sin(theta)
        assert along == pytest.approx(math.copysign(math.radians(tilt_deg), 45.0 - degrees), rel=0.01, abs=1e-12)
        assert across == pytest.approx(0.0, abs=1e-4)


def test_a_shake_turns_and_grows_as_it_says(bench):
    leaf = bench.leaf("Dither", duration_s=1.0, amplitude_deg=4.0, frequency_hz=2.5)
    for k in range(30):
        assert bench.tick(leaf, at(1, t=k / 30)) is Status.RUNNING
        since, command = k / 30, bench.run.command
        size = math.radians(4.0) * min(1.0, 0.4 + since)
        assert math.hypot(command.u_beta, command.u_gamma) == pytest.approx(size)
        turned = math.atan2(command.u_gamma, command.u_beta) - 2.0 * math.pi * 2.5 * since
        assert math.cos(turned) == pytest.approx(1.0)
    assert bench.tick(leaf, at(1, t=1.0)) is Status.SUCCESS
    assert bench.run.command is None


def test_a_ball_out_of_the_maze_is_told_before_one_that_is_lost_and_awaited_too(bench):
    out = Out(0.0, 0.12, 0.0, 0.0206)
    state = at(1, lost=True)
    leaf = bench.leaf("BallSeen")
    bench.run.begin(0.0, state, state, out)
    assert leaf.execute() is Status.FAILURE
    (failure,) = bench.run.history.failures
    assert (failure.kind, failure.x, failure.y) == (FailureKind.BALL_OUT, 0.12, 0.0)
    assert failure.words == "the ball has left the maze: it is 21 mm beyond the rim"
    wait = bench.leaf("LevelPlate", timeout_s=1.0)
    for t, where, expected in ((0.0, out, Status.RUNNING), (0.5, out, Status.RUNNING), (0.6, None, Status.SUCCESS)):
        bench.run.begin(t, at(1, t=t), at(1, t=t), where)
        assert wait.execute() is expected
        assert bench.run.command == (LEVEL if expected is Status.RUNNING else None)


def test_level_plate_waits_for_the_ball(bench):
    leaf = bench.leaf("LevelPlate", timeout_s=1.0)
    assert bench.tick(leaf, at(1, lost=True)) is Status.RUNNING
    assert bench.run.command == LEVEL
    assert bench.tick(leaf, at(1, t=0.1)) is Status.SUCCESS
    assert bench.run.command is None
    bench.tick(leaf, at(1, lost=True))
    assert bench.tick(leaf, at(1, t=0.99, lost=True)) is Status.RUNNING
    assert bench.tick(leaf, at(1, t=1.0, lost=True)) is Status.FAILURE


def test_avoid_makes_the_opening_dearer_and_replan_counts(bench):
    bench.run.leg.opening = MAZE.opening("1-2@45")
    before = bench.run.graph.cost("1-2@45", 1, 0.8)
    assert bench.tick(bench.leaf("AvoidOpening"), at(1)) is Status.SUCCESS
    assert bench.run.graph.cost("1-2@45", 1, 0.8) > before + 0.3
    other = Bench()
    for _ in range(2):  # so many failures are as dear
        other.run.graph.record("1-2@45", success=False)
    assert bench.run.graph.cost("1-2@45", 1, 0.8) == pytest.approx(other.run.graph.cost("1-2@45", 1, 0.8))
    assert bench.tick(bench.leaf("Replan"), at(1)) is Status.SUCCESS
    assert bench.run.history.replans == 1
