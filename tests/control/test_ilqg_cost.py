from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from finite_differences import jacobian

from mazeplan.control.cost import (
    CostParameters,
    final,
    final_derivatives,
    lean_of,
    penalty,
    running,
    running_derivatives,
)
from mazeplan.core.errors import SettingsError

ALL = CostParameters(rate=0.01, final_lean=2.0, lean=3.0, arrival_zone=0.3)
WISHES = [(0.4, 0.0, 0.0), (0.4, 1.3, -0.03), (0.4, -1.3, 0.02)]


def points(rng, count=60):
    for _ in range(count):
        yield rng.uniform(-1, 1, 6) * [1.5, 4.0, 0.09, 1.0, 0.09, 1.0], rng.uniform(-0.09, 0.09, 2)


def derivatives_of_running(s, u, q):
    lx, lu, lxx, luu = np.full(6, np.nan), np.full(2, np.nan), np.full((6, 6), np.nan), np.full((2, 2), np.nan)
    running_derivatives(0, s, u, q, lx, lu, lxx, luu)
    return lx, lu, lxx, luu


@pytest.mark.parametrize("wishes", WISHES)
@pytest.mark.parametrize("parameters", [ALL, CostParameters()], ids=["all", "default"])
def test_gradients_equal_finite_differences(parameters, wishes):
    q = parameters.pack(*wishes)
    for s, u in points(np.random.default_rng(1)):
        lx, lu, _, luu = derivatives_of_running(s, u, q)
        np.testing.assert_allclose(lx, jacobian(lambda x, u=u: running(0, x, u, q), s), rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(lu, jacobian(lambda x, s=s: running(0, s, x, q), u, 1e-4), rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(
            luu, jacobian(lambda x, s=s: derivatives_of_running(s, x, q)[1], u, 1e-4), rtol=1e-6, atol=1e-8
        )
        fx, fxx = np.full(6, np.nan), np.full((6, 6), np.nan)
        final_derivatives(s, q, fx, fxx)
        np.testing.assert_allclose(fx, jacobian(lambda x: final(x, q), s), rtol=1e-6, atol=1e-8)


def test_hessians_are_exact_where_nothing_was_dropped():
    q = replace(ALL, lean=0.0, final_lean=0.0, arrival=0.0).pack(*WISHES[1])
    for s, u in points(np.random.default_rng(2)):
        lxx = derivatives_of_running(s, u, q)[2]
        exact = jacobian(lambda x, u=u: derivatives_of_running(x, u, q)[0], s)
        np.testing.assert_allclose(lxx, exact, rtol=1e-6, atol=1e-7)


def test_the_lean_hessian_is_gauss_newton():
    """With the lean frozen to its tangent plane the Hessian of the cost is the Gauss-Newton one."""
    parameters = CostParameters(theta=0.0, speed=0.0, arrival=0.0, lean=2.0, final_theta=0.0, final_speed=0.0)
    q = parameters.pack(0.0, 0.0, -0.03)
    for s, u in points(np.random.default_rng(3)):
        lean = lean_of(s[0], s[2], s[4])
        slope = jacobian(lambda x: lean_of(x[0], x[2], x[4]), s)
        curvature = penalty(lean + 0.03, parameters.width_lean)[2]
        lxx = derivatives_of_running(s, u, q)[2]
        np.testing.assert_allclose(lxx, 2.0 * curvature * np.outer(slope, slope), rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("wishes", WISHES)
def test_hessians_are_positive_semidefinite_and_symmetric(wishes):
    q = ALL.pack(*wishes)
    for s, u in points(np.random.default_rng(4)):
        _, _, lxx, luu = derivatives_of_running(s, u, q)
        fx, fxx = np.empty(6), np.empty((6, 6))
        final_derivatives(s, q, fx, fxx)
        for H in (lxx, fxx):
            assert (H == H.T).all()
            assert np.linalg.eigvalsh(H).min() > -1e-10
        assert np.linalg.eigvalsh(luu).min() > 0.0


def test_passing_at_speed_forgives_the_angle_behind_the_goal():
    parameters = CostParameters(speed=0.0, arrival=0.0, lean=0.0, past=0.1)
    before, behind = np.array([0.2, 0, 0, 0, 0, 0]), np.array([0.6, 0, 0, 0, 0, 0])
    stop, forwards = parameters.pack(0.4), parameters.pack(0.4, 1.0)
    u = np.zeros(2)
    assert running(0, before, u, stop) == pytest.approx(running(0, behind, u, stop))
    assert running(0, before, u, forwards) == pytest.approx(running(0, before, u, stop))
    assert running(0, behind, u, forwards) == pytest.approx(0.1 * running(0, behind, u, stop))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"theta": -1.0}, "theta: got -1"),
        ({"lean": float("nan")}, "lean"),
        ({"width_theta": 0.0}, "width_theta: got 0"),
        ({"control": 0.0}, "control"),
    ],
)
def test_bad_weights_are_refused(change, message):
    with pytest.raises(SettingsError, match=message):
        CostParameters(**change)


def test_the_price_of_speed_grows_with_the_delay():
    cost = CostParameters(speed=0.2, prompt=0.6, late_s=0.05, lean=0.7)
    prices = [cost.seen_late(late).speed for late in (0.0, 0.025, 0.05, 0.1, math.inf)]
    assert prices == pytest.approx([0.12, 0.16, 0.2, 0.2, 0.2])
    assert replace(cost.seen_late(0.0), speed=0.2) == cost
    cost = replace(cost, prompt_s=0.03)
    assert [cost.seen_late(late).speed for late in (0.0, 0.03, 0.04, 0.05)] == pytest.approx([0.12, 0.12, 0.16, 0.2])
    cost = replace(cost, prompt_s=0.07)  # no delay between
    assert [cost.seen_late(late).speed for late in (0.0, 0.049, 0.051)] == pytest.approx([0.12, 0.12, 0.2])
    assert CostParameters().seen_late(0.0) == CostParameters(), "alike everywhere unless the settings say otherwise"
