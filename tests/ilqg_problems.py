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


# A linear system and a quadratic cost whose weight grows with k. p: A, B; q: Q, R, Q_final, all flat. In loops: of
# products and assignments of whole arrays, Numba compiles also their errors, which takes ten seconds.
@njit(cache=True)
def linear_step(s, u, p, out):
    n = s.shape[0]
    for i in range(n):
        out[i] = p[n * n + 2 * i] * u[0] + p[n * n + 2 * i + 1] * u[1]
        for j in range(n):
            out[i] += p[n * i + j] * s[j]


@njit(cache=True)
def linear_linearise(s, u, p, out, A, B):
    linear_step(s, u, p, out)
    n = s.shape[0]
    for i in range(n):
        for j in range(n):
            A[i, j] = p[n * i + j]
        for j in range(2):
            B[i, j] = p[n * n + 2 * i + j]


@njit(cache=True)
def growing(k):
    return 1.0 + 0.1 * k


@njit(cache=True)
def bowl(M, at, x):
    """0.5 x' M x of the matrix that begins at M[at]."""
    total, n = 0.0, x.shape[0]
    for i in range(n):
        for j in range(n):
            total += 0.5 * x[i] * M[at + n * i + j] * x[j]
    return total


@njit(cache=True)
def bowl_derivatives(M, at, factor, x, slope, bend):
    """Those of factor * bowl, into slope and bend."""
    n = x.shape[0]
    for i in range(n):
        slope[i] = 0.0
        for j in range(n):
            bend[i, j] = factor * M[at + n * i + j]
            slope[i] += bend[i, j] * x[j]


@njit(cache=True)
def quadratic_running(k, s, u, q):
    n = s.shape[0]
    return growing(k) * (bowl(q, 0, s) + bowl(q, n * n, u))


@njit(cache=True)
def quadratic_running_derivatives(k, s, u, q, lx, lu, lxx, luu):
    n = s.shape[0]
    bowl_derivatives(q, 0, growing(k), s, lx, lxx)
    bowl_derivatives(q, n * n, growing(k), u, lu, luu)


@njit(cache=True)
def quadratic_final(s, q):
    n = s.shape[0]
    return bowl(q, n * n + 4, s)


@njit(cache=True)
def quadratic_final_derivatives(s, q, lx, lxx):
    n = s.shape[0]
    bowl_derivatives(q, n * n + 4, 1.0, s, lx, lxx)


# Bad functions, each for one way in which a solver can fail.
@njit(cache=True)
def cliff_step(s, u, p, out):
    linear_step(s, u, p, out)
    if u[0] > 0.5:
        out[:] = np.inf


@njit(cache=True)
def nan_both(s, u, p, out, A, B):
    out[:] = np.nan


@njit(cache=True)
def cliff_linearise(s, u, p, out, A, B):
    linear_linearise(s, u, p, out, A, B)
    cliff_step(s, u, p, out)


@njit(cache=True)
def nan_linearise(s, u, p, out, A, B):
    linear_step(s, u, p, out)
    A[:] = np.nan
    B[:] = 1.0


@njit(cache=True)
def lying_derivatives(k, s, u, q, lx, lu, lxx, luu):
    quadratic_running_derivatives(k, s, u, q, lx, lu, lxx, luu)
    for i in range(lu.shape[0]):
        lu[i] = -10.0 * lu[i] - 10.0
    for i in range(lx.shape[0]):
        lx[i] = -10.0 * lx[i]


@njit(cache=True)
def concave_derivatives(k, s, u, q, lx, lu, lxx, luu):
    quadratic_running_derivatives(k, s, u, q, lx, lu, lxx, luu)
    luu[0, 0] = luu[1, 1] = -1e12
    luu[0, 1] = luu[1, 0] = 0.0


@njit(cache=True)
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

    def planner(self, limit=1e6, linearise=linear_linearise, cost=QUADRATIC, **keywords) -> Planner:
        p = np.concatenate([self.A.ravel(), self.B.ravel()])
        options = keywords.pop("options", IlqgOptions(horizon=T, tolerance=1e-13))
        low, high = np.full(2, -limit), np.full(2, limit)
        return Planner(Dynamics(linearise, p, N), cost, low, high, options, **keywords)

    def cost_of(self, s, controls) -> float:
        total = 0.0
        for k, u in enumerate(controls):
            total += (1.0 + 0.1 * k) * 0.5 * (s @ self.Q @ s + u @ self.R @ u)
            s = self.A @ s + self.B @ u
        return total + 0.5 * s @ self.Q_final @ s


def ring_planner(**keywords) -> RingPlanner:
    return RingPlanner(RingParameters(0.0689), LIMIT, keywords.pop("options", IlqgOptions(40)), **keywords)


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
