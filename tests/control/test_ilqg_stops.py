from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ilqg_problems import (
    QUADRATIC,
    LinearProblem,
    T,
    Ticking,
    cliff_linearise,
    concave_derivatives,
    lying_derivatives,
    nan_both,
    nan_hessian,
    nan_linearise,
    ring_planner,
)

from mazeplan.control.ilqg import IlqgOptions, Stopwatch
from mazeplan.core.records import Plan, StopReason

# --- why it stopped ---


@pytest.mark.parametrize("deadline", [0.0, 3.0, 5.5])
def test_a_deadline_ends_the_search_before_it_is_over(deadline):
    planner = ring_planner(watch=Stopwatch(Ticking(1.0)))
    full = ring_planner().plan(np.zeros(6), 1.0)
    plan = planner.plan(np.zeros(6), 1.0, deadline_ms=deadline)
    assert plan.reason is StopReason.DEADLINE
    assert plan.ok
    assert 1 <= plan.iterations < full.iterations
    assert plan.iterations >= deadline - 4.0  # the time is used
    assert plan.ms <= max(deadline, 3.0) + 1.0  # one look at the clock after the last iteration
    assert np.abs(plan.gains).max() > 0.0


def test_the_deadline_may_stand_in_the_options():
    planner = ring_planner(options=IlqgOptions(40, deadline_ms=3.0), watch=Stopwatch(Ticking(1.0)))
    assert planner.plan(np.zeros(6), 1.0).reason is StopReason.DEADLINE
    assert planner.plan(np.zeros(6), 1.0, deadline_ms=1e9).reason is StopReason.CONVERGED


def test_iterations_may_run_out():
    plan = ring_planner(options=IlqgOptions(40, max_iterations=2)).plan(np.zeros(6), 1.0)
    assert plan.reason is StopReason.MAX_ITERATIONS
    assert plan.iterations == 2
    assert plan.ok


def test_a_warm_plan_has_its_own_end():
    planner = ring_planner(options=IlqgOptions(40, warm_iterations=2, warm_tolerance=0.0, control_tolerance=0.0))
    first = planner.plan(np.zeros(6), 1.0)
    assert first.iterations > 2
    again = planner.plan(np.array([0.002, 0.02, 0.0005, 0.0, -0.0005, 0.0]), 1.0, warm=first)
    assert again.iterations == 2
    assert again.reason is StopReason.MAX_ITERATIONS
    assert again.ok
    far = planner.plan(np.array([-0.2, -1.0, 0.05, 0.0, -0.05, 0.0]), 1.0, warm=first)
    assert far.iterations > 2  # such a plan is none to be followed on


@pytest.mark.slow
@pytest.mark.parametrize("derivatives", [lying_derivatives, concave_derivatives])
def test_no_descent_is_told(derivatives):
    problem = LinearProblem(1)
    plan = problem.planner(1.0, cost=QUADRATIC._replace(running_derivatives=derivatives)).solve(problem.s0, problem.q)
    assert plan.reason is StopReason.NO_DESCENT
    assert np.isfinite(plan.states).all()
    assert plan.cost == pytest.approx(problem.cost_of(problem.s0, plan.controls))


@pytest.mark.parametrize(
    "broken",
    [
        {"linearise": nan_both},
        {"linearise": nan_linearise},
        {"cost": QUADRATIC._replace(running_derivatives=nan_hessian)},
    ],
    ids=["step", "linearise", "hessian"],
)
def test_what_is_not_finite_is_a_value_and_no_exception(broken):
    problem = LinearProblem(1)
    plan = problem.planner(1.0, **broken).solve(problem.s0, problem.q)
    assert plan.reason is StopReason.NOT_FINITE
    assert not plan.ok
    assert (plan.controls == 0.0).all()
    assert (plan.gains == 0.0).all()


@pytest.mark.parametrize("state", [np.full(6, np.nan), np.array([0, np.inf, 0, 0, 0, 0])])
def test_a_state_that_is_not_finite_gives_such_a_plan(state):
    planner = ring_planner()
    good = planner.plan(np.zeros(6), 0.5)
    for warm in (None, good):
        assert planner.plan(state, 0.5, warm=warm).reason is StopReason.NOT_FINITE
    assert planner.plan(np.zeros(6), 0.5).cost == good.cost  # nothing is left behind


@pytest.mark.slow
def test_a_step_into_the_void_is_not_taken():
    problem = LinearProblem(3)
    plan = problem.planner(1.0, linearise=cliff_linearise).solve(problem.s0, problem.q)
    assert plan.ok
    assert np.isfinite(plan.states).all()
    assert (plan.controls[:, 0] <= 0.5).all()
    assert plan.cost < problem.cost_of(problem.s0, np.zeros((T, 2)))


def test_a_useless_former_plan_is_dropped():
    planner = ring_planner()
    fresh = planner.plan(np.zeros(6), 0.5)
    bad: Plan = replace(fresh, controls=np.full((40, 2), np.nan))
    assert planner.plan(np.zeros(6), 0.5, warm=bad).cost == fresh.cost
    failed = replace(fresh, reason=StopReason.NOT_FINITE)
    assert planner.plan(np.zeros(6), 0.5, warm=failed).cost == fresh.cost
