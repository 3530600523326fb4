"""Choosing an opening by planned time: what the plan knows counts, and little is planned for nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from test_leaves import MAZE, Bench, at

from mazeplan.behavior.travel import arrival_s, arrival_speed, plan_to
from mazeplan.btree.ports import Key
from mazeplan.btree.status import Status
from mazeplan.core.records import Plan, StopReason
from mazeplan.run.settings import load_settings

LEAVES = load_settings().leaves


def patient(choices=3):
    """A bench whose planners have no deadline."""
    bench = Bench()
    options = replace(LEAVES, travel=replace(LEAVES.travel, planned_choices=choices, deadline_ms=1e6))
    bench.run.steering = replace(bench.run.steering, options=options)
    return bench


def chosen(bench, state):
    leaf = bench.leaf("ChooseOpening", goal=5, opening=Key("opening"))
    assert bench.tick(leaf, state) is Status.SUCCESS
    return bench.board.get("opening")


@pytest.mark.parametrize(("speed", "opening"), [(0.25, "2-3@90"), (-0.25, "2-3@180")])
def test_a_ball_on_its_way_goes_on(speed, opening):
    """Half way between two openings the formula cannot tell which is better; the plan sees where the ball goes."""
    bench = patient()
    for name in ("2-3@0", "2-3@270"):
        bench.run.graph.close(name)
    # counted against the openings, so that speed along theta points to the one of 180 degrees when it is positive
    assert chosen(bench, at(2, 135.0, speed=-speed)) == opening
    assert len(bench.run.history.planner_ms) == 2, "both were planned to"


def test_by_the_formula_alone_the_speed_does_not_count():
    names = {chosen(patient(choices=1), at(2, 135.0, speed=speed)) for speed in (0.25, -0.25)}
    assert len(names) == 1
    bench = patient(choices=1)
    chosen(bench, at(2, 135.0))
    assert bench.run.history.planner_ms == []


def test_an_opening_that_is_much_later_is_not_planned_to():
    bench = patient()
    assert chosen(bench, at(1, 46.0)) == "1-2@45"
    assert len(bench.run.history.planner_ms) <= 2


def test_the_plan_of_the_choice_is_followed_and_not_made_again():
    bench = patient()
    state = at(2, 130.0)
    opening = chosen(bench, state)
    made = len(bench.run.history.planner_ms)
    assert made >= 2
    leaf = bench.leaf("PlanInRing", opening=opening, plan=Key("plan"))
    assert bench.tick(leaf, state) is Status.SUCCESS
    assert len(bench.run.history.planner_ms) == made
    plan = bench.board.get("plan")
    assert bench.run.leg.plan is plan
    assert np.abs(plan.states[:, 0] - MAZE.opening(opening).angle).min() < 0.05
    assert (
        bench.tick(bench.leaf("PlanInRing", opening=opening, plan=Key("plan")), at(2, 130.0, t=0.1)) is Status.SUCCESS
    )
    assert len(bench.run.history.planner_ms) == made + 1, "an old one is"


def test_the_deadline_is_shared():
    bench = patient()
    asked = []
    plan = bench.run.steering.planners[2].plan
    bench.run.steering.planners[2].plan = lambda *a, **k: asked.append(k["deadline_ms"]) or plan(*a, **k)
    chosen(bench, at(2, 130.0))
    assert sum(asked) == pytest.approx(1e6)


def test_a_plan_that_failed_chooses_nothing():
    bench = patient()
    plan = bench.run.steering.planners[2].plan
    bench.run.steering.planners[2].plan = lambda *a, **k: replace(plan(*a, **k), reason=StopReason.NOT_FINITE)
    assert chosen(bench, at(2, 100.0)) == "2-3@90"
    assert bench.run.leg.prepared is None


def test_arrival_is_the_first_time_in_front_and_slow():
    bench, opening = patient(), MAZE.opening("1-2@45")
    state = at(1, 20.0)
    bench.run.begin(0.0, state, state)
    plan = plan_to(bench.run, opening)
    radius, gate = MAZE.track_radius(1), bench.run.steering.options.gate
    k = round(arrival_s(bench.run, opening, plan) / plan.dt)
    off = radius * np.abs(np.sin(plan.states[:, 0] - opening.angle)) * 1e3
    slow = np.abs(plan.states[:, 1]) * radius
    assert off[k] <= gate.window_mm
    assert slow[k] <= gate.window_speed_m_s
    assert ((off[:k] > gate.window_mm) | (slow[:k] > gate.window_speed_m_s)).all()
    assert 5 < k < 30


def test_an_arrival_beyond_the_plan_is_the_way_that_is_left():
    bench, opening = patient(), MAZE.opening("1-2@45")
    state = at(1, 20.0)
    bench.run.begin(0.0, state, state)
    still = Plan(np.zeros((11, 6)), np.zeros((10, 2)), np.zeros((10, 2, 6)), 1.0, StopReason.CONVERGED, 1, 0.1)
    expected = 10.0 / 30.0 + bench.run.graph.travel_s(1, math.radians(45.0))
    assert arrival_s(bench.run, opening, still) == pytest.approx(expected)


BLIND = replace(LEAVES.travel, speed_m_s=0.02, fastest_m_s=0.12, blind_rad=0.1, deadline_ms=1e6)
LEAD = 0.08


def bench_that_sees_late(late_s, travel=BLIND):
    bench = Bench()
    options = replace(LEAVES, travel=travel, gate=replace(LEAVES.gate, lead_s=LEAD))
    bench.run.steering = replace(bench.run.steering, options=options, late_s=late_s)
    return bench


def wished(name, late_s, travel=BLIND):
    """Arrival speed at an opening, m/s."""
    return arrival_speed(bench_that_sees_late(late_s, travel).run, MAZE.opening(name))


@pytest.mark.parametrize(("name", "ring"), [("1-2@45", 2), ("2-3@90", 3), ("3-4@45", 4), ("4-5@180", 4)])
@pytest.mark.parametrize("late_s", [0.0, 0.03])
def test_the_ball_turns_by_so_much_in_the_smaller_ring_before_the_plate_answers(name, ring, late_s):
    """Before the disc the ring itself counts."""
    speed = wished(name, late_s)
    assert BLIND.speed_m_s < speed < BLIND.fastest_m_s
    assert speed * (late_s + LEAD) / MAZE.track_radius(ring) == pytest.approx(BLIND.blind_rad)


def test_the_later_the_slower_down_to_a_speed_that_is_always_allowed():
    speeds = [wished("1-2@45", late_s) for late_s in np.arange(0.0, 0.4, 0.005)]
    assert (np.diff(speeds) <= 0.0).all()
    assert np.abs(np.diff(speeds)).max() < 0.006, "without a jump"
    assert speeds[0] > 0.05
    assert speeds[-1] == wished("1-2@45", math.inf) == BLIND.speed_m_s


def test_however_prompt_there_is_a_fastest_arrival():
    assert wished("1-2@45", 0.0, replace(BLIND, blind_rad=5.0)) == BLIND.fastest_m_s


def wishes_of_plans(bench, opening):
    """Speeds along the ring, m/s, that the planner is asked for on both sides of an opening."""
    asked, planner, radius = [], bench.run.steering.planners[opening.outer], MAZE.track_radius(opening.outer)
    whole = planner.plan
    planner.plan = lambda *a, **k: asked.append(k["goal_theta_dot"] * radius) or whole(*a, **k)
    leaf = bench.leaf("PlanInRing", opening=opening.name, plan=Key("plan"))
    for side in (-30.0, 30.0):
        assert bench.tick(leaf, at(opening.outer, math.degrees(opening.angle) + side)) is Status.SUCCESS
    return asked


def test_the_planner_is_asked_for_that_speed():
    asked = wishes_of_plans(bench_that_sees_late(0.03), MAZE.opening("1-2@45"))
    assert asked == pytest.approx([wished("1-2@45", 0.03), -wished("1-2@45", 0.03)])
