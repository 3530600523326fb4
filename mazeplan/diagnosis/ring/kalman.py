"""Extended Kalman filter for angle and speed of a ball in a ring, compiled. Its innovations are the residual.

    x_dd = sum of terms(x, v, t, w; p) - dry friction,    y_k = x(t_k) + noise,    white noise in x_dd

The position x is an angle, rad. w are the inputs at the nodes of the integration. The filter calls terms through their
addresses. So a term of a user needs no new compilation of the filter. Each sample is integrated by Runge-Kutta 4 in
SUBSTEPS steps. Dry friction uses time stepping (Moreau): the speed loses the impulse of friction in each step, and
becomes zero if the impulse is large enough. A ball that passes the angle of an opening loses a share of its speed.

Covariances are in units of the variance R of one measurement. q (1/s^3) is the intensity of the process noise in these
units. With R eliminated, R^ = mean(n_k^2 / S_k),

    -2 log L = N log R^ + sum log S_k

The same pass computes the derivatives of the innovations by parameters. It holds the gains of the filter fixed. A
parameter moves the state through its change of the acceleration in the middle of each sample.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from mazeplan.core.maths.compiled import CALLEE, KERNEL, pointer_to, shifted
from mazeplan.core.records import Array, IntArray
from mazeplan.physics.formulas.compiled import call_term as _term

SUBSTEPS = 2
NODES = 2 * SUBSTEPS + 1
DIFFUSE = 1e7  # variance of the speed at the beginning of a stretch, in R / s^2
SETTLING = 8  # innovations at the beginning of a stretch that do not count
STEP = 1e-6  # of the numeric derivatives of terms
TURN = 2.0 * math.pi  # rad


class Moves(NamedTuple):
    """What changes when each of J parameters moves by its step."""

    p: Array  # parameters (J, P); in row j, parameter j is moved
    # inputs (1 + M, N, 2, W), averaged over each sample; first axis: 0 unmoved, m as parameter m moves them; third
    # axis: 0 as they act on the speed, 1 as they act on the position
    w: Array
    which: IntArray  # row (J,) of w for each parameter; -1: the inputs do not change
    step: Array  # steps (J,)
    span: IntArray  # first of the terms that change, and one behind the last (J, 2)


class Problem(NamedTuple):
    """The record and the model that the filter uses."""

    y: Array  # measured positions (N,)
    seen: np.ndarray  # True (N,) where the position was measured
    begins: np.ndarray  # True (N,) where a stretch begins
    t: Array  # times (N,), s
    dt: float  # time between samples, s
    w: Array  # inputs (N, NODES, W) from each sample to the next
    terms: IntArray  # addresses (T,) of the terms
    place: IntArray  # index (T,) in p at which the parameters of each term begin
    holds: IntArray  # address and place (H, 2) of each dry friction
    openings: IntArray  # address of the angle, address of the loss, and place (G, 3) of each opening
    opening_offsets: Array  # angle (G,) that is added to that of each opening, rad


class _Core(NamedTuple):
    """Pointers into a Problem. row, node: distance in w from sample to sample, and from node to node."""

    w: Any
    t: Any
    terms: Any
    place: Any
    holds: Any
    openings: Any
    opening_offsets: Any
    row: int
    node: int
    n_terms: int
    n_holds: int
    n_openings: int
    dt: float


@njit(**CALLEE)
def _core(problem):
    """Pointers into a problem."""
    return _Core(
        pointer_to(problem.w, 0), pointer_to(problem.t, 0), pointer_to(problem.terms, 0), pointer_to(problem.place, 0),
        pointer_to(problem.holds, 0), pointer_to(problem.openings, 0), pointer_to(problem.opening_offsets, 0),
        problem.w.shape[1] * problem.w.shape[2], problem.w.shape[2], len(problem.terms), len(problem.holds),
        len(problem.openings), problem.dt,
    )  # fmt: skip


@njit(**CALLEE)
def _at(core, k, i):
    """Pointer to w[k, i]."""
    return shifted(core.w, k * core.row + i * core.node)


@njit(**CALLEE)
def _sum_range(core, p, first, end, x, v, t, w):
    """Sum of the terms from index `first` up to, but not including, `end`."""
    total = 0.0
    for i in range(first, end):
        total += _term(core.terms[i], (x, v, t, w, shifted(p, core.place[i])))
    return total


@njit(**CALLEE)
def _sum_terms(core, p, x, v, t, w):
    """Sum of all terms."""
    return _sum_range(core, p, 0, core.n_terms, x, v, t, w)


@njit(**CALLEE)
def _passed(a, before, after):
    """Whether the angle a, or a whole turn of it, lies between two positions."""
    return math.floor((before - a) / TURN) != math.floor((after - a) / TURN)


@njit(**CALLEE)
def _resistance(core, p, x, v, t, w):
    """Deceleration by dry friction of a motion in the direction of v, rad/s^2."""
    most = 0.0
    for i in range(core.n_holds):
        most += _term(core.holds[2 * i], (x, v, t, w, shifted(p, core.holds[2 * i + 1])))
    return max(most, 0.0)


@njit(**CALLEE)
def _opening(core, p, j, which, x, v, w):
    """Angle (which 0) or loss (1) of opening j for a ball at x with speed v."""
    place = shifted(p, core.openings[3 * j + 2])
    return _term(core.openings[3 * j + which], (x, v, 0.0, w, place))


@njit(**CALLEE)
def _opening_angle(core, p, j, x, v, w):
    """Angle of opening j for a ball at x with speed v."""
    return _opening(core, p, j, 0, x, v, w) + core.opening_offsets[j]


@njit(**CALLEE)
def _advance(core, p, k, x, v):
    """(position, speed, whether dry friction holds the ball at rest) one sample after sample k."""
    h, held = core.dt / SUBSTEPS, False
    for i in range(SUBSTEPS):
        t = core.t[k] + i * h
        w0, w1, w2 = _at(core, k, 2 * i), _at(core, k, 2 * i + 1), _at(core, k, 2 * i + 2)
        a1 = _sum_terms(core, p, x, v, t, w0)
        a2 = _sum_terms(core, p, x + 0.5 * h * v, v + 0.5 * h * a1, t + 0.5 * h, w1)
        a3 = _sum_terms(core, p, x + 0.5 * h * v + 0.25 * h * h * a1, v + 0.5 * h * a2, t + 0.5 * h, w1)
        a4 = _sum_terms(core, p, x + h * v + 0.5 * h * h * a2, v + h * a3, t + h, w2)
        before, free = x, v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
        x += h * v + h * h / 6.0 * (a1 + a2 + a3)
        v, held = free, False
        if core.n_holds > 0:
            most = h * _resistance(core, p, before, free, t, w1)
            held = abs(free) <= most
            v = 0.0 if held else free - math.copysign(most, free)
            x += 0.5 * h * (v - free)
        x, v = _slowed(core, p, before, x, v, w1)
    return x, v, held


@njit(**CALLEE)
def _slowed(core, p, before, x, v, w):
    """(position, speed) at the end of a step from the position `before`, after the losses at openings on the way."""
    for j in range(core.n_openings):
        angle = _opening_angle(core, p, j, before, v, w)
        if _passed(angle, before, x):  # the rest of the step is slower, too
            at = angle + TURN * math.floor((max(before, x) - angle) / TURN)
            kept = 1.0 - _opening(core, p, j, 1, before, v, w)
            x, v = at + kept * (x - at), v * kept
    return x, v


@njit(**CALLEE)
def _tangent(core, p, k, x, v, held):
    """Derivatives of `_advance` to second order in dt: x by x, x by v, v by x, v by v."""
    dt, t, w = core.dt, core.t[k] + 0.5 * core.dt, _at(core, k, SUBSTEPS)
    here = _sum_terms(core, p, x, v, t, w)
    by_x = (_sum_terms(core, p, x + STEP, v, t, w) - here) / STEP
    by_v = (_sum_terms(core, p, x, v + STEP, t, w) - here) / STEP
    if held:
        return 1.0, 0.0, 0.0, 0.0
    half = 0.5 * dt * dt
    return 1.0 + by_x * half, dt + by_v * half, by_x * dt, 1.0 + by_v * dt + by_x * half + by_v * by_v * half


@njit(**CALLEE)
def _mean(w, m, k, i):
    """Pointer to w[m, k, i] of an array (., N, 2, W)."""
    return pointer_to(w, ((m * w.shape[1] + k) * 2 + i) * w.shape[3])


@njit(**CALLEE)
def _move(core, p, k, before, after, held, moves, d):
    """Add the direct derivatives by the parameters, over the step after sample k, to those of the state, d (J, 2).

    before, after: (position, speed) at both ends of the step"""
    dt, w = core.dt, _at(core, k, SUBSTEPS)
    t, (x0, v0), (x1, v1) = core.t[k] + 0.5 * core.dt, before, after
    x, v = 0.5 * (x0 + x1), 0.5 * (v0 + v1)
    w0, w1 = _mean(moves.w, 0, k, 0), _mean(moves.w, 0, k, 1)
    rubs = core.n_holds > 0
    most = _resistance(core, p, x, v, t, w) if rubs else 0.0
    first = end = -1
    here = here_0 = here_1 = 0.0
    for j in range(0 if held else len(moves.step)):
        pj, step, m = pointer_to(moves.p, j * moves.p.shape[1]), moves.step[j], moves.which[j]
        if moves.span[j, 0] != first or moves.span[j, 1] != end:
            first, end = moves.span[j, 0], moves.span[j, 1]
            here = _sum_range(core, p, first, end, x, v, t, w)
            here_0, here_1 = _sum_range(core, p, first, end, x, v, t, w0), _sum_range(core, p, first, end, x, v, t, w1)
        if m < 0:
            faster = _sum_range(core, pj, first, end, x, v, t, w) - here
            if rubs:
                faster -= math.copysign(1.0, v) * (_resistance(core, pj, x, v, t, w) - most)
            further = faster
        else:
            faster = _sum_range(core, p, first, end, x, v, t, _mean(moves.w, m, k, 0)) - here_0
            further = _sum_range(core, p, first, end, x, v, t, _mean(moves.w, m, k, 1)) - here_1
        d[j, 0] += 0.5 * dt * dt * further / step
        d[j, 1] += dt * faster / step
    for i in range(core.n_openings):
        angle = _opening_angle(core, p, i, x, v0, w)
        if not _passed(angle, x0, x1):
            continue
        loss = _opening(core, p, i, 1, x, v0, w)
        kept = 1.0 - loss
        arrived = v1 / kept if abs(kept) > 0.1 else v0
        for j in range(len(moves.step)):
            pj = pointer_to(moves.p, j * moves.p.shape[1])
            lost = _opening(core, pj, i, 1, x, v0, w)
            d[j, 1] = kept * d[j, 1] - arrived * (lost - loss) / moves.step[j]
            d[j, 0] += loss * (_opening_angle(core, pj, i, x, v0, w) - angle) / moves.step[j]


@njit(**KERNEL)
def innovations(problem, p, q, stop, nu, S, states, moves, J):
    """Filter the first `stop` samples. The results go into these arrays:

    nu: innovations (N,), NaN where nothing was measured or a stretch has just begun
    S: variances (N,) of the innovations over R, 1 where nu is NaN
    states: filtered position, speed and three covariances (N, 5)
    J: derivatives (N, J) of nu by the parameters in `moves`"""
    x = v = p00 = p01 = p11 = 0.0
    dt, age, count = problem.dt, 0, len(moves.step)
    q00, q01, q11 = q * dt * dt * dt / 3.0, q * dt * dt / 2.0, q * dt
    d, core, at = np.zeros((count, 2)), _core(problem), pointer_to(p, 0)
    for k in range(stop):
        nu[k], S[k] = math.nan, 1.0
        if problem.begins[k]:
            x, v, p00, p01, p11, age = problem.y[k], 0.0, 1.0, 0.0, DIFFUSE, 0
            d[:] = 0.0
        else:
            before, speed = x, v
            x, v, held = _advance(core, at, k - 1, x, v)
            a, b, c, e = _tangent(core, at, k - 1, before, speed, held)
            m00, m01, m10, m11 = a * p00 + b * p01, a * p01 + b * p11, c * p00 + e * p01, c * p01 + e * p11
            p00, p01, p11 = m00 * a + m01 * b + q00, m00 * c + m01 * e + q01, m10 * c + m11 * e + q11
            if count:
                for j in range(count):
                    d[j, 0], d[j, 1] = a * d[j, 0] + b * d[j, 1], c * d[j, 0] + e * d[j, 1]
                _move(core, at, k - 1, (before, speed), (x, v), held, moves, d)
            if problem.seen[k]:
                s = p00 + 1.0
                gap = problem.y[k] - x
                gap -= TURN * math.floor(gap / TURN + 0.5)  # the number of turns in a gap is unknown
                g0, g1 = p00 / s, p01 / s
                x, v = x + g0 * gap, v + g1 * gap
                p11 -= g1 * p01
                p01 *= 1.0 - g0
                p00 *= 1.0 - g0
                age += 1
                if age > SETTLING:
                    nu[k], S[k] = gap, s
                for j in range(count):
                    J[k, j] = -d[j, 0]
                    d[j, 1] -= g1 * d[j, 0]
                    d[j, 0] *= 1.0 - g0
        states[k, 0], states[k, 1], states[k, 2], states[k, 3], states[k, 4] = x, v, p00, p01, p11


@njit(**KERNEL)
def roll_out(problem, p, states, starts, steps):
    """Roll-outs from the filtered states of the rows `starts` (W,), without measurements.

    Returns positions (W, steps + 1), and variances (W,) of the last position over R, without process noise."""
    core, at = _core(problem), pointer_to(p, 0)
    positions, variances = np.empty((len(starts), steps + 1)), np.empty(len(starts))
    for j, start in enumerate(starts):
        x, v = states[start, 0], states[start, 1]
        p00, p01, p11 = states[start, 2], states[start, 3], states[start, 4]
        positions[j, 0] = x
        for i in range(steps):
            before, speed = x, v
            x, v, held = _advance(core, at, start + i, x, v)
            a, b, c, d = _tangent(core, at, start + i, before, speed, held)
            m00, m01, m10, m11 = a * p00 + b * p01, a * p01 + b * p11, c * p00 + d * p01, c * p01 + d * p11
            p00, p01, p11 = m00 * a + m01 * b, m00 * c + m01 * d, m10 * c + m11 * d
            positions[j, i + 1] = x
        variances[j] = p00
    return positions, variances


@njit(**KERNEL)
def accelerations(problem, p, x, v):
    """Accelerations (N,) in the states (x, v) at the samples."""
    core, at, out = _core(problem), pointer_to(p, 0), np.empty(len(x))
    for k in range(len(x)):
        out[k] = _sum_terms(core, at, x[k], v[k], problem.t[k], _at(core, k, 0))
        if v[k] != 0.0:
            out[k] -= math.copysign(_resistance(core, at, x[k], v[k], problem.t[k], _at(core, k, 0)), v[k])
    return out


@njit(**CALLEE)
def _midpoint_step(core, p, k, x, v):
    """(position, speed) one sample after sample k, as `_advance`, but by the midpoint rule."""
    h = core.dt / SUBSTEPS
    for i in range(SUBSTEPS):
        w, middle = _at(core, k, 2 * i + 1), x + 0.5 * h * v
        free = v + h * _sum_terms(core, p, middle, v, core.t[k] + (i + 0.5) * h, w)
        before, new = x, free
        if core.n_holds > 0:
            most = h * _resistance(core, p, middle, free, core.t[k], w)
            new = 0.0 if abs(free) <= most else free - math.copysign(most, free)
        x += 0.5 * h * (v + new)
        x, v = _slowed(core, p, before, x, new, w)
    return x, v


@njit(**KERNEL)
def midpoint_roll_outs(problem, p, starts, steps):
    """Positions (W, steps + 1) of roll-outs from measured samples `starts` (W,).

    The start speed is the last difference of measured positions, corrected by half a sample of acceleration."""
    core, at = _core(problem), pointer_to(p, 0)
    out = np.empty((len(starts), steps + 1))
    for j, k in enumerate(starts):
        x = problem.y[k]
        v = (x - problem.y[k - 1]) / problem.dt
        v += 0.5 * problem.dt * _sum_terms(core, at, x, v, problem.t[k], _at(core, k, 0))
        out[j, 0] = x
        for i in range(steps):
            x, v = _midpoint_step(core, at, k + i, x, v)
            out[j, i + 1] = x
    return out
