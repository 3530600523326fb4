"""The compiled inside of the iLQG planner: roll out, linearise, backward pass inside the control limits, line search.

Everything works in place on one `Workspace`, so that an iteration allocates nothing, and calls dynamics and cost
through their addresses (`mazeplan.maths.compiled`), so that one cached compilation serves every model. The method
is control-limited DDP with Gauss-Newton dynamics: Tassa, Mansard, Todorov, "Control-limited differential dynamic
programming", ICRA 2014.

Compiled functions cannot raise for numbers: what happened is returned as one of the codes below.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit, types

from mazeplan.maths.boxqp import box_qp
from mazeplan.maths.compiled import INTEGER, MATRIX, REAL, VECTOR, caller
from mazeplan.records import Array

STEP = types.void(VECTOR, VECTOR, VECTOR, VECTOR)  # s, u, p, out
LINEARISE = types.void(VECTOR, VECTOR, VECTOR, MATRIX, MATRIX)  # s, u, p, A, B
RUNNING = REAL(INTEGER, VECTOR, VECTOR, VECTOR)  # k, s, u, p
RUNNING_DERIVATIVES = types.void(INTEGER, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, MATRIX, MATRIX)
FINAL = REAL(VECTOR, VECTOR)  # s, p
FINAL_DERIVATIVES = types.void(VECTOR, VECTOR, VECTOR, MATRIX)  # s, p, l_x, l_xx

_step, _linearise = caller(STEP), caller(LINEARISE)
_running, _running_derivatives = caller(RUNNING), caller(RUNNING_DERIVATIVES)
_final, _final_derivatives = caller(FINAL), caller(FINAL_DERIVATIVES)

GO_ON, CONVERGED, NO_DESCENT, NOT_FINITE = range(4)
COST, MU, FACTOR, STALE, SLOPE, CURVATURE, LARGEST, EXPECTED, GOT, FREE, WRONG = range(11)
NUMBERS = 11


class Functions(NamedTuple):
    """Addresses of the six compiled functions of one problem."""

    step: int
    linearise: int
    running: int
    running_derivatives: int
    final: int
    final_derivatives: int


class Rules(NamedTuple):
    """What an iteration needs of the options; see `IlqgOptions`."""

    tolerance: float
    control_tolerance: float
    min_ratio: float
    mu_min: float
    mu_max: float
    mu_factor: float
    alphas: Array


class Workspace(NamedTuple):
    """All arrays of one solver. T steps, n states, 2 controls.

    states (T+1, n), controls (T, 2): the trajectory; new_states, new_controls: a candidate; low, high (2,): limits;
    A (T, n, n), B (T, n, 2), lx (T+1, n), lu (T, 2), lxx (T+1, n, n), luu (T, 2, 2): derivatives along the trajectory;
    k (T, 2), K (T, 2, n): correction and feedback; V, Qx (n,), VV, VA, Qxx (n, n), VB (n, 2), Qux (2, n): of the
    backward pass; numbers: cost, regularisation and so on, at the indices above.
    """

    states: Array
    controls: Array
    new_states: Array
    new_controls: Array
    low: Array
    high: Array
    A: Array
    B: Array
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
    """Allocate for a horizon (steps), n states and the control limits (2,) each."""
    T, z = horizon, np.zeros
    return Workspace(
        states=z((T + 1, n)),
        controls=z((T, 2)),
        new_states=z((T + 1, n)),
        new_controls=z((T, 2)),
        low=np.array(low, dtype=float),
        high=np.array(high, dtype=float),
        A=z((T, n, n)),
        B=z((T, n, 2)),
        lx=z((T + 1, n)),
        lu=z((T, 2)),
        lxx=z((T + 1, n, n)),
        luu=z((T, 2, 2)),
        k=z((T, 2)),
        K=z((T, 2, n)),
        V=z(n),
        VV=z((n, n)),
        VA=z((n, n)),
        VB=z((n, 2)),
        Qx=z(n),
        Qxx=z((n, n)),
        Qux=z((2, n)),
        numbers=z(NUMBERS),
    )


@njit(cache=True, error_model="numpy")
def roll_out(w, f, p, q, reference, alpha):
    """Cost of the candidate that the policy gives from states[0]; inf when it is not finite.

    u = clip(controls + alpha k + K (s - reference)); p and q are the vectors of dynamics and cost.
    """
    T, n = w.K.shape[0], w.K.shape[2]
    total = 0.0
    w.new_states[0] = w.states[0]
    for t in range(T):
        s, u = w.new_states[t], w.new_controls[t]
        for i in range(2):
            v = w.controls[t, i] + alpha * w.k[t, i]
            for j in range(n):
                v += w.K[t, i, j] * (s[j] - reference[t, j])
            u[i] = min(max(v, w.low[i]), w.high[i])
        total += _running(f.running, (t, s, u, q))
        _step(f.step, (s, u, p, w.new_states[t + 1]))
        if not math.isfinite(total):
            return math.inf
    total += _final(f.final, (w.new_states[T], q))
    return total if math.isfinite(total) else math.inf


@njit(cache=True, error_model="numpy")
def begin(w, f, p, q, reference, mu):
    """First roll-out, with the feedback K around the reference states (T+1, n); sets cost and regularisation."""
    w.k[:] = 0.0
    cost = roll_out(w, f, p, q, reference, 0.0)
    w.states[:] = w.new_states
    w.controls[:] = w.new_controls
    w.numbers[COST], w.numbers[MU], w.numbers[FACTOR], w.numbers[STALE] = cost, mu, 1.0, 1.0
    w.numbers[EXPECTED] = w.numbers[GOT] = 0.0
    return GO_ON if math.isfinite(cost) else NOT_FINITE


@njit(cache=True, error_model="numpy")
def derivatives(w, f, p, q):
    """Derivatives of dynamics and cost along the trajectory."""
    T = w.controls.shape[0]
    for t in range(T):
        _linearise(f.linearise, (w.states[t], w.controls[t], p, w.A[t], w.B[t]))
        _running_derivatives(
            f.running_derivatives, (t, w.states[t], w.controls[t], q, w.lx[t], w.lu[t], w.lxx[t], w.luu[t])
        )
    _final_derivatives(f.final_derivatives, (w.states[T], q, w.lx[T], w.lxx[T]))


@njit(cache=True, error_model="numpy")
def _expand(w, t):
    """Qx, Qxx, Qux of the step into the workspace; Qu and Quu returned as (g0, g1, h00, h01, h11)."""
    n = w.V.shape[0]
    A, B = w.A[t], w.B[t]
    for i in range(n):
        for j in range(n):
            w.VA[i, j] = 0.0
        w.VB[i, 0] = w.VB[i, 1] = 0.0
        for m in range(n):
            v = w.VV[i, m]
            for j in range(n):
                w.VA[i, j] += v * A[m, j]
            w.VB[i, 0] += v * B[m, 0]
            w.VB[i, 1] += v * B[m, 1]
    g0, g1 = w.lu[t, 0], w.lu[t, 1]
    h00, h01, h11 = w.luu[t, 0, 0], w.luu[t, 0, 1], w.luu[t, 1, 1]
    for i in range(n):
        w.Qx[i] = w.lx[t, i]
        w.Qux[0, i] = w.Qux[1, i] = 0.0
        for j in range(n):
            w.Qxx[i, j] = w.lxx[t, i, j]
        g0 += B[i, 0] * w.V[i]
        g1 += B[i, 1] * w.V[i]
        h00 += B[i, 0] * w.VB[i, 0]
        h01 += B[i, 0] * w.VB[i, 1]
        h11 += B[i, 1] * w.VB[i, 1]
    for m in range(n):
        for i in range(n):
            a = A[m, i]
            w.Qx[i] += a * w.V[m]
            for j in range(n):
                w.Qxx[i, j] += a * w.VA[m, j]
            w.Qux[0, i] += B[m, 0] * w.VA[m, i]
            w.Qux[1, i] += B[m, 1] * w.VA[m, i]
    return g0, g1, h00, h01, h11


@njit(cache=True, error_model="numpy")
def _feedback(w, t, h00, h01, h11, free0, free1):
    """K of the step: -Quu^-1 Qux on the free rows, zero on the held ones."""
    for j in range(w.V.shape[0]):
        a, b = w.Qux[0, j], w.Qux[1, j]
        if free0 and free1:
            det = h00 * h11 - h01 * h01
            w.K[t, 0, j], w.K[t, 1, j] = (h01 * b - h11 * a) / det, (h01 * a - h00 * b) / det
        else:
            w.K[t, 0, j] = -a / h00 if free0 else 0.0
            w.K[t, 1, j] = -b / h11 if free1 else 0.0


@njit(cache=True, error_model="numpy")
def _value(w, t, g0, g1, h00, h01, h11):
    """V and VV before the step, from the policy of the step."""
    n = w.V.shape[0]
    k0, k1 = w.k[t, 0], w.k[t, 1]
    r0, r1 = g0 + h00 * k0 + h01 * k1, g1 + h01 * k0 + h11 * k1
    for i in range(n):
        K0, K1 = w.K[t, 0, i], w.K[t, 1, i]
        w.V[i] = w.Qx[i] + K0 * r0 + K1 * r1 + w.Qux[0, i] * k0 + w.Qux[1, i] * k1
        m0, m1 = w.Qux[0, i] + h00 * K0 + h01 * K1, w.Qux[1, i] + h01 * K0 + h11 * K1
        for j in range(n):
            w.VV[i, j] = w.Qxx[i, j] + m0 * w.K[t, 0, j] + m1 * w.K[t, 1, j] + K0 * w.Qux[0, j] + K1 * w.Qux[1, j]
    for i in range(n):
        for j in range(i):
            w.VV[i, j] = w.VV[j, i] = 0.5 * (w.VV[i, j] + w.VV[j, i])


@njit(cache=True, error_model="numpy")
def backward(w, mu):
    """k and K along the trajectory with mu added to Quu's diagonal. Returns (code, slope, curvature, largest).

    code: GO_ON, NO_DESCENT when Quu is not positive definite, or NOT_FINITE. Moving by alpha is expected to change
    the cost by alpha slope + alpha^2 curvature; largest is the largest full correction of a control, 0 at the
    optimum (a control held at its limit is not corrected).
    """
    T, n = w.controls.shape[0], w.V.shape[0]
    for i in range(n):
        w.V[i] = w.lx[T, i]
        for j in range(n):
            w.VV[i, j] = w.lxx[T, i, j]
    slope = curvature = largest = 0.0
    for t in range(T - 1, -1, -1):
        g0, g1, h00, h01, h11 = _expand(w, t)
        a, b = w.controls[t, 0], w.controls[t, 1]
        k0, k1, free0, free1, ok = box_qp(
            h00 + mu, h01, h11 + mu, g0, g1, w.low[0] - a, w.high[0] - a, w.low[1] - b, w.high[1] - b
        )
        if not ok:
            code = NO_DESCENT if math.isfinite(h00 + h01 + h11) else NOT_FINITE
            return code, slope, curvature, largest
        w.k[t, 0], w.k[t, 1] = k0, k1
        _feedback(w, t, h00 + mu, h01, h11 + mu, free0, free1)
        slope += k0 * g0 + k1 * g1
        curvature += 0.5 * (h00 * k0 * k0 + h11 * k1 * k1) + h01 * k0 * k1
        largest = max(largest, abs(k0), abs(k1))
        _value(w, t, g0, g1, h00, h01, h11)
    return GO_ON if math.isfinite(slope + curvature) else NOT_FINITE, slope, curvature, largest


@njit(cache=True, error_model="numpy")
def _harder(w, rules):
    """Raise the regularisation; False when it has reached its end."""
    w.numbers[FACTOR] = max(rules.mu_factor, w.numbers[FACTOR] * rules.mu_factor)
    w.numbers[MU] = max(rules.mu_min, w.numbers[MU] * w.numbers[FACTOR])
    return w.numbers[MU] <= rules.mu_max


@njit(cache=True, error_model="numpy")
def _softer(w, rules):
    """Lower the regularisation, to zero once below its least value."""
    w.numbers[FACTOR] = min(1.0 / rules.mu_factor, w.numbers[FACTOR] / rules.mu_factor)
    mu = w.numbers[MU] * w.numbers[FACTOR]
    w.numbers[MU] = mu if mu >= rules.mu_min else 0.0


@njit(cache=True, error_model="numpy")
def policy(w, f, p, q, rules):
    """Policy for the trajectory as it stands; raises the regularisation until it exists. Returns a code."""
    if w.numbers[STALE] > 0.0:
        derivatives(w, f, p, q)
        w.numbers[STALE] = 0.0
    code, slope, curvature, largest = backward(w, w.numbers[MU])
    while code == NO_DESCENT and _harder(w, rules):
        code, slope, curvature, largest = backward(w, w.numbers[MU])
    w.numbers[SLOPE], w.numbers[CURVATURE], w.numbers[LARGEST] = slope, curvature, largest
    return code


@njit(cache=True, error_model="numpy")
def iterate(w, f, p, q, rules):
    """One iteration: policy, then a line search; only a lower cost replaces the trajectory. Returns a code."""
    code = policy(w, f, p, q, rules)
    if code != GO_ON:
        return code
    n = w.numbers
    slope, curvature = n[SLOPE], n[CURVATURE]
    small = rules.tolerance * (1.0 + abs(n[COST]))
    if n[MU] <= rules.mu_min and (n[LARGEST] < rules.control_tolerance or -(slope + curvature) < small):
        return CONVERGED
    for alpha in rules.alphas:
        cost = roll_out(w, f, p, q, w.states, alpha)
        expected = -alpha * (slope + alpha * curvature)
        reduction = n[COST] - cost
        if reduction > rules.min_ratio * expected and reduction > 0.0:
            w.states[:] = w.new_states
            w.controls[:] = w.new_controls
            n[COST], n[STALE] = cost, 1.0
            n[EXPECTED], n[GOT] = expected, reduction
            _softer(w, rules)
            return CONVERGED if reduction < small and n[MU] <= rules.mu_min else GO_ON
    return GO_ON if _harder(w, rules) else NO_DESCENT


@njit(cache=True, error_model="numpy")
def certify(w):
    """First-order conditions of the trajectory, by the adjoint, from the derivatives as they stand.

    Into numbers[FREE] the largest gradient of the cost by a control that is free, into numbers[WRONG] that by one held
    at a limit though the cost falls inwards."""
    T, n = w.controls.shape[0], w.V.shape[0]
    free = wrong = 0.0
    w.V[:] = w.lx[T]
    for t in range(T - 1, -1, -1):
        for i in range(2):
            slope = w.lu[t, i]
            for j in range(n):
                slope += w.B[t, j, i] * w.V[j]
            inwards = 0.0
            if w.controls[t, i] <= w.low[i]:
                inwards = -slope
            elif w.controls[t, i] >= w.high[i]:
                inwards = slope
            else:
                free = max(free, abs(slope))
            wrong = max(wrong, inwards)
        for j in range(n):
            w.Qx[j] = w.lx[t, j]
            for m in range(n):
                w.Qx[j] += w.A[t, m, j] * w.V[m]
        w.V[:] = w.Qx
    w.numbers[FREE], w.numbers[WRONG] = free, wrong
