from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from ilqg_problems import LIMIT, LinearProblem, T, gradient, ring_planner
from lqr import riccati

from mazeplan.control.ilqg import IlqgOptions
from mazeplan.control.ring_planner import RingPlanner
from mazeplan.core.errors import SettingsError
from mazeplan.core.records import StopReason
from mazeplan.physics.dynamics.ring_parameters import RingParameters


@pytest.mark.parametrize("seed", range(5))
def test_on_a_linear_quadratic_problem_it_is_the_riccati_solution(seed):
    problem = LinearProblem(seed)
    plan = problem.planner().solve(problem.s0, problem.q)
    weight = (1.0 + 0.1 * np.arange(T))[:, None, None]
    exact = riccati(
        np.tile(problem.A, (T, 1, 1)),
        np.tile(problem.B, (T, 1, 1)),
        weight * problem.Q,
        weight * problem.R,
        problem.Q_final,
    )
    assert plan.reason is StopReason.CONVERGED
    assert plan.cost == pytest.approx(0.5 * problem.s0 @ exact.values[0] @ problem.s0, rel=1e-10)
    np.testing.assert_allclose(plan.gains, exact.gains, rtol=1e-10, atol=1e-10)
    for k in range(T):
        np.testing.assert_allclose(plan.controls[k], exact.gains[k] @ plan.states[k], rtol=1e-8, atol=1e-8)
    assert plan.iterations <= 3


@pytest.mark.parametrize("seed", range(5))
def test_with_limits_no_allowed_change_lowers_the_cost(seed):
    problem = LinearProblem(seed)
    limit = 0.3 * float(np.abs(problem.planner().solve(problem.s0, problem.q).controls).max())
    plan = problem.planner(limit).solve(problem.s0, problem.q)
    assert plan.reason is StopReason.CONVERGED
    assert plan.cost == pytest.approx(problem.cost_of(problem.s0, plan.controls), rel=1e-12)
    assert 0.05 < np.mean(np.abs(plan.controls) == limit) < 1.0
    assert (np.abs(plan.controls) <= limit).all()
    slope = gradient(problem, plan)
    free = np.abs(plan.controls) < limit
    assert np.abs(slope[free]).max() < 1e-4 * np.abs(slope).max()
    assert (slope[plan.controls == limit] < 0.0).all()
    assert (slope[plan.controls == -limit] > 0.0).all()
    assert (plan.gains[~free] == 0.0).all()
    assert (np.abs(plan.gains[free]).max(axis=1) > 0.0).all()


def test_the_cost_never_rises_and_the_plan_is_consistent():
    planner = ring_planner()
    rng = np.random.default_rng(1)
    for _ in range(20):
        s0 = rng.normal(size=6) * [1.0, 1.0, 0.04, 0.3, 0.04, 0.3]
        q = planner.cost.pack(s0[0] + rng.uniform(-3, 3), rng.uniform(-1, 1), -0.02)
        plan = planner._planner.solve(s0, q)
        again = planner._planner.solve(s0, q, plan)
        assert again.cost <= plan.cost
        assert (np.abs(plan.controls) <= LIMIT).all()
        assert (plan.states[0] == s0).all()
        assert plan.states.shape == (41, 6)
        assert plan.gains.shape == (40, 2, 6)


def test_an_eighth_turn_is_near_time_optimal():
    plan = ring_planner().plan(np.zeros(6), math.pi / 4)
    late = plan.states[round(0.75 * 30) :]
    assert np.abs(late[:, 0] - math.pi / 4).max() < 0.02
    assert np.abs(late[:, 1]).max() < 0.1
    assert plan.states[:, 0].max() < math.pi / 4 + 0.005


@pytest.mark.parametrize("turn", [math.pi / 4, -math.pi / 4, 2.0])
@pytest.mark.parametrize("lean", [-0.03, 0.03])
def test_the_plate_leans_as_wished_on_the_way(turn, lean):
    plan = ring_planner().plan(np.zeros(6), turn, lean=lean)
    theta, beta, gamma = plan.states[:, 0], plan.states[:, 2], plan.states[:, 4]
    leans = np.sin(beta) * np.cos(theta) - np.sin(gamma) * np.cos(beta) * np.sin(theta)
    assert np.median(leans) == pytest.approx(lean, abs=0.01)
    assert abs(plan.states[-1, 0] - turn) < 0.02


def test_the_goal_is_passed_at_the_wished_speed():
    for sign in (1.0, -1.0):
        plan = ring_planner().plan(np.zeros(6), sign * 0.8, goal_theta_dot=sign * 0.58)
        k = int(np.argmin(np.abs(plan.states[:30, 0] - sign * 0.8)))
        assert sign * plan.states[k, 1] == pytest.approx(0.58, abs=0.12)
        assert k <= 24


def test_a_warm_start_needs_fewer_iterations():
    planner, rng = ring_planner(), np.random.default_rng(2)
    cold = warm = 0
    for _ in range(10):
        goal = rng.uniform(-2.0, 2.0)
        plan = planner.plan(np.zeros(6), goal, lean=-0.02)
        for k in range(1, 4):
            s = plan.states[1] + rng.normal(size=6) * [0.005, 0.03, 0.001, 0.01, 0.001, 0.01]
            cold += planner.plan(s, goal, lean=-0.02, t0=k / 30).iterations
            plan = planner.plan(s, goal, lean=-0.02, warm=plan, t0=k / 30)
            warm += plan.iterations
            assert plan.t0 == k / 30
    assert warm < 0.5 * cold


def test_a_warm_start_may_be_a_whole_turn_away():
    planner = ring_planner()
    plan = planner.plan(np.array([3.0, 0, 0, 0, 0, 0]), 3.6)
    s = plan.states[5].copy()
    here = planner.plan(s, 3.6, warm=plan, t0=5 / 30)
    s[0] -= 2.0 * math.pi
    there = planner.plan(s, 3.6 - 2.0 * math.pi, warm=plan, t0=5 / 30)
    assert there.iterations == here.iterations
    assert there.cost == pytest.approx(here.cost, rel=1e-9)
    np.testing.assert_allclose(there.controls, here.controls, atol=1e-6)


def test_a_warm_start_may_be_old_and_of_another_length():
    planner = ring_planner()
    short = ring_planner(options=IlqgOptions(horizon=10)).plan(np.zeros(6), 0.3)
    for t0 in (0.0, 0.2, 100.0, -1.0):
        assert planner.plan(np.zeros(6), 0.3, warm=short, t0=t0).reason is StopReason.CONVERGED


# --- settings ---


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"horizon": 0}, "horizon: got 0, expected a number > 0"),
        ({"max_iterations": 2.5}, "max_iterations"),
        ({"tolerance": -1.0}, "tolerance: got -1, expected a number of 0 to"),
        ({"deadline_ms": math.nan}, "deadline_ms"),
    ],
)
def test_bad_options_are_refused(change, message):
    with pytest.raises(SettingsError, match=message):
        replace(IlqgOptions(40), **change)


@pytest.mark.parametrize("limit", [-0.1, math.inf, math.nan])
def test_bad_limits_are_refused(limit):
    with pytest.raises(SettingsError, match="limits"):
        RingPlanner(RingParameters(0.0689), limit, IlqgOptions(40))


def test_warming_up_changes_no_plan():
    warmed, fresh = ring_planner(), ring_planner()
    warmed.warm_up()
    assert np.array_equal(warmed.plan(np.zeros(6), 1.0).controls, fresh.plan(np.zeros(6), 1.0).controls)
