"""Problems with known answers for the solver, and functions that are wrong in one way each."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from mazeplan.control.ilqg import Cost, Dynamics, IlqgOptions, Planner
from mazeplan.control.ring_planner import RingPlanner
from mazeplan.physics.dynamics.ring_parameters import RingParameters

LIMIT = math.radians(5.0)
T, N = 15, 4  # horizon and states of the linear problem


# A linear system and a quadratic cost whose weight grows with k. p: A, B; q: Q, R, Q_final, all flat.
@njit
def linear_step(s, u, p, out):
    n = s.shape[0]
    out[:] = p[: n * n].reshape(n, n) @ s + p[n * n :].reshape(n, 2) @ u


@njit
def linear_linearise(s, u, p, out, A, B):
    linear_step(s, u, p, out)
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
def nan_both(s, u, p, out, A, B):
    out[:] = np.nan


@njit
def cliff_linearise(s, u, p, out, A, B):
    linear_linearise(s, u, p, out, A, B)
    cliff_step(s, u, p, out)


@njit
def nan_linearise(s, u, p, out, A, B):
    linear_step(s, u, p, out)
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


def ring_planner(**keywords) -> RingPlanner:
    return RingPlanner(RingParameters(0.0689), LIMIT, **keywords)


class Ticking:
    """A clock that goes on by the same amount at each look."""

    def __init__(self, ms: float) -> None:
        self.now, self.ms = 0.0, ms

    def __call__(self) -> float:
        self.now += 1e-3 * self.ms
        return self.now


def gradient(problem, plan):
    """Derivatives (T, 2) of the cost by the controls."""
    slope = np.zeros((T, 2))
    for k in range(T):
        for i in range(2):
            for sign in (1.0, -1.0):
                moved = plan.controls.copy()
                moved[k, i] += sign * 1e-5
                slope[k, i] += sign * problem.cost_of(problem.s0, moved) / 2e-5
    return slope
