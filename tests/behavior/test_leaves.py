"""Leaves and recoveries one by one, on a context without a rig."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mazeplan.behavior.context import RunContext, Steering
from mazeplan.behavior.registry import REGISTRY
from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.blame import CommandError
from mazeplan.btree.ports import Key
from mazeplan.btree.status import Status
from mazeplan.control.ilqg import IlqgOptions
from mazeplan.control.ring_planner import RingPlanner
from mazeplan.control.tilt import Plate
from mazeplan.core.events import LawChanged, OpeningPassed
from mazeplan.core.records import LEVEL, FailureKind, State, StopReason
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.graph import RouteGraph
from mazeplan.maze.mapfile import load_map
from mazeplan.run.settings import load_settings

MAZE = load_map("cme")
MODEL = RigModel.nominal(MAZE)


def at(ring=1, theta_deg=45.0, t=0.0, speed=0.0, **more):
    radius, theta = max(MAZE.track_radius(ring), 1e-3), math.radians(theta_deg)
    state = State(
        t, radius * math.cos(theta), radius * math.sin(theta), -speed * math.sin(theta), speed * math.cos(theta),
        0.0, 0.0, 0.0, 0.0, ring,
    )  # fmt: skip
    return replace(state, **more)


def planner(ring):
    return RingPlanner(MODEL.ring_parameters(ring, MAZE.track_radius(ring)), MAZE.tilt_limit, IlqgOptions(40))


class Bench:
    """A context, and leaves built on it."""

    def __init__(self, goal=5):
        self.events = []
        self.board = Blackboard()
        self.run = RunContext(
            maze=MAZE, graph=RouteGraph(MAZE), plate=Plate(MAZE.tilt_limit), goal=goal,
            steering=Steering({n: planner(n) for n in (1, 2)}, load_settings().leaves),
            ahead=lambda seconds, beside=(0.0, 0.0): self.run.here,
            report=self.events.append,
        )  # fmt: skip

    def leaf(self, kind, **ports):
        return REGISTRY[kind](kind, self.run, self.board, ports)

    def tick(self, leaf, state):
        self.run.begin(state.t, state, state)
        leaf.execute()
        return leaf.status

    def failure(self):
        return self.run.history.failures[-1].kind


@pytest.fixture
def bench():
    return Bench()


def test_every_leaf_is_in_the_registry_with_a_description():
    assert len(REGISTRY) >= 16
    for name, leaf in REGISTRY.items():
        assert leaf.__name__ == name
        assert (leaf.__doc__ or "").strip()


def test_route_and_opening(bench):
    assert bench.tick(bench.leaf("PlanRoute", goal=5, legs=Key("legs")), at(1, 50.0)) is Status.SUCCESS
    assert bench.board.get("legs") == 4
    assert bench.tick(bench.leaf("ChooseOpening", goal=5, opening=Key("opening")), at(1, 50.0)) is Status.SUCCESS
    assert bench.board.get("opening") == "1-2@45"
    for opening in MAZE.openings_between(1, 2):
        bench.run.graph.close(opening.name)
    for kind in ("PlanRoute", "ChooseOpening"):
        assert bench.tick(bench.leaf(kind, goal=5), at(1, 50.0)) is Status.FAILURE
        assert bench.failure() is FailureKind.NO_ROUTE


def test_plan_leads_to_the_opening_by_the_short_way_leaning_to_its_side(bench):
    leaf = bench.leaf("PlanInRing", opening="1-2@45", plan=Key("plan"))
    assert bench.tick(leaf, at(1, 20.0)) is Status.SUCCESS
    plan = bench.board.get("plan")
    distance = np.abs(plan.states[:, 0] - math.radians(45.0))
    assert distance.min() < 0.03
    assert np.all(np.abs(plan.controls) <= MAZE.tilt_limit)
    theta, beta, gamma = (plan.states[2 : np.argmin(distance) + 1, i] for i in (0, 2, 4))
    assert np.median(np.sin(beta) * np.cos(theta) - np.sin(gamma) * np.sin(theta)) < -0.02
    assert bench.run.history.planner_ms == [plan.ms]


def test_plan_that_is_not_finite_fails(bench):
    leaf = bench.leaf("PlanInRing", opening="1-2@45", plan=Key("plan"))
    assert bench.tick(leaf, at(1, 20.0, beta=math.nan)) is Status.FAILURE
    assert bench.failure() is FailureKind.PLAN_FAILED


def failing(bench, ring=1):
    """Planners whose solver fails from now on."""
    plan = bench.run.steering.planners[ring].plan
    bench.run.steering.planners[ring].plan = lambda *a, **k: replace(plan(*a, **k), reason=StopReason.NOT_FINITE)


def laws(bench):
    return [event.law for event in bench.events if isinstance(event, LawChanged)]


def test_without_any_plan_the_ball_is_brought_by_pd_and_the_log_says_so(bench):
    failing(bench)
    assert bench.tick(bench.leaf("PlanInRing", opening="1-2@45", plan=Key("plan")), at(1, 20.0)) is Status.SUCCESS
    track = bench.leaf("Track", opening="1-2@45", plan=Key("plan"))
    for t in (0.0, 0.03):
        assert bench.tick(track, at(1, 20.0, t=t)) is Status.RUNNING
        command, theta = bench.run.command, math.radians(20.0)
        assert -math.sin(theta) * command.u_beta - math.cos(theta) * command.u_gamma > 0.0  # towards it
    assert laws(bench) == ["pd"]


def test_a_plan_that_fails_on_the_way_leaves_the_gains_of_the_last_one(bench):
    assert bench.tick(bench.leaf("PlanInRing", opening="1-2@45", plan=Key("plan")), at(1, 20.0)) is Status.SUCCESS
    first = bench.board.get("plan")
    track = bench.leaf("Track", opening="1-2@45", plan=Key("plan"))
    bench.tick(track, at(1, 20.0, t=0.03))
    last = bench.board.get("plan")
    assert last is not first
    failing(bench)
    bench.tick(track, at(1, 20.5, t=0.07))
    assert bench.board.get("plan") is last
    k = 1
    u = last.controls[k] + last.gains[k] @ (at(1, 20.5).planner_vector() - last.states[k])
    expected = bench.run.plate.clip(*u)
    assert (bench.run.command.u_beta, bench.run.command.u_gamma) == pytest.approx((expected.u_beta, expected.u_gamma))
    assert laws(bench) == ["mpc", "gains"]


def test_in_the_disc_there_is_nothing_to_plan_or_track(bench):
    assert bench.tick(bench.leaf("PlanInRing", opening="4-5@180", plan=Key("plan")), at(5)) is Status.SUCCESS
    assert bench.board.get("plan") is None
    assert bench.tick(bench.leaf("Track", opening="4-5@180", plan=Key("plan")), at(5)) is Status.SUCCESS


def tracking(bench, theta=0.0, **ports):
    bench.tick(bench.leaf("PlanInRing", opening="1-2@45", plan=Key("plan")), at(1, theta))
    return bench.leaf("Track", opening="1-2@45", plan=Key("plan"), **ports)


def test_track_commands_along_the_ring_and_ends_in_front_of_the_opening(bench):
    leaf = tracking(bench)
    assert bench.tick(leaf, at(1, 0.0)) is Status.RUNNING
    assert bench.run.command is not None
    assert bench.run.command.u_gamma < -0.03  # a ball at theta = 0 goes to positive theta by negative gamma
    assert bench.run.commanded_by == "Track"
    assert bench.tick(leaf, at(1, 44.0, t=0.5)) is Status.SUCCESS
    assert bench.run.command is None


@pytest.mark.parametrize(
    ("state", "kind"),
    [
        (at(1, 0.0, t=9.0, speed=0.1), FailureKind.MISSED_OPENING),
        (at(3, 0.0, t=0.1), FailureKind.WRONG_RING),
    ],
)
def test_track_fails_by_kind(bench, state, kind):
    leaf = tracking(bench)
    bench.tick(leaf, at(1, 0.0))
    assert bench.tick(leaf, state) is Status.FAILURE
    assert bench.failure() is kind


def test_track_succeeds_when_the_ball_dropped_through_by_itself(bench):
    leaf = tracking(bench)
    bench.tick(leaf, at(1, 0.0))
    assert bench.tick(leaf, at(2, 45.0, t=0.2)) is Status.SUCCESS


def test_falling_back_is_told_from_another_wrong_ring():
    bench = Bench()
    leaf = bench.leaf("Align", opening="2-3@90")
    bench.tick(leaf, at(2, 60.0))
    assert bench.tick(leaf, at(1, 45.0, t=0.1)) is Status.FAILURE
    assert bench.failure() is FailureKind.FELL_BACK


def test_a_ball_that_is_suddenly_nearer_the_goal_did_not_fall_back():
    bench = Bench()
    leaf = bench.leaf("Align", opening="1-2@45")
    bench.tick(leaf, at(1, 20.0))
    assert bench.tick(leaf, at(4, 20.0, t=0.1)) is Status.FAILURE
    assert bench.failure() is FailureKind.WRONG_RING


@pytest.mark.parametrize("kind", ["Track", "Align"])
def test_a_ball_that_stands_is_stuck(bench, kind):
    leaf = tracking(bench) if kind == "Track" else bench.leaf("Align", opening="1-2@45")
    status = Status.RUNNING
    for k in range(40):
        status = bench.tick(leaf, at(1, 20.0, t=k / 30))
        if status is not Status.RUNNING:
            break
    assert status is Status.FAILURE
    assert bench.failure() is FailureKind.STUCK
    assert 0.55 < bench.run.now < 0.75


def test_align_gives_up_far_away_or_late(bench):
    leaf = bench.leaf("Align", opening="1-2@45")
    assert bench.tick(leaf, at(1, -140.0)) is Status.FAILURE
    assert bench.failure() is FailureKind.MISSED_OPENING
    leaf = bench.leaf("Align", opening="1-2@45", timeout_s=1.0)
    assert bench.tick(leaf, at(1, 20.0, speed=0.1)) is Status.RUNNING
    assert bench.tick(leaf, at(1, 60.0, t=1.1, speed=0.1)) is Status.FAILURE


def test_a_missed_opening_says_what_was_measured(bench):
    bench.run.leg.opening = MAZE.opening("1-2@45")
    leaf = bench.leaf("PassOpening", opening="1-2@45", timeout_s=1.0)
    inward = {"vx": -0.05 * math.cos(math.radians(46.0)), "vy": -0.05 * math.sin(math.radians(46.0))}
    for state in (at(1, 40.0, speed=0.3), at(1, 46.0, t=0.4, **inward), at(1, 52.0, t=1.1, speed=0.2)):
        bench.tick(leaf, state)
    assert bench.run.history.failures[-1].detail == {
        "passed_deg": pytest.approx(-7.0),  # it moves backwards where it is nearest
        "off_mm": pytest.approx(1e3 * MAZE.track_radius(1) * math.sin(math.radians(1.0)), abs=1e-3),
        "radial_m_s": pytest.approx(0.05, abs=1e-4),
        "tangential_m_s": pytest.approx(-0.05 * math.sin(math.radians(1.0)), abs=1e-4),
    }


def test_pass_pushes_through_and_remembers_an_opening_that_does_not_take_the_ball(bench):
    leaf = bench.leaf("PassOpening", opening="1-2@45")
    assert bench.tick(leaf, at(1, 45.0)) is Status.RUNNING
    command = bench.run.command
    assert command is not None
    assert command.u_beta < -0.05  # towards the centre from theta = 45 deg: -x and -y
    assert command.u_gamma > 0.05
    assert bench.tick(leaf, at(1, 45.0, t=1.3)) is Status.FAILURE
    assert bench.failure() is FailureKind.MISSED_OPENING
    assert bench.run.graph.tries("1-2@45") != (0, 0)
    leaf = bench.leaf("PassOpening", opening="1-2@45")
    bench.tick(leaf, at(1, 45.0))
    assert bench.tick(leaf, at(2, 45.0, t=0.3)) is Status.SUCCESS


@pytest.mark.parametrize(("goal", "ring", "good"), [(5, 2, True), (5, 1, False), (1, 1, True), (1, 2, False)])
def test_confirm_asks_for_the_side_nearer_the_goal(goal, ring, good):
    bench = Bench(goal)
    status = bench.tick(bench.leaf("ConfirmRing", opening="1-2@45"), at(ring, 45.0))
    assert status is (Status.SUCCESS if good else Status.FAILURE)
    assert (OpeningPassed("1-2@45", ring) in bench.events) == good


def test_settle_needs_the_time_inside_by_measurement(bench):
    leaf = bench.leaf("Settle", ring=5, hold_s=0.2)
    for k in range(6):
        assert bench.tick(leaf, at(5, t=k / 30)) is Status.RUNNING
        assert bench.run.command is not None
    assert bench.tick(leaf, at(5, t=6 / 30)) is Status.SUCCESS
    leaf = bench.leaf("Settle", ring=5, hold_s=0.2)
    for k in range(5):
        bench.tick(leaf, at(5, t=k / 30))
    for k in range(5, 12):  # a ball that is not seen proves nothing
        assert bench.tick(leaf, at(5, t=k / 30, seen=False)) is Status.RUNNING


def test_settle_fails_when_the_ball_leaves_or_never_comes(bench):
    leaf = bench.leaf("Settle", ring=5)
    bench.tick(leaf, at(5))
    assert bench.tick(leaf, at(4, 180.0, t=0.1)) is Status.FAILURE
    assert bench.failure() is FailureKind.FELL_BACK
    leaf = bench.leaf("Settle", ring=5, timeout_s=1.0)
    bench.tick(leaf, at(5, seen=False))
    assert bench.tick(leaf, at(5, t=1.1, seen=False)) is Status.FAILURE
    assert bench.failure() is FailureKind.MISSED_OPENING


@pytest.mark.parametrize(("theta", "outwards"), [(45.0, True), (0.0, False)])
def test_settling_in_a_channel_leans_away_from_the_nearest_opening(bench, theta, outwards):
    leaf = bench.leaf("Settle", ring=2)
    bench.tick(leaf, at(2, theta))
    command = bench.run.command
    assert command is not None
    c, s = math.cos(math.radians(theta)), math.sin(math.radians(theta))
    radial = c * command.u_beta - s * command.u_gamma
    # at 45 deg ring 2 opens outwards to ring 1, at 0 deg inwards to ring 3
    assert radial < 0.0 if outwards else radial > 0.0


@pytest.mark.parametrize(("doubt_mm", "seen_in"), [(0.0, 2), (0.6, 1)])
def test_the_next_move_begins_only_if_the_ball_gets_in_from_either_side(bench, doubt_mm, seen_in):
    opening, asked = MAZE.opening("1-2@45"), []

    def ahead(seconds, beside=(0.0, 0.0)):  # from a little clockwise it would meet the edge
        asked.append(beside)
        across = -math.sin(opening.angle) * beside[0] + math.cos(opening.angle) * beside[1]
        return replace(bench.run.here, ring=1 if across < -1e-6 else 2)

    bench.run.ahead = ahead
    steering = bench.run.steering
    gate = replace(steering.options.gate, entry_doubt_mm=doubt_mm)
    bench.run.steering = replace(steering, options=replace(steering.options, gate=gate))
    leaf = bench.leaf("PassOpening", opening=opening.name)
    assert bench.tick(leaf, at(1, 45.0)) is Status.RUNNING
    assert max(math.hypot(*beside) for beside in asked) == pytest.approx(1e-3 * doubt_mm)
    bench.run.begin(0.1, replace(at(1, 45.0), t=0.1), at(1, 45.0))
    assert bench.run.here.ring == seen_in


def test_two_commands_in_one_tick_are_a_bug(bench):
    bench.run.begin(0.0, at(1), at(1))
    bench.run.steer("one", LEVEL)
    with pytest.raises(CommandError, match="two and one"):
        bench.run.steer("two", LEVEL)


@pytest.mark.parametrize("kind", ["Align", "PassOpening", "Track"])
def test_an_opening_that_is_closed_on_the_way_is_given_up(bench, kind):
    assert bench.tick(bench.leaf("PlanInRing", opening="1-2@45", plan=Key("plan")), at(1, 20.0)) is Status.SUCCESS
    more = {"plan": Key("plan")} if kind == "Track" else {}
    leaf = bench.leaf(kind, opening="1-2@45", **more)
    assert bench.tick(leaf, at(1, 20.0)) is Status.RUNNING
    bench.run.graph.close("1-2@45")
    assert bench.tick(leaf, at(1, 20.0, t=1 / 30)) is Status.FAILURE
    assert bench.failure() is FailureKind.OPENING_CLOSED
