from __future__ import annotations

import numpy as np
import pytest

from mazeplan.maths.lqr import riccati


def random_problem(rng, T=12, n=4, m=2):
    def positive(size, extra):
        factor = rng.normal(size=(T, size, size))
        return factor @ factor.transpose(0, 2, 1) + extra * np.eye(size)

    A = np.eye(n) + 0.2 * rng.normal(size=(T, n, n))
    return A, rng.normal(size=(T, n, m)), positive(n, 0.0), positive(m, 0.1), positive(n, 0.0)[0]


def stacked_optimum(A, B, Q, R, Q_final, x0):
    """The same problem as one dense least-squares problem in all controls: no recursion."""
    T, n, m = B.shape
    free, forced = np.zeros((T + 1, n)), np.zeros((T + 1, n, T * m))
    free[0] = x0
    for k in range(T):
        free[k + 1] = A[k] @ free[k]
        forced[k + 1] = A[k] @ forced[k]
        forced[k + 1, :, k * m : (k + 1) * m] += B[k]
    weights = [*Q, Q_final]
    H = np.sum([f.T @ W @ f for f, W in zip(forced, weights, strict=True)], axis=0)
    for k in range(T):
        H[k * m : (k + 1) * m, k * m : (k + 1) * m] += R[k]
    g = sum(f.T @ W @ x for f, W, x in zip(forced, weights, free, strict=True))
    u = -np.linalg.solve(H, g)
    return u.reshape(T, m), 0.5 * sum(x @ W @ x for x, W in zip(free, weights, strict=True)) + 0.5 * g @ u


def test_it_equals_the_dense_solution():
    rng = np.random.default_rng(1)
    for _ in range(20):
        A, B, Q, R, Q_final = random_problem(rng)
        x0 = rng.normal(size=4)
        solution = riccati(A, B, Q, R, Q_final)
        controls, cost = stacked_optimum(A, B, Q, R, Q_final, x0)
        assert 0.5 * x0 @ solution.values[0] @ x0 == pytest.approx(cost, rel=1e-9)
        x = x0
        for k in range(len(B)):
            u = solution.gains[k] @ x
            assert u == pytest.approx(controls[k], rel=1e-7, abs=1e-8)
            x = A[k] @ x + B[k] @ u


def test_a_known_answer_in_one_dimension():
    one = np.ones((1, 1, 1))
    solution = riccati(one, one, one, one, np.array([[1.0]]))
    assert solution.gains[0, 0, 0] == pytest.approx(-0.5)
    assert solution.values[0, 0, 0] == pytest.approx(1.5)


def test_shapes_that_do_not_fit_are_named():
    A, B, Q, R, Q_final = random_problem(np.random.default_rng(2))
    with pytest.raises(ValueError, match=r"Q: got shape \(3, 4, 4\), expected \(12, 4, 4\)"):
        riccati(A, B, Q[:3], R, Q_final)


def test_an_indefinite_problem_is_refused():
    one = np.ones((1, 1, 1))
    with pytest.raises(np.linalg.LinAlgError):
        riccati(one, one, one, -3.0 * one, np.array([[1.0]]))
