"""Arrays, codes and signatures of the compiled iLQG solver."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import types

from mazeplan.core.maths.compiled import INTEGER, MATRIX, REAL, VECTOR
from mazeplan.core.records import Array

LINEARISE = types.void(VECTOR, VECTOR, VECTOR, VECTOR, MATRIX, MATRIX)  # s, u, p, out, A, B
RUNNING = REAL(INTEGER, VECTOR, VECTOR, VECTOR)  # k, s, u, p
RUNNING_DERIVATIVES = types.void(INTEGER, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, MATRIX, MATRIX)
FINAL = REAL(VECTOR, VECTOR)  # s, p
FINAL_DERIVATIVES = types.void(VECTOR, VECTOR, VECTOR, MATRIX)  # s, p, l_x, l_xx
SIGNATURES = (LINEARISE, RUNNING, RUNNING_DERIVATIVES, FINAL, FINAL_DERIVATIVES)  # in the order of `Functions`

GO_ON, CONVERGED, NO_DESCENT, NOT_FINITE = range(4)
# columns of `Workspace.numbers`: cost of the plan; regularisation and the factor that changes it; 1 if the derivatives
# of the cost are those of another plan; expected change of the cost by slope and curvature; largest correction of a
# control; whether M is used; length of the last step
COST, MU, FACTOR, STALE, SLOPE, CURVATURE, LARGEST, SECANT, ALPHA = range(9)
NUMBERS = 9


class Functions(NamedTuple):
    """Addresses of the five compiled functions of one problem."""

    linearise: int
    running: int
    running_derivatives: int
    final: int
    final_derivatives: int


class Workspace(NamedTuple):
    """All arrays of one solver. T steps, n states, 2 controls.

    The tuple is flat because compiled code that reads through nested records takes a quarter longer.

    states (T+1, n), controls (T, 2)                       the plan
    new_states, new_controls                               the candidate on trial
    low, high (2,)                                         control limits
    A (T, n, n), B (T, n, 2)                               derivatives of the dynamics along the plan
    new_a, new_b                                           the same along the candidate
    delta_s (T, n), delta_a (T, n, n)                      states and A of the candidate minus those of the plan
    curvature (T, n, n)                                    M of each step, see `ilqg_core`
    secant_residual (n,)                                   r, see `ilqg_core`
    lx (T+1, n), lu (T, 2)                                 gradient of the cost along the plan
    lxx (T+1, n, n), luu (T, 2, 2)                         Hessian of the cost along the plan
    k (T, 2), K (T, 2, n)                                  correction and feedback
    V, Qx (n,), VV, VA, Qxx (n, n), VB (n, 2), Qux (2, n)  arrays of the backward pass
    numbers                                                cost, regularisation and so on, at the indices above
    """

    states: Array
    controls: Array
    new_states: Array
    new_controls: Array
    low: Array
    high: Array
    A: Array
    B: Array
    new_a: Array
    new_b: Array
    delta_s: Array
    delta_a: Array
    curvature: Array
    secant_residual: Array
    lx: Array
    lu: Array
    lxx: Array
    luu: Array
    k: Array
    K: Array
    V: Array
    VV: Array
    VA: Array
    VB: Array
    Qx: Array
    Qxx: Array
    Qux: Array
    numbers: Array


def make_workspace(horizon: int, n: int, low: Array, high: Array) -> Workspace:
    """Allocate a workspace for a horizon (steps), n states and the control limits low, high (2,)."""
    T, z = horizon, np.zeros
    plan = z((T + 1, n)), z((T, 2)), z((T + 1, n)), z((T, 2)), np.array(low, dtype=float), np.array(high, dtype=float)
    dynamics = z((T, n, n)), z((T, n, 2)), z((T, n, n)), z((T, n, 2))
    secant = z((T, n)), z((T, n, n)), z((T, n, n)), z(n)
    cost = z((T + 1, n)), z((T, 2)), z((T + 1, n, n)), z((T, 2, 2))
    backward = z((T, 2)), z((T, 2, n)), z(n), z((n, n)), z((n, n)), z((n, 2)), z(n), z((n, n)), z((2, n))
    return Workspace(*plan, *dynamics, *secant, *cost, *backward, z(NUMBERS))
