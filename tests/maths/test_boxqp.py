from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from mazeplan.control.ilqg_core import box_qp


def solve(H, g, low, high):
    x0, x1, free0, free1, ok = box_qp(H[0, 0], H[0, 1], H[1, 1], g[0], g[1], low[0], high[0], low[1], high[1])
    return np.array([x0, x1]), (free0, free1), ok


def random_problem(rng):
    factor = rng.normal(size=(2, 2)) * 10.0 ** rng.uniform(-2, 2, size=2)
    H = factor.T @ factor + 10.0 ** rng.uniform(-3, 0) * np.eye(2)
    g = rng.normal(size=2) * 10.0 ** rng.uniform(-1, 2)
    a, b = rng.normal(size=(2, 2))
    return H, g, np.minimum(a, b), np.maximum(a, b)


def test_the_minimum_satisfies_the_optimality_conditions_on_random_problems():
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(5000):
        H, g, low, high = random_problem(rng)
        x, free, ok = solve(H, g, low, high)
        assert ok
        assert (x >= low).all()
        assert (x <= high).all()
        slope = H @ x + g
        scale = 1e-9 * (np.abs(H).sum() * (1.0 + np.abs(x).max()) + np.abs(g).max())
        for i in range(2):
            if free[i]:
                assert abs(slope[i]) < scale
            else:
                held += 1
                assert (x[i] == low[i] and slope[i] > 0.0) or (x[i] == high[i] and slope[i] < 0.0)
    assert 2000 < held < 9500  # the problems are of every sort


def test_no_point_of_a_grid_is_better():
    rng = np.random.default_rng(2)
    for _ in range(300):
        H, g, low, high = random_problem(rng)
        x, _, _ = solve(H, g, low, high)
        a, b = np.meshgrid(np.linspace(low[0], high[0], 41), np.linspace(low[1], high[1], 41))
        grid = 0.5 * (H[0, 0] * a * a + H[1, 1] * b * b) + H[0, 1] * a * b + g[0] * a + g[1] * b
        best = 0.5 * x @ H @ x + g @ x
        assert best <= grid.min() + 1e-9 * (1.0 + abs(best))


def test_it_equals_bounded_least_squares():
    rng = np.random.default_rng(3)
    for _ in range(100):
        H, g, low, high = random_problem(rng)
        L = np.linalg.cholesky(H)  # 1/2 |L' x + L^-1 g|^2 is the same objective but for a constant
        reference = lsq_linear(L.T, -np.linalg.solve(L, g), bounds=(low, high), method="bvls", tol=1e-14)
        x, _, _ = solve(H, g, low, high)
        ours, theirs = (0.5 * v @ H @ v + g @ v for v in (x, reference.x))
        assert ours <= theirs + 1e-9 * (1.0 + abs(theirs))


@pytest.mark.parametrize("H", [[[0.0, 0.0], [0.0, 1.0]], [[1.0, 2.0], [2.0, 1.0]], [[-1.0, 0.0], [0.0, -1.0]]])
def test_a_hessian_that_is_not_positive_definite_is_told(H):
    x, free, ok = solve(np.array(H), np.ones(2), -np.ones(2), np.ones(2))
    assert not ok
    assert free == (False, False)
    assert (x == 0.0).all()


def test_nan_is_told():
    assert not solve(np.array([[np.nan, 0.0], [0.0, 1.0]]), np.ones(2), -np.ones(2), np.ones(2))[2]


def test_a_gradient_of_nan_gives_no_finite_answer():
    for g in ([np.nan, 0.0], [5.0, np.nan]):
        assert np.isnan(solve(np.eye(2), np.array(g), -np.ones(2), np.ones(2))[0]).all()


def test_a_variable_between_equal_bounds_is_not_free():
    x, free, ok = solve(np.eye(2), np.array([-0.3, 0.4]), np.array([0.3, -1.0]), np.array([0.3, 1.0]))
    assert ok
    assert x == pytest.approx([0.3, -0.4])
    assert free == (False, True)


def test_a_minimum_that_happens_to_lie_on_a_bound_is_free():
    x, free, _ = solve(np.eye(2), np.array([-1.0, 0.0]), -np.ones(2), np.ones(2))
    assert x == pytest.approx([1.0, 0.0])
    assert free == (True, True)
