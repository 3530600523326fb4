"""Compiled kernels of the iLQG solver: roll-out, linearisation, backward pass with control limits, line search.

All kernels work in place on one `Workspace`, so an iteration allocates nothing. They call dynamics and cost through
addresses (`mazeplan.core.maths.compiled`), so one cached compilation serves every model. The method is control-limited
DDP: Tassa, Mansard, Todorov, "Control-limited differential dynamic programming", ICRA 2014. Its inner problem is a
quadratic programme in two variables (`box_qp`), in which a variable is free unless the gradient holds it at a bound.

Second derivatives of the dynamics are estimated from the candidates alone. A matrix M stands for V f_ss. Without M,
most full steps fail on a rough learned model. A candidate moves the state by s and changes A by D. M should then
satisfy the secant equation M s = V D = y. Each candidate updates M, which stays positive semidefinite:

    1. If s' y < s' M s, M is scaled down to fit.
    2. The remaining error is r = y - M s. M grows by r r' / r' s (symmetric rank-one update; Nocedal, Wright,
       "Numerical Optimization", 2006, 6.2). If that update is ill-conditioned, M grows along s alone.

Kernels do not raise; they return one of the codes of `ilqg_workspace`.
"""

from __future__ import annotations

import math

from numba import njit

from mazeplan.control import ilqg_workspace as ws
from mazeplan.core.maths.compiled import CALLEE, KERNEL, caller, copy_into

ILL_CONDITIONED = 0.03  # maximum cosine between r and s
MIN_RATIO = 1e-4  # of the actual reduction of the cost over the expected reduction
MU_MIN, MU_MAX = 1e-6, 1e10  # bounds of the regularisation, which is added to the control Hessian
MU_FACTOR = 1.6  # first factor of a change of the regularisation; repeated changes in one direction get larger
SHORTER, TRIES = 0.4, 8  # factor from one tried step length to the next, and number of step lengths tried
_linearise = caller(ws.LINEARISE)
_running, _running_derivatives = caller(ws.RUNNING), caller(ws.RUNNING_DERIVATIVES)
_final, _final_derivatives = caller(ws.FINAL), caller(ws.FINAL_DERIVATIVES)


@njit(**CALLEE)
def roll_out(w, f, p, q, reference, alpha):
    """Cost of the candidate that the policy gives from states[0]; inf when it is not finite.

    u = clip(controls + alpha k + K (s - reference)); p and q are the vectors of dynamics and cost. The kernel also
    linearises the dynamics along the candidate.
    """
    T, n = w.K.shape[0], w.K.shape[2]
    total = 0.0
    copy_into(w.new_states[0], w.states[0])
    for t in range(T):
        s, u = w.new_states[t], w.new_controls[t]
        for i in range(2):
            v = w.controls[t, i] + alpha * w.k[t, i]
            for j in range(n):
                v += w.K[t, i, j] * (s[j] - reference[t, j])
            u[i] = min(max(v, w.low[i]), w.high[i])
        total += _running(f.running, (t, s, u, q))
        _linearise(f.linearise, (s, u, p, w.new_states[t + 1], w.new_a[t], w.new_b[t]))
        if not math.isfinite(total):
            return math.inf
    total += _final(f.final, (w.new_states[T], q))
    return total if math.isfinite(total) else math.inf


@njit(**KERNEL)
def begin(w, f, p, q, reference):
    """First roll-out, with the feedback K around the reference states (T+1, n); sets cost and regularisation."""
    w.k[:] = 0.0
    cost = roll_out(w, f, p, q, reference, 0.0)
    _accept_candidate(w)
    w.numbers[ws.COST], w.numbers[ws.MU], w.numbers[ws.FACTOR] = cost, 0.0, 1.0
    w.numbers[ws.SECANT] = 0.0
    w.numbers[ws.ALPHA] = 1.0
    w.curvature[:] = 0.0
    return ws.GO_ON if math.isfinite(cost) else ws.NOT_FINITE


@njit(**CALLEE)
def _accept_candidate(w):
    """Make the candidate the plan."""
    copy_into(w.states.ravel(), w.new_states.ravel())
    copy_into(w.controls.ravel(), w.new_controls.ravel())
    copy_into(w.A.ravel(), w.new_a.ravel())
    copy_into(w.B.ravel(), w.new_b.ravel())
    w.numbers[ws.STALE] = 1.0


@njit(**CALLEE)
def derivatives(w, f, q):
    """Derivatives of the cost along the plan."""
    T = w.controls.shape[0]
    for t in range(T):
        at = t, w.states[t], w.controls[t], q, w.lx[t], w.lu[t], w.lxx[t], w.luu[t]
        _running_derivatives(f.running_derivatives, at)
    _final_derivatives(f.final_derivatives, (w.states[T], q, w.lx[T], w.lxx[T]))
    w.numbers[ws.STALE] = 0.0


@njit(**CALLEE)
def _secant(w):
    """Record how far the linearised candidate moved, and how much its A changed."""
    for t in range(w.A.shape[0]):
        for i in range(w.V.shape[0]):
            w.delta_s[t, i] = w.new_states[t, i] - w.states[t, i]
            for j in range(w.V.shape[0]):
                w.delta_a[t, i, j] = w.new_a[t, i, j] - w.A[t, i, j]
    w.numbers[ws.SECANT] = 1.0


@njit(**CALLEE)
def _learn_curvature(w, t):
    """Update the curvature M of the step from the last candidate."""
    n = w.V.shape[0]
    M, r, s = w.curvature[t], w.secant_residual, w.delta_s[t]
    sy = sMs = ss = 0.0
    for j in range(n):
        r[j] = known = 0.0
        for i in range(n):
            r[j] += w.V[i] * w.delta_a[t, i, j]
            known += M[j, i] * s[i]
        sy += r[j] * s[j]
        sMs += known * s[j]
        ss += s[j] * s[j]
    if not ss > 1e-12:
        return
    if sMs > 0.0 and sy < sMs:
        M *= max(sy, 0.0) / sMs
    rs = rr = 0.0
    for j in range(n):
        for i in range(n):
            r[j] -= M[j, i] * s[i]
        rs += r[j] * s[j]
        rr += r[j] * r[j]
    if not rs > 0.0:
        return
    along = rs <= ILL_CONDITIONED * math.sqrt(rr * ss)
    for i in range(n):
        for j in range(n):
            M[i, j] += s[i] * s[j] * rs / (ss * ss) if along else r[i] * r[j] / rs


@njit(**CALLEE)
def _expand(w, t):
    """Write Qx, Qxx, Qux of the step into the workspace; return Qu and Quu as (g0, g1, h00, h01, h11)."""
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
    if w.numbers[ws.SECANT] > 0.0:
        _learn_curvature(w, t)
        for i in range(n):
            for j in range(n):
                w.Qxx[i, j] += w.curvature[t, i, j]
    return g0, g1, h00, h01, h11


@njit(**KERNEL)
def box_qp(h00, h01, h11, g0, g1, low0, high0, low1, high1):
    """Minimise 1/2 x' H x + g' x in the box lower <= x <= upper. Returns (x0, x1, free0, free1, ok).

    The objective is convex: if its unconstrained minimum lies outside the box, its minimum in the box lies on one of
    the four edges, each a problem in one variable.

    x0, x1:        the minimiser; it meets the bounds exactly
    free0, free1:  whether the variable is free; it is not free if its bounds coincide, or if it is at a bound and the
                   objective would fall beyond this bound
    ok:            whether H is positive definite; if not (also for NaN), the other results are zero and False
    """
    det = h00 * h11 - h01 * h01
    if not (h00 > 0.0 and h11 > 0.0 and det > 0.0):
        return 0.0, 0.0, False, False, False
    x0, x1 = (h01 * g1 - h11 * g0) / det, (h01 * g0 - h00 * g1) / det
    if not (low0 <= x0 <= high0 and low1 <= x1 <= high1):
        best = math.inf
        for edge in range(4):
            if edge < 2:
                e0 = low0 if edge == 0 else high0
                e1 = min(max(-(g1 + h01 * e0) / h11, low1), high1)
            else:
                e1 = low1 if edge == 2 else high1
                e0 = min(max(-(g0 + h01 * e1) / h00, low0), high0)
            cost = 0.5 * (h00 * e0 * e0 + h11 * e1 * e1) + h01 * e0 * e1 + g0 * e0 + g1 * e1
            if cost < best:
                best, x0, x1 = cost, e0, e1
    slope0, slope1 = h00 * x0 + h01 * x1 + g0, h01 * x0 + h11 * x1 + g1
    held0 = low0 >= high0 or (x0 <= low0 and slope0 > 0.0) or (x0 >= high0 and slope0 < 0.0)
    held1 = low1 >= high1 or (x1 <= low1 and slope1 > 0.0) or (x1 >= high1 and slope1 < 0.0)
    return x0, x1, not held0, not held1, True


@njit(**CALLEE)
def _feedback(w, t, h00, h01, h11, free0, free1):
    """K of the step: -Quu^-1 Qux on the free rows, zero on the rows at a limit."""
    for j in range(w.V.shape[0]):
        a, b = w.Qux[0, j], w.Qux[1, j]
        if free0 and free1:
            det = h00 * h11 - h01 * h01
            w.K[t, 0, j], w.K[t, 1, j] = (h01 * b - h11 * a) / det, (h01 * a - h00 * b) / det
        else:
            w.K[t, 0, j] = -a / h00 if free0 else 0.0
            w.K[t, 1, j] = -b / h11 if free1 else 0.0


@njit(**CALLEE)
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


@njit(**CALLEE)
def backward(w, mu):
    """k and K along the plan, with mu added to the diagonal of Quu. Returns (code, slope, curvature, largest).

    code:              GO_ON, NO_DESCENT if Quu is not positive definite, or NOT_FINITE
    slope, curvature:  a step of length alpha should change the cost by alpha slope + alpha^2 curvature
    largest:           largest full correction of a control; 0 at the optimum, as controls held at a limit have none
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
            code = ws.NO_DESCENT if math.isfinite(h00 + h01 + h11) else ws.NOT_FINITE
            return code, slope, curvature, largest
        w.k[t, 0], w.k[t, 1] = k0, k1
        _feedback(w, t, h00 + mu, h01, h11 + mu, free0, free1)
        slope += k0 * g0 + k1 * g1
        curvature += 0.5 * (h00 * k0 * k0 + h11 * k1 * k1) + h01 * k0 * k1
        largest = max(largest, abs(k0), abs(k1))
        _value(w, t, g0, g1, h00, h01, h11)
    return ws.GO_ON if math.isfinite(slope + curvature) else ws.NOT_FINITE, slope, curvature, largest


@njit(**CALLEE)
def _raise_mu(numbers):
    """Raise the regularisation. Returns whether it is still at most MU_MAX."""
    numbers[ws.FACTOR] = max(MU_FACTOR, numbers[ws.FACTOR] * MU_FACTOR)
    numbers[ws.MU] = max(MU_MIN, numbers[ws.MU] * numbers[ws.FACTOR])
    return numbers[ws.MU] <= MU_MAX


@njit(**CALLEE)
def _lower_mu(numbers):
    """Lower the regularisation. Below MU_MIN it becomes zero."""
    numbers[ws.FACTOR] = min(1.0 / MU_FACTOR, numbers[ws.FACTOR] / MU_FACTOR)
    mu = numbers[ws.MU] * numbers[ws.FACTOR]
    numbers[ws.MU] = mu if mu >= MU_MIN else 0.0


@njit(**KERNEL)
def policy(w, f, q):
    """Policy for the plan; raises the regularisation until a policy exists. Returns a code."""
    if w.numbers[ws.STALE] > 0.0:
        derivatives(w, f, q)
    code, slope, curvature, largest = backward(w, w.numbers[ws.MU])
    while code == ws.NO_DESCENT and _raise_mu(w.numbers):
        code, slope, curvature, largest = backward(w, w.numbers[ws.MU])
    w.numbers[ws.SLOPE], w.numbers[ws.CURVATURE], w.numbers[ws.LARGEST] = slope, curvature, largest
    return code


@njit(**CALLEE)
def _try(w, f, p, q, alpha):
    """Roll out a candidate and accept it if its cost is low enough. Returns the reduction; NaN if refused."""
    n = w.numbers
    expected = -alpha * (n[ws.SLOPE] + alpha * n[ws.CURVATURE])
    reduction = n[ws.COST] - roll_out(w, f, p, q, w.states, alpha)
    if math.isfinite(reduction):
        _secant(w)
    if not (reduction > MIN_RATIO * expected and reduction > 0.0):
        return math.nan
    _accept_candidate(w)
    n[ws.COST] -= reduction
    n[ws.ALPHA] = alpha
    _lower_mu(n)
    return reduction


@njit(**KERNEL)
def iterate(w, f, p, q, tolerance, control_tolerance):
    """One iteration: policy, then a line search; only a lower cost replaces the plan. Returns a code.

    The roll-out linearises each candidate, so an accepted candidate needs no second pass. A refused candidate shows the
    curvature of the dynamics, which the policy for the shorter step uses. The first step length is twice the last
    accepted one, at most 1."""
    n = w.numbers
    small, alpha = tolerance * (1.0 + abs(n[ws.COST])), min(1.0, 2.0 * n[ws.ALPHA])
    for _ in range(TRIES):
        code = policy(w, f, q)
        if code != ws.GO_ON:
            return code
        expected = -(n[ws.SLOPE] + n[ws.CURVATURE])
        if n[ws.MU] <= MU_MIN and (n[ws.LARGEST] < control_tolerance or expected < small):
            return ws.CONVERGED
        reduction = _try(w, f, p, q, alpha)
        if math.isfinite(reduction):
            return ws.CONVERGED if reduction < small and n[ws.MU] <= MU_MIN and alpha > 0.5 else ws.GO_ON
        alpha *= SHORTER
    return ws.GO_ON if _raise_mu(w.numbers) else ws.NO_DESCENT
