"""The compiled inside of the iLQG planner: roll out, linearise, backward pass inside the control limits, line search.

Everything works in place on one `Workspace`, so that an iteration allocates nothing, and calls dynamics and cost
through their addresses (`mazeplan.maths.compiled`), so that one cached compilation serves every model. The method
is control-limited DDP: Tassa, Mansard, Todorov, "Control-limited differential dynamic programming", ICRA 2014. Of the
second derivatives of the dynamics only what candidates have shown is used: where one moved by s and turned A by D, the
curvature M that stands for V f_ss should give M s = V D = y (a secant). M is kept from one candidate to the next and
never negative: if s' y falls short of s' M s, M shrinks to it; what then is missing, r = y - M s, comes in as
r r' / r' s (the symmetric update of rank one; Nocedal, Wright, "Numerical Optimization", 2006, 6.2), or along s alone
where that would be ill-conditioned. Without it, a learned model that is rough makes most full steps fail.

Compiled functions cannot raise for numbers: what happened is returned as one of the codes below.
"""

from __future__ import annotations

import math

from numba import njit

from mazeplan.control.ilqg_workspace import (
    ALL_STALE,
    ALPHA,
    CONVERGED,
    COST,
    COST_STALE,
    CURVATURE,
    EXPECTED,
    FACTOR,
    FINAL,
    FINAL_DERIVATIVES,
    FREE,
    FRESH,
    GO_ON,
    GOT,
    LARGEST,
    LINEARISE,
    MU,
    NO_DESCENT,
    NOT_FINITE,
    RUNNING,
    RUNNING_DERIVATIVES,
    SECANT,
    SLOPE,
    STALE,
    STEP,
    WRONG,
)
from mazeplan.maths.boxqp import box_qp
from mazeplan.maths.compiled import caller

ILL_CONDITIONED = 0.03  # cosine between what is missing and the move
_step, _linearise = caller(STEP), caller(LINEARISE)
_running, _running_derivatives = caller(RUNNING), caller(RUNNING_DERIVATIVES)
_final, _final_derivatives = caller(FINAL), caller(FINAL_DERIVATIVES)


@njit(cache=True, error_model="numpy")
def roll_out(w, f, p, q, reference, alpha, derive):
    """Cost of the candidate that the policy gives from states[0]; inf when it is not finite.

    u = clip(controls + alpha k + K (s - reference)); p and q are the vectors of dynamics and cost. With derive the
    dynamics along it are linearised, too, into new_a and new_b.
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
        if derive:
            _linearise(f.linearise, (s, u, p, w.new_states[t + 1], w.new_a[t], w.new_b[t]))
        else:
            _step(f.step, (s, u, p, w.new_states[t + 1]))
        if not math.isfinite(total):
            return math.inf
    total += _final(f.final, (w.new_states[T], q))
    return total if math.isfinite(total) else math.inf


@njit(cache=True, error_model="numpy")
def begin(w, f, p, q, reference, mu):
    """First roll-out, with the feedback K around the reference states (T+1, n); sets cost and regularisation."""
    w.k[:] = 0.0
    cost = roll_out(w, f, p, q, reference, 0.0, True)
    _take(w)
    w.numbers[COST], w.numbers[MU], w.numbers[FACTOR] = cost, mu, 1.0
    w.numbers[EXPECTED] = w.numbers[GOT] = w.numbers[SECANT] = 0.0
    w.numbers[ALPHA] = 1.0
    w.bend[:] = 0.0
    return GO_ON if math.isfinite(cost) else NOT_FINITE


@njit(cache=True, error_model="numpy")
def _take(w):
    """The candidate becomes the trajectory."""
    w.states[:] = w.new_states
    w.controls[:] = w.new_controls
    w.A[:] = w.new_a
    w.B[:] = w.new_b
    w.numbers[STALE] = COST_STALE


@njit(cache=True, error_model="numpy")
def derivatives(w, f, p, q):
    """Derivatives of cost, and where they are missing of dynamics, along the trajectory."""
    T = w.controls.shape[0]
    for t in range(T):
        if w.numbers[STALE] == ALL_STALE:
            _linearise(f.linearise, (w.states[t], w.controls[t], p, w.Qx, w.A[t], w.B[t]))
        _running_derivatives(
            f.running_derivatives, (t, w.states[t], w.controls[t], q, w.lx[t], w.lu[t], w.lxx[t], w.luu[t])
        )
    _final_derivatives(f.final_derivatives, (w.states[T], q, w.lx[T], w.lxx[T]))
    w.numbers[STALE] = FRESH


@njit(cache=True, error_model="numpy")
def _secant(w):
    """What the candidate, which was linearised, tells of the curvature of the dynamics."""
    for t in range(w.A.shape[0]):
        for i in range(w.V.shape[0]):
            w.moved[t, i] = w.new_states[t, i] - w.states[t, i]
            for j in range(w.V.shape[0]):
                w.turned[t, i, j] = w.new_a[t, i, j] - w.A[t, i, j]
    w.numbers[SECANT] = 1.0


@njit(cache=True, error_model="numpy")
def _learn_bend(w, t):
    """Bring the curvature M of the step into line with what the last candidate has shown."""
    n = w.V.shape[0]
    M, r, s = w.bend[t], w.missing, w.moved[t]
    sy = sMs = ss = 0.0
    for j in range(n):
        r[j] = known = 0.0
        for i in range(n):
            r[j] += w.V[i] * w.turned[t, i, j]
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
    if w.numbers[SECANT] > 0.0:
        _learn_bend(w, t)
        for i in range(n):
            for j in range(n):
                w.Qxx[i, j] += w.bend[t, i, j]
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
    if w.numbers[STALE] != FRESH:
        derivatives(w, f, p, q)
    code, slope, curvature, largest = backward(w, w.numbers[MU])
    while code == NO_DESCENT and _harder(w, rules):
        code, slope, curvature, largest = backward(w, w.numbers[MU])
    w.numbers[SLOPE], w.numbers[CURVATURE], w.numbers[LARGEST] = slope, curvature, largest
    return code


@njit(cache=True, error_model="numpy")
def finish(w, f, p, q, rules):
    """Gains of the trajectory as it stands, whatever candidates there were on the way. Returns a code."""
    if w.numbers[SECANT] == 0.0 and w.numbers[STALE] == FRESH:
        return GO_ON  # there were none, and the policy has been made
    w.numbers[SECANT] = 0.0
    return policy(w, f, p, q, rules)


@njit(cache=True, error_model="numpy")
def _try(w, f, p, q, rules, alpha):
    """Roll a candidate out and take it if its cost is low enough. Returns its reduction, or NaN where it was not."""
    n = w.numbers
    expected = -alpha * (n[SLOPE] + alpha * n[CURVATURE])
    reduction = n[COST] - roll_out(w, f, p, q, w.states, alpha, True)
    if math.isfinite(reduction):
        _secant(w)
    if not (reduction > rules.min_ratio * expected and reduction > 0.0):
        return math.nan
    _take(w)
    n[COST] -= reduction
    n[EXPECTED], n[GOT], n[ALPHA] = expected, reduction, alpha
    _softer(w, rules)
    return reduction


@njit(cache=True, error_model="numpy")
def iterate(w, f, p, q, rules):
    """One iteration: policy, then a line search; only a lower cost replaces the trajectory. Returns a code.

    Candidates are linearised on the way: those taken need no second pass, and those refused tell how the dynamics bend,
    with which the policy is made anew for a shorter step. The first step is twice as long as the last one taken, at
    most a full one: where steps had to be short, the next ones mostly have to be, too."""
    n = w.numbers
    small, alpha = rules.tolerance * (1.0 + abs(n[COST])), min(1.0, 2.0 * n[ALPHA])
    for _ in range(rules.tries):
        code = policy(w, f, p, q, rules)
        if code != GO_ON:
            return code
        expected = -(n[SLOPE] + n[CURVATURE])
        if n[MU] <= rules.mu_min and (n[LARGEST] < rules.control_tolerance or expected < small):
            return CONVERGED
        reduction = _try(w, f, p, q, rules, alpha)
        if math.isfinite(reduction):
            return CONVERGED if reduction < small and n[MU] <= rules.mu_min and alpha > 0.5 else GO_ON
        alpha *= rules.shorter
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
