"""Extended Kalman filter over position and speed of one moving thing, compiled: its innovations are the residual.

    x_dd = sum of terms(x, v, t, w; p) - dry friction,    y_k = x(t_k) + noise,    white noise in x_dd

w are the inputs at the nodes of the integration. Terms are called through their addresses, so that a term that a user
adds needs no new compilation of the filter. Runge-Kutta 4 in SUBSTEPS steps a sample; dry friction by time stepping
(Moreau): the impulse of a step is taken off the speed, and holds it at nought where it is large enough to. A gate takes
a share of the speed when its angle is passed, one in a wall only of a ball that lies against it (`wallterms`).

Covariances are in units of the variance R of one measurement, q (1/s^3) is the intensity of the process noise in them.
With R eliminated, R^ = mean(n_k^2 / S_k),

    -2 log L = N log R^ + sum log S_k
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit, types

from mazeplan.diagnosis.wallterms import against, pressing
from mazeplan.maths.compiled import REAL, VECTOR, caller
from mazeplan.records import Array, IntArray

TERM = REAL(REAL, REAL, REAL, VECTOR, VECTOR)  # x, v, t, w, p
SUBSTEPS = 2
NODES = 2 * SUBSTEPS + 1
DIFFUSE = 1e7  # variance of the speed at the beginning of a stretch, in R / s^2
SETTLING = 8  # innovations at the beginning of a stretch that do not count
STEP = 1e-6  # of the difference by which terms are differentiated

_term = caller(TERM)
addresses = types.int64[::1]


class Problem(NamedTuple):
    """What is filtered. y (N,): measured position; seen, first (N,): whether measured, whether a stretch begins; t (N,)
    and dt: s; w (N, NODES, W): inputs from each sample to the next; terms (T,): addresses; place (T, 2): where in p
    the parameters of a term are; dry: where its coefficient is in p (its asymmetry behind), -1: none; gates (G, 2):
    where in p angle and loss of a gate are; turn: after how much a position repeats, 0: never; gate_at (G, 2): what is
    added to the angle of a gate, and the side of its wall (`wallterms.against`); wall: where in p the friction at the
    walls is, -1: none; pull: g / R, 1/s^2."""

    y: Array
    seen: np.ndarray
    first: np.ndarray
    t: Array
    dt: float
    w: Array
    terms: IntArray
    place: IntArray
    dry: int
    gates: IntArray
    turn: float
    gate_at: Array
    wall: int
    pull: float


@njit(cache=True, error_model="numpy")
def total(problem, p, x, v, t, w):
    """Sum of the terms, rad/s^2."""
    found = 0.0
    for i in range(len(problem.terms)):
        part = p[problem.place[i, 0] : problem.place[i, 1]]
        found += _term(problem.terms[i], (x, v, t, w, part))
    return found


@njit(cache=True, error_model="numpy")
def passed(a, before, after):
    """Whether the angle a, or a whole turn of it, lies between two positions."""
    turn = 2.0 * math.pi
    return math.floor((before - a) / turn) != math.floor((after - a) / turn)


@njit(cache=True, error_model="numpy")
def resistance(problem, p, x, v, w):
    """Dry friction at floor and walls against a motion in the direction of v, rad/s^2."""
    most = 0.0
    if problem.dry >= 0:
        most = max(p[problem.dry] + math.copysign(p[problem.dry + 1], v), 0.0)
    if problem.wall >= 0:
        most += p[problem.wall] * abs(pressing(x, v, w, problem.pull))
    return most


@njit(cache=True, error_model="numpy")
def advance(problem, p, k, x, v):
    """(position, speed, whether it is held at rest) one sample after sample k."""
    h, held = problem.dt / SUBSTEPS, False
    for i in range(SUBSTEPS):
        t = problem.t[k] + i * h
        w0, w1, w2 = problem.w[k, 2 * i], problem.w[k, 2 * i + 1], problem.w[k, 2 * i + 2]
        a1 = total(problem, p, x, v, t, w0)
        a2 = total(problem, p, x + 0.5 * h * v, v + 0.5 * h * a1, t + 0.5 * h, w1)
        a3 = total(problem, p, x + 0.5 * h * v + 0.25 * h * h * a1, v + 0.5 * h * a2, t + 0.5 * h, w1)
        a4 = total(problem, p, x + h * v + 0.5 * h * h * a2, v + h * a3, t + h, w2)
        before, free = x, v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
        x += h * v + h * h / 6.0 * (a1 + a2 + a3)
        v, held = free, False
        if problem.dry >= 0 or problem.wall >= 0:
            most = h * resistance(problem, p, before, free, w2)
            held = abs(free) <= most
            v = 0.0 if held else free - math.copysign(most, free)
            x += 0.5 * h * (v - free)
        for g in range(len(problem.gates)):
            if passed(p[problem.gates[g, 0]] + problem.gate_at[g, 0], before, x):
                share = against(pressing(before, v, w1, problem.pull), problem.pull, problem.gate_at[g, 1])
                v *= 1.0 - share * p[problem.gates[g, 1]]
    return x, v, held


@njit(cache=True, error_model="numpy")
def _tangent(problem, p, k, x, v, held):
    """Derivatives of `advance` by position and speed, to second order in the step."""
    dt, t, w = problem.dt, problem.t[k] + 0.5 * problem.dt, problem.w[k, SUBSTEPS]
    here = total(problem, p, x, v, t, w)
    by_x = (total(problem, p, x + STEP, v, t, w) - here) / STEP
    by_v = (total(problem, p, x, v + STEP, t, w) - here) / STEP
    if held:
        return 1.0, 0.0, 0.0, 0.0
    half = 0.5 * dt * dt
    return 1.0 + by_x * half, dt + by_v * half, by_x * dt, 1.0 + by_v * dt + by_x * half + by_v * by_v * half


@njit(cache=True, error_model="numpy")
def innovations(problem, p, q, stop, nu, S, states):
    """Filter the first `stop` samples; innovations into nu (N,) and their variances over R into S (N,), NaN and 1 where
    nothing was measured or a stretch has just begun; filtered position, speed and three covariances into states
    (N, 5)."""
    x = v = p00 = p01 = p11 = 0.0
    dt, age = problem.dt, 0
    q00, q01, q11 = q * dt * dt * dt / 3.0, q * dt * dt / 2.0, q * dt
    for k in range(stop):
        if problem.first[k]:
            x, v, p00, p01, p11, age = problem.y[k], 0.0, 1.0, 0.0, DIFFUSE, 0
            nu[k], S[k] = math.nan, 1.0
        else:
            before, speed = x, v
            x, v, held = advance(problem, p, k - 1, x, v)
            a, b, c, d = _tangent(problem, p, k - 1, before, speed, held)
            m00, m01, m10, m11 = a * p00 + b * p01, a * p01 + b * p11, c * p00 + d * p01, c * p01 + d * p11
            p00, p01, p11 = m00 * a + m01 * b + q00, m00 * c + m01 * d + q01, m10 * c + m11 * d + q11
            nu[k], S[k] = math.nan, 1.0
            if problem.seen[k]:
                s = p00 + 1.0
                gap = problem.y[k] - x
                if problem.turn > 0.0:  # behind a gap nobody knows how often it went round
                    gap -= problem.turn * math.floor(gap / problem.turn + 0.5)
                g0, g1 = p00 / s, p01 / s
                x, v = x + g0 * gap, v + g1 * gap
                p11 -= g1 * p01
                p01 *= 1.0 - g0
                p00 *= 1.0 - g0
                age += 1
                if age > SETTLING:
                    nu[k], S[k] = gap, s
        states[k, 0], states[k, 1], states[k, 2], states[k, 3], states[k, 4] = x, v, p00, p01, p11


@njit(cache=True, error_model="numpy")
def roll_out(problem, p, states, starts, steps, out):
    """Positions (W, steps + 1) from the filtered states of some rows on, without looking at measurements, into out; the
    variance of the last one over R, without process noise, into out's last column + 1: out (W, steps + 2)."""
    for j, start in enumerate(starts):
        x, v = states[start, 0], states[start, 1]
        p00, p01, p11 = states[start, 2], states[start, 3], states[start, 4]
        out[j, 0] = x
        for i in range(steps):
            before, speed = x, v
            x, v, held = advance(problem, p, start + i, x, v)
            a, b, c, d = _tangent(problem, p, start + i, before, speed, held)
            m00, m01, m10, m11 = a * p00 + b * p01, a * p01 + b * p11, c * p00 + d * p01, c * p01 + d * p11
            p00, p01, p11 = m00 * a + m01 * b, m00 * c + m01 * d, m10 * c + m11 * d
            out[j, i + 1] = x
        out[j, steps + 1] = p00


@njit(cache=True, error_model="numpy")
def accelerations(problem, p, x, v, out):
    """Acceleration (N,) in the states (x, v) at the samples."""
    for k in range(len(x)):
        out[k] = total(problem, p, x[k], v[k], problem.t[k], problem.w[k, 0])
        if v[k] != 0.0:
            out[k] -= math.copysign(resistance(problem, p, x[k], v[k], problem.w[k, 0]), v[k])
