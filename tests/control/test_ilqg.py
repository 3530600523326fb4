from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numba import njit
from numba.core.runtime import _nrt_python, rtsys

from mazeplan.control.ilqg import Cost, Dynamics, IlqgOptions, Planner, RingPlanner
from mazeplan.errors import SettingsError
from mazeplan.maths.lqr import riccati
from mazeplan.models.ring_dynamics import RingParameters
from mazeplan.records import Plan, StopReason

LIMIT = math.radians(5.0)
T, N = 15, 4  # horizon and states of the linear problem


# A linear system and a quadratic cost whose weight grows with k. p: A, B; q: Q, R, Q_final, all flat.
@njit
def linear_step(s, u, p, out):
    n = s.shape[0]
    out[:] = p[: n * n].reshape(n, n) @ s + p[n * n :].reshape(n, 2) @ u


@njit
def linear_linearise(s, u, p, A, B):
    n = s.shape[0]
    A[:] = p[: n * n].reshape(n, n)
    B[:] = p[n * n :].reshape(n, 2)


@njit
def growing(k):
    return 1.0 + 0.1 * k


@njit
def quadratic_running(k, s, u, q):
    n = s.shape[0]
    Q, R = q[: n * n].reshape(n, n), q[n * n : n * n + 4].reshape(2, 2)
    return growing(k) * (0.5 * s @ (Q @ s) + 0.5 * u @ (R @ u))


@njit
def quadratic_running_derivatives(k, s, u, q, lx, lu, lxx, luu):
    n = s.shape[0]
    Q, R = q[: n * n].reshape(n, n), q[n * n : n * n + 4].reshape(2, 2)
    lxx[:] = growing(k) * Q
    luu[:] = growing(k) * R
    lx[:] = lxx @ s
    lu[:] = luu @ u


@njit
def quadratic_final(s, q):
    n = s.shape[0]
    return 0.5 * s @ (q[n * n + 4 :].reshape(n, n) @ s)


@njit
def quadratic_final_derivatives(s, q, lx, lxx):
    n = s.shape[0]
    lxx[:] = q[n * n + 4 :].reshape(n, n)
    lx[:] = lxx @ s


# Bad functions, each for one way in which a solver can fail.
@njit
def nan_step(s, u, p, out):
    out[:] = np.nan


@njit
def cliff_step(s, u, p, out):
    linear_step(s, u, p, out)
    if u[0] > 0.5:
        out[:] = np.inf


@njit
def nan_linearise(s, u, p, A, B):
    A[:] = np.nan
    B[:] = 1.0


@njit
def lying_derivatives(k, s, u, q, lx, lu, lxx, luu):
    quadratic_running_derivatives(k, s, u, q, lx, lu, lxx, luu)
    lu[:] = -10.0 * lu - 10.0
    lx[:] = -10.0 * lx


@njit
def concave_derivatives(k, s, u, q, lx, lu, lxx, luu):
    quadratic_running_derivatives(k, s, u, q, lx, lu, lxx, luu)
    luu[:] = -1e12 * np.eye(2)


@njit
def nan_hessian(k, s, u, q, lx, lu, lxx, luu):
    quadratic_running_derivatives(k, s, u, q, lx, lu, lxx, luu)
    luu[0, 0] = np.nan


QUADRATIC = Cost(quadratic_running, quadratic_running_derivatives, quadratic_final, quadratic_final_derivatives)


class LinearProblem:
    """A random linear-quadratic problem."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.A = np.eye(N) + 0.15 * rng.normal(size=(N, N))
        self.B = rng.normal(size=(N, 2))
        factor = rng.normal(size=(N, N))
        self.Q, self.R, self.Q_final = factor @ factor.T, np.array([[1.0, 0.3], [0.3, 2.0]]), 5.0 * np.eye(N)
        self.s0 = rng.normal(size=N)

    @property
    def q(self):
        return np.concatenate([self.Q.ravel(), self.R.ravel(), self.Q_final.ravel()])

    def planner(self, limit=1e6, step=linear_step, linearise=linear_linearise, cost=QUADRATIC, **keywords) -> Planner:
        p = np.concatenate([self.A.ravel(), self.B.ravel()])
        options = keywords.pop("options", IlqgOptions(horizon=T, tolerance=1e-13))
        low, high = np.full(2, -limit), np.full(2, limit)
        return Planner(Dynamics(step, linearise, p, N), cost, low, high, options, **keywords)

    def cost_of(self, s, controls) -> float:
        total = 0.0
        for k, u in enumerate(controls):
            total += (1.0 + 0.1 * k) * 0.5 * (s @ self.Q @ s + u @ self.R @ u)
            s = self.A @ s + self.B @ u
        return total + 0.5 * s @ self.Q_final @ s


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
    slope = np.zeros((T, 2))
    for k in range(T):
        for i in range(2):
            for sign in (1.0, -1.0):
                moved = plan.controls.copy()
                moved[k, i] += sign * 1e-5
                slope[k, i] += sign * problem.cost_of(problem.s0, moved) / 2e-5
    free = np.abs(plan.controls) < limit
    assert np.abs(slope[free]).max() < 1e-4 * np.abs(slope).max()
    assert (slope[plan.controls == limit] < 0.0).all()
    assert (slope[plan.controls == -limit] > 0.0).all()
    assert (plan.gains[~free] == 0.0).all()
    assert (np.abs(plan.gains[free]).max(axis=1) > 0.0).all()


def ring_planner(**keywords) -> RingPlanner:
    return RingPlanner(RingParameters(0.0689), LIMIT, **keywords)


def test_the_cost_never_rises_and_the_plan_is_consistent():
    planner = ring_planner()
    rng = np.random.default_rng(1)
    for _ in range(20):
        s0 = rng.normal(size=6) * [1.0, 1.0, 0.04, 0.3, 0.04, 0.3]
        costs: list[float] = []
        q = planner.cost.pack(s0[0] + rng.uniform(-3, 3), rng.uniform(-1, 1), -0.02)
        plan = planner._planner.solve(s0, q, trace=lambda k, cost, costs=costs: costs.append(cost))
        assert len(costs) >= 2
        assert (np.diff(costs) <= 0.0).all()
        assert costs[-1] == plan.cost
        assert (np.abs(plan.controls) <= LIMIT).all()
        assert (plan.states[0] == s0).all()
        assert plan.states.shape == (41, 6)
        assert plan.gains.shape == (40, 2, 6)


def test_an_eighth_of_a_turn_is_near_time_optimal_without_overshoot():
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


def test_a_warm_start_follows_the_shifted_plan_with_its_gains():
    planner = ring_planner(options=IlqgOptions(max_iterations=1))
    old = ring_planner().plan(np.zeros(6), 1.0)
    s = old.states[3] + np.array([0.01, -0.05, 0.0, 0.0, 0.0, 0.0])
    first: list[float] = []
    q = planner.cost.pack(1.0)
    planner._planner.solve(s, q, old, t0=0.1, trace=lambda k, cost: first.append(cost))
    planner._planner.solve(s, q, replace(old, gains=0.0 * old.gains), t0=0.1, trace=lambda k, cost: first.append(cost))
    planner._planner.solve(s, q, old, t0=0.0, trace=lambda k, cost: first.append(cost))
    with_gains, _, without, _, unshifted, _ = first
    assert with_gains < without < unshifted


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


def test_a_warm_start_may_be_older_than_its_horizon_and_of_another_length():
    planner = ring_planner()
    short = ring_planner(options=IlqgOptions(horizon=10)).plan(np.zeros(6), 0.3)
    for t0 in (0.0, 0.2, 100.0, -1.0):
        assert planner.plan(np.zeros(6), 0.3, warm=short, t0=t0).reason is StopReason.CONVERGED


def test_controls_may_be_the_first_guess():
    planner = ring_planner()
    plan = planner.plan(np.zeros(6), 0.5)
    again = planner._planner.solve(np.zeros(6), planner.cost.pack(0.5), plan.controls)
    assert again.iterations <= 2
    assert again.cost <= plan.cost


def test_plans_do_not_share_memory():
    planner = ring_planner()
    first = planner.plan(np.zeros(6), 0.5)
    kept = first.states.copy(), first.controls.copy(), first.gains.copy()
    planner.plan(np.zeros(6), -0.5)
    for a, b in zip(kept, (first.states, first.controls, first.gains), strict=True):
        assert (a == b).all()


# --- why it stopped ---


class Ticking:
    """A clock that goes on by the same amount at each look."""

    def __init__(self, ms: float) -> None:
        self.now, self.ms = 0.0, ms

    def __call__(self) -> float:
        self.now += 1e-3 * self.ms
        return self.now


@pytest.mark.parametrize("deadline", [0.0, 4.0, 8.5])
def test_a_deadline_ends_the_search_before_it_is_over(deadline):
    planner = ring_planner(clock=Ticking(1.0))
    full = ring_planner().plan(np.zeros(6), 1.0)
    plan = planner.plan(np.zeros(6), 1.0, deadline_ms=deadline)
    assert plan.reason is StopReason.DEADLINE
    assert plan.ok
    assert 1 <= plan.iterations < full.iterations
    assert plan.iterations >= deadline - 4.0  # the time is used
    assert plan.ms <= max(deadline, 3.0) + 1.0  # one look at the clock after the last iteration
    assert np.abs(plan.gains).max() > 0.0


def test_the_deadline_may_stand_in_the_options():
    planner = ring_planner(options=IlqgOptions(deadline_ms=3.0), clock=Ticking(1.0))
    assert planner.plan(np.zeros(6), 1.0).reason is StopReason.DEADLINE
    assert planner.plan(np.zeros(6), 1.0, deadline_ms=1e9).reason is StopReason.CONVERGED


def test_iterations_may_run_out():
    plan = ring_planner(options=IlqgOptions(max_iterations=2)).plan(np.zeros(6), 1.0)
    assert plan.reason is StopReason.MAX_ITERATIONS
    assert plan.iterations == 2
    assert plan.ok


def test_the_gains_belong_to_the_trajectory_that_is_returned():
    early = ring_planner(options=IlqgOptions(max_iterations=4)).plan(np.zeros(6), 1.0)
    content = ring_planner(options=IlqgOptions(tolerance=1e9))  # stops after its first backward pass
    there = content._planner.solve(np.zeros(6), content.cost.pack(1.0), early.controls)
    assert (there.controls == early.controls).all()
    np.testing.assert_allclose(early.gains, there.gains, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("derivatives", [lying_derivatives, concave_derivatives])
def test_no_descent_is_told(derivatives):
    problem = LinearProblem(1)
    plan = problem.planner(1.0, cost=replace(QUADRATIC, running_derivatives=derivatives)).solve(problem.s0, problem.q)
    assert plan.reason is StopReason.NO_DESCENT
    assert np.isfinite(plan.states).all()
    assert plan.cost == pytest.approx(problem.cost_of(problem.s0, plan.controls))


@pytest.mark.parametrize(
    "broken",
    [
        {"step": nan_step},
        {"linearise": nan_linearise},
        {"cost": replace(QUADRATIC, running_derivatives=nan_hessian)},
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


def test_a_step_into_the_void_is_not_taken():
    problem = LinearProblem(3)
    plan = problem.planner(1.0, step=cliff_step).solve(problem.s0, problem.q)
    assert plan.ok
    assert np.isfinite(plan.states).all()
    assert (plan.controls[:, 0] <= 0.5).all()
    assert plan.cost < problem.cost_of(problem.s0, np.zeros((T, 2)))


def test_a_useless_former_plan_is_dropped():
    planner = ring_planner()
    fresh = planner.plan(np.zeros(6), 0.5)
    bad: Plan = replace(fresh, controls=np.full((40, 2), np.nan))
    assert planner.plan(np.zeros(6), 0.5, warm=bad).cost == pytest.approx(fresh.cost)
    failed = replace(fresh, reason=StopReason.NOT_FINITE)
    assert planner.plan(np.zeros(6), 0.5, warm=failed).cost == fresh.cost


# --- settings ---


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"horizon": 0}, "horizon: got 0, expected a whole number >= 1"),
        ({"max_iterations": 2.5}, "max_iterations"),
        ({"tolerance": -1.0}, "tolerance: got -1.0, expected a number >= 0"),
        ({"deadline_ms": math.nan}, "deadline_ms"),
        ({"mu_factor": 1.0}, "mu_factor"),
        ({"alphas": ()}, "alphas"),
        ({"alphas": (1.0, 0.0)}, "alphas"),
    ],
)
def test_bad_options_are_refused(change, message):
    with pytest.raises(SettingsError, match=message):
        IlqgOptions(**change)


@pytest.mark.parametrize("limit", [-0.1, math.inf, math.nan])
def test_bad_limits_are_refused(limit):
    with pytest.raises(SettingsError, match="limits"):
        RingPlanner(RingParameters(0.0689), limit)


def test_a_function_that_is_not_compiled_is_refused():
    with pytest.raises(TypeError, match=r"numba\.njit"):
        LinearProblem(1).planner(step=lambda s, u, p, out: None)


def test_warm_up_makes_a_plan():
    ring_planner().warm_up()


def test_nothing_is_allocated_inside():
    """Handing the workspace over costs some allocations a call; what is inside must add none, however long it works."""
    allocated = []
    _nrt_python.memsys_enable_stats()
    try:
        for horizon in (10, 40):
            planner = ring_planner(options=IlqgOptions(horizon=horizon, max_iterations=3))
            planner.warm_up()
            before = rtsys.get_allocation_stats().alloc
            assert planner.plan(np.zeros(6), 1.0).iterations == 3
            allocated.append(rtsys.get_allocation_stats().alloc - before)
    finally:
        _nrt_python.memsys_disable_stats()
    assert allocated[0] == allocated[1] > 0
