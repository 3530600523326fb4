"""What a plan says of its own quality, against finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from ilqg_problems import LIMIT, LinearProblem, T, gradient, ring_planner

from mazeplan.control.ilqg import IlqgOptions
from mazeplan.core.records import StopReason


@pytest.mark.slow
@pytest.mark.parametrize("limited", [True, False])
@pytest.mark.parametrize("iterations", [1, 100])
def test_it_is_the_gradient_by_finite_differences(limited, iterations):
    """At an optimum and, after one iteration of a limited problem, away from it."""
    problem = LinearProblem(1)
    free_plan = problem.planner().solve(problem.s0, problem.q)
    limit = 0.3 * float(np.abs(free_plan.controls).max()) if limited else np.inf
    options = IlqgOptions(horizon=T, tolerance=1e-13, max_iterations=iterations)
    planner = problem.planner(limit if limited else 1e6, options=options)
    plan = planner.solve(problem.s0, problem.q)
    slope, held = gradient(problem, plan), np.abs(plan.controls) >= limit
    scale = np.abs(slope).max() if limited else 1.0
    seal = plan.certificate
    assert seal is not None
    assert seal.gradient == pytest.approx(np.abs(slope[~held]).max(initial=0.0), abs=1e-5 * scale)
    wrong = (slope * np.sign(plan.controls))[held].max(initial=0.0)
    assert seal.wrong_sign == pytest.approx(max(wrong, 0.0), abs=1e-5 * scale)
    if limited and iterations == 1:
        assert max(seal.gradient, seal.wrong_sign) > 1e-3 * scale  # it does tell an optimum from what is none
    if iterations == 100:
        assert max(seal.gradient, seal.wrong_sign) < 1e-5 * scale


def test_a_move_along_a_ring_ends_at_an_optimum():
    planner = ring_planner(options=IlqgOptions(tolerance=1e-12, control_tolerance=1e-10))
    plan = planner.plan(np.zeros(6), 0.8)
    seal = plan.certificate
    assert plan.reason is StopReason.CONVERGED
    assert seal is not None
    assert (np.abs(plan.controls) >= LIMIT).any()
    assert seal.gradient < 2e-3  # per rad, of a cost of
    assert plan.cost > 1.0
    assert seal.wrong_sign == 0.0


def test_without_a_finite_cost_there_is_none():
    plan = ring_planner().plan(np.full(6, np.nan), 0.8)
    assert plan.reason is StopReason.NOT_FINITE
    assert plan.certificate is None
