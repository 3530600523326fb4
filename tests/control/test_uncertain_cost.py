"""A plan that pays for what the model does not know, against another way to the variance, and by what it does."""

from __future__ import annotations

import math

import numpy as np
import pytest
from gaussian_processes import nearest_variance
from ilqg_problems import LIMIT
from test_ilqg_learned import WAVY, P, process, seen

from mazeplan.control import uncertain_cost
from mazeplan.control.cost import CostParameters
from mazeplan.control.ring_planner import RingPlanner
from mazeplan.core.records import StopReason
from mazeplan.learning import fast_gp
from mazeplan.learning.fast_gp import D

NOISE2 = WAVY.hyper.noise**2


def states(n, seed=5):
    rng = np.random.default_rng(seed)
    return np.array([math.pi, 3.0, 0.09, 0.6, 0.09, 0.6]) * rng.uniform(-1, 1, (n, 6))


def test_variance_is_that_of_the_nearest_row_alone():
    packed, points = fast_gp.pack(WAVY), states(200)
    got = [fast_gp.variance(packed, 0, s, NOISE2, np.empty(D)) for s in points]
    np.testing.assert_allclose(got, nearest_variance(WAVY, seen(points)), rtol=1e-9)
    assert (np.array(got) >= WAVY.variance(seen(points)) - 1e-9).all(), "never smaller than given all rows"
    assert np.ptp(got) > 0.5 * WAVY.hyper.only.amplitude**2, "some are near a row, some are not"


def test_derivatives_are_those_of_the_cost():
    q = uncertain_cost.pack(CostParameters(uncertainty=0.3), WAVY)
    q[: uncertain_cost.PLAIN] = CostParameters().pack(0.4, 0.5, 0.02)
    u, checked = np.array([0.02, -0.03]), 0
    for s in states(40, 1):
        lx, lu, lxx, luu = np.empty(6), np.empty(2), np.empty((6, 6)), np.empty((2, 2))
        uncertain_cost.running_derivatives(0, s, u, q, lx, lu, lxx, luu)
        plain = lx.copy(), lxx.copy()
        uncertain_cost.plain_derivatives(0, s, u, q, *(np.empty_like(a) for a in (lx, lu, lxx, luu)))
        for i in range(6):
            sides = []
            for sign in (1.0, -1.0):
                moved = s.copy()
                moved[i] += sign * 1e-6
                sides.append(uncertain_cost.running(0, moved, u, q))
            assert lx[i] == pytest.approx((sides[0] - sides[1]) / 2e-6, abs=2e-5)
        checked += bool((np.abs(plain[0]) > 1e-3).any())
        assert (np.linalg.eigvalsh(lxx) > -1e-9).all()
    assert checked > 30


ROUGH = np.array([3.0, 1.0, 1.0, 0.4, 0.4, 0.05, 0.05, 0.05, 0.05])


def sparse():
    """A process that has seen few of the states that a plan might go through."""
    return process(lambda s: 0.3 * np.sin(s[:, 0]), ROUGH, 400, 1.0)


def test_weight_nought_is_the_plain_plan_to_the_last_bit():
    s0 = np.zeros(6)
    plain = RingPlanner(P, LIMIT, process=WAVY).plan(s0, 1.0)
    off = RingPlanner(P, LIMIT, process=WAVY, cost=CostParameters(uncertainty=0.0)).plan(s0, 1.0)
    assert (plain.controls == off.controls).all()
    assert plain.cost == off.cost
    effects = RingPlanner(P, LIMIT, cost=CostParameters(uncertainty=1.0)).plan(s0, 1.0)  # nothing learned, no doubt
    assert effects.cost == RingPlanner(P, LIMIT).plan(s0, 1.0).cost


@pytest.mark.parametrize("weight", [0.1, 1.0])
def test_a_plan_goes_where_more_is_known(weight):
    gp = sparse()

    def doubt(plan):
        return nearest_variance(gp, seen(plan.states[:-1])).sum()

    plain = RingPlanner(P, LIMIT, process=gp).plan(np.zeros(6), 0.8)
    careful = RingPlanner(P, LIMIT, process=gp, cost=CostParameters(uncertainty=weight)).plan(np.zeros(6), 0.8)
    assert careful.reason is StopReason.CONVERGED
    assert doubt(careful) < doubt(plain) - 0.05
    assert careful.cost > plain.cost
    assert np.abs(careful.states[:, 0] - 0.8).min() < 0.05, "and still gets there"
