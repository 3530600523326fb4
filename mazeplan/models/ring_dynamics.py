"""Discrete dynamics of the ball in one ring together with the tilting stage, compiled, with analytic derivatives.

State s = (theta, theta_dot, beta, beta_dot, gamma, gamma_dot), control u = (u_beta, u_gamma), one step of dt.
Point mass at radius r in the plate frame, R = Ry(beta) Rx(gamma); rolling and friction added:

    theta_dd =  beta_dd sin(gamma) + 2 beta_d gamma_d cos(gamma) sin(theta)^2
              + (gamma_d^2 - beta_d^2 cos(gamma)^2) sin(theta) cos(theta)
              - k (g/r) [sin(beta') sin(theta) + sin(gamma') cos(beta') cos(theta)]
              - c theta_d - d tanh(theta_d / w) + f(theta) + e
    beta_dd  =  wn^2 (gain u + offset - beta) - 2 zeta wn beta_d        (gamma likewise)

beta' = beta + beta_0 and gamma' = gamma + gamma_0 are the tilts against gravity: the table itself is off level by
(beta_0, gamma_0). f is what the floor adds (`surface`). e is held over a step: what a learned model adds
(`learned_dynamics`), else 0. tanh stands for the sign in dry friction: good for planning, not for identification.

The stage is linear with a held input, so it is exact (zero-order hold, any damping); theta goes by the classical
Runge-Kutta scheme of order 4 in SUBSTEPS steps on the exact tilt. Against an adaptive integrator one step of 1/30 s
is off by less than 1e-5 rad and 2e-4 rad/s (tilts to 5 degrees, tilt rates to 1 rad/s, speeds to 8 rad/s), a plan
of 40 steps by less than 1e-3 rad at its end. One sub-step instead of two would be off by ten times as much.

Derivatives: a Runge-Kutta step has many inputs and two results, so each result is traced back to the four
accelerations (`_traced`), and these to the tilt that they were taken at; only from sub-step to sub-step it goes
forwards. Tilts are small and angles change little within a step, so that one sine and cosine a step is taken of the
library.
"""

from __future__ import annotations

import math

from numba import njit

from mazeplan.maths.exponential import exp2_below
from mazeplan.maths.trigonometry import sine_and_cosine
from mazeplan.models.ring_parameters import (
    AXES,
    BETA_0,
    BY_ANGLE,
    BY_RATE,
    DAMPING,
    DRIVE,
    DRY,
    EXTRA,
    GAIN,
    GAMMA_0,
    NODE,
    OFFSET,
    STEP,
    STIFFNESS,
    SUBSTEP_COUNT,
    TABLE,
    VISCOUS,
    WIDTH,
)
from mazeplan.models.surface import force, slope

TWICE_LOG2E = 2.0 / math.log(2.0)


@njit(cache=True, error_model="numpy", inline="always")
def _tilt(p, axis, node, angle, rate, u):
    """Angle, rate and acceleration of one axis (its block in p) at a node of its table, from its start and command."""
    at = axis + TABLE + NODE * node
    rest = p[axis + GAIN] * u + p[axis + OFFSET]
    a = rest + p[at] * (angle - rest) + p[at + 1] * rate
    r = p[at + 2] * (angle - rest) + p[at + 3] * rate
    return a, r, p[axis + STIFFNESS] * (rest - a) - p[axis + DAMPING] * r


@njit(cache=True, error_model="numpy", inline="always")
def _axes(p):
    """Where the two axes begin in p."""
    size = TABLE + NODE * (2 * int(p[SUBSTEP_COUNT]) + 1)
    return AXES, AXES + size


@njit(cache=True, error_model="numpy", inline="always")
def _surface(p):
    """Where what the floor adds begins in p."""
    return AXES + 2 * (TABLE + NODE * (2 * int(p[SUBSTEP_COUNT]) + 1))


@njit(cache=True, error_model="numpy", inline="always")
def _node(p, s, u, node):
    """The plate at a node as the ball feels it: beta_d, beta_dd, gamma_d, sin and cos of gamma, beta', gamma'."""
    b, c = _axes(p)
    beta, beta_d, beta_dd = _tilt(p, b, node, s[2], s[3], u[0])
    gamma, gamma_d, _ = _tilt(p, c, node, s[4], s[5], u[1])
    sin_c, cos_c = sine_and_cosine(gamma)
    sin_bg, cos_bg = sine_and_cosine(beta + p[BETA_0])
    sin_cg, cos_cg = sine_and_cosine(gamma + p[GAMMA_0])
    return beta_d, beta_dd, gamma_d, sin_c, cos_c, sin_bg, cos_bg, sin_cg, cos_cg


@njit(cache=True, error_model="numpy", inline="always")
def _ball(p, start, theta, theta_d):
    """What acceleration and partials share of the ball: theta, theta_d, sin and cos of theta, tanh of dry friction.

    start: theta, its sine and its cosine where the step begins."""
    angle, sin, cos = start
    small, near = sine_and_cosine(theta - angle)
    gone = exp2_below(max(-TWICE_LOG2E * abs(theta_d) / p[WIDTH], -1000.0))
    tanh = math.copysign((1.0 - gone) / (1.0 + gone), theta_d)
    return theta, theta_d, sin * near + cos * small, cos * near - sin * small, tanh


@njit(cache=True, error_model="numpy", inline="always")
def _acceleration(p, plate, ball):
    """theta_dd with the plate as at a node."""
    beta_d, beta_dd, gamma_d, sin_c, cos_c, sin_bg, cos_bg, sin_cg, _ = plate
    theta, theta_d, sin, cos, tanh = ball
    turning = beta_dd * sin_c + 2.0 * beta_d * gamma_d * cos_c * sin * sin
    centripetal = (gamma_d * gamma_d - beta_d * beta_d * cos_c * cos_c) * sin * cos
    gravity = -p[DRIVE] * (sin_bg * sin + sin_cg * cos_bg * cos)
    friction = p[VISCOUS] * theta_d + p[DRY] * tanh
    total = turning + centripetal + gravity - friction + p[EXTRA]
    at = _surface(p)
    if p[at] != 0.0:
        total += force(p, at, theta)
    return total


@njit(cache=True, error_model="numpy", inline="always")
def _partials(p, plate, ball):
    """Derivatives of theta_dd at a node by theta, theta_d, beta, beta_d, beta_dd, gamma, gamma_d."""
    beta_d, beta_dd, gamma_d, sin_c, cos_c, sin_bg, cos_bg, sin_cg, cos_cg = plate
    theta, _, sin, cos, tanh = ball
    drive = p[DRIVE]
    centripetal = gamma_d * gamma_d - beta_d * beta_d * cos_c * cos_c
    at, floor = _surface(p), 0.0
    if p[at] != 0.0:
        floor = slope(p, at, theta)
    return (
        4.0 * beta_d * gamma_d * cos_c * sin * cos
        + centripetal * (cos * cos - sin * sin)
        - drive * (sin_bg * cos - sin_cg * cos_bg * sin)
        + floor,
        -p[VISCOUS] - p[DRY] / p[WIDTH] * (1.0 - tanh * tanh),
        -drive * (cos_bg * sin - sin_cg * sin_bg * cos),
        2.0 * gamma_d * cos_c * sin * sin - 2.0 * beta_d * cos_c * cos_c * sin * cos,
        sin_c,
        beta_dd * cos_c
        - 2.0 * beta_d * gamma_d * sin_c * sin * sin
        + 2.0 * beta_d * beta_d * cos_c * sin_c * sin * cos
        - drive * cos_cg * cos_bg * cos,
        2.0 * beta_d * cos_c * sin * sin + 2.0 * gamma_d * sin * cos,
    )


@njit(cache=True, error_model="numpy")
def step(s, u, p, out):
    """The state one dt later, into out (6,). s (6,), u (2,), p = RingParameters.pack()."""
    h, n = p[STEP], int(p[SUBSTEP_COUNT])
    theta, theta_d = s[0], s[1]
    start = theta, math.sin(theta), math.cos(theta)
    last = _node(p, s, u, 0)
    for i in range(n):
        first, middle, last = last, _node(p, s, u, 2 * i + 1), _node(p, s, u, 2 * i + 2)
        a1 = _acceleration(p, first, _ball(p, start, theta, theta_d))
        d2 = theta_d + 0.5 * h * a1
        a2 = _acceleration(p, middle, _ball(p, start, theta + 0.5 * h * theta_d, d2))
        d3 = theta_d + 0.5 * h * a2
        a3 = _acceleration(p, middle, _ball(p, start, theta + 0.5 * h * d2, d3))
        a4 = _acceleration(p, last, _ball(p, start, theta + h * d3, theta_d + h * a3))
        theta += h * theta_d + h * h / 6.0 * (a1 + a2 + a3)
        theta_d += h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
    b, c = _axes(p)
    beta, beta_d, _ = _tilt(p, b, 2 * n, s[2], s[3], u[0])
    gamma, gamma_d, _ = _tilt(p, c, 2 * n, s[4], s[5], u[1])
    out[0], out[1], out[2], out[3], out[4], out[5] = theta, theta_d, beta, beta_d, gamma, gamma_d


@njit(cache=True, error_model="numpy", inline="always")
def _tilt_tangent(p, axis, node, column):
    """Derivatives of angle, rate, acceleration at a node by the axis's start angle (column 0), rate (1), command
    (2)."""
    at = axis + TABLE + NODE * node
    rest = 0.0
    if column == 2:
        rest = p[axis + GAIN]
        a, r = rest * (1.0 - p[at]), -rest * p[at + 2]
    else:
        a, r = p[at + column], p[at + 2 + column]
    return a, r, p[axis + STIFFNESS] * (rest - a) - p[axis + DAMPING] * r


@njit(cache=True, error_model="numpy", inline="always")
def _traced(h, f1, f2, f3, f4, x, y):
    """What x theta + y theta_d behind a Runge-Kutta step owes to its inputs, backwards through the scheme.

    Returns its derivatives by theta and theta_d before the step, by the four accelerations together, and by the tilt
    (as `_partials` has it: beta, beta_d, beta_dd, gamma, gamma_d) at the first, the middle and the last node."""
    w4 = h / 6.0 * y
    w3 = h * h / 6.0 * x + h / 3.0 * y + h * f4[1] * w4
    w2 = h * h / 6.0 * x + h / 3.0 * y + 0.5 * h * f3[1] * w3 + 0.5 * h * h * f4[0] * w4
    w1 = h * h / 6.0 * x + h / 6.0 * y + 0.5 * h * f2[1] * w2 + 0.25 * h * h * f3[0] * w3
    by_theta = x + f1[0] * w1 + f2[0] * w2 + f3[0] * w3 + f4[0] * w4
    by_rate = h * x + y + f1[1] * w1 + (0.5 * h * f2[0] + f2[1]) * w2
    by_rate += (0.5 * h * f3[0] + f3[1]) * w3 + (h * f4[0] + f4[1]) * w4
    first = w1 * f1[2], w1 * f1[3], w1 * f1[4], w1 * f1[5], w1 * f1[6]
    middle = (
        w2 * f2[2] + w3 * f3[2],
        w2 * f2[3] + w3 * f3[3],
        w2 * f2[4] + w3 * f3[4],
        w2 * f2[5] + w3 * f3[5],
        w2 * f2[6] + w3 * f3[6],
    )
    last = w4 * f4[2], w4 * f4[3], w4 * f4[4], w4 * f4[5], w4 * f4[6]
    return by_theta, by_rate, w1 + w2 + w3 + w4, first, middle, last


@njit(cache=True, error_model="numpy", inline="always")
def _by_beta(traced, t1, t2, t3):
    """What a `_traced` result owes to beta, whose tangents at the three nodes are t1, t2, t3."""
    first, middle, last = traced[3], traced[4], traced[5]
    total = first[0] * t1[0] + first[1] * t1[1] + first[2] * t1[2]
    total += middle[0] * t2[0] + middle[1] * t2[1] + middle[2] * t2[2]
    return total + last[0] * t3[0] + last[1] * t3[1] + last[2] * t3[2]


@njit(cache=True, error_model="numpy", inline="always")
def _by_gamma(traced, t1, t2, t3):
    """The same of gamma, whose acceleration the ball does not feel."""
    first, middle, last = traced[3], traced[4], traced[5]
    total = first[3] * t1[0] + first[4] * t1[1] + middle[3] * t2[0] + middle[4] * t2[1]
    return total + last[3] * t3[0] + last[4] * t3[1]


@njit(cache=True, error_model="numpy", inline="always")
def _through(angle, rate, X, k, add_angle, add_rate):
    """Column k of the derivatives X of angle and rate, carried through a sub-step that adds something of its own."""
    before, speed = X[0, k], X[1, k]
    X[0, k] = angle[0] * before + angle[1] * speed + add_angle
    X[1, k] = rate[0] * before + rate[1] * speed + add_rate


@njit(cache=True, error_model="numpy")
def _advance(p, node, f1, f2, f3, f4, A, B):
    """Carry A, B and the derivatives by p[EXTRA] through the sub-step that begins at a node."""
    b, c = _axes(p)
    angle, rate = _traced(p[STEP], f1, f2, f3, f4, 1.0, 0.0), _traced(p[STEP], f1, f2, f3, f4, 0.0, 1.0)
    _through(angle, rate, A, 0, 0.0, 0.0)
    _through(angle, rate, A, 1, 0.0, 0.0)
    for j in range(3):
        t1, t2, t3 = _tilt_tangent(p, b, node, j), _tilt_tangent(p, b, node + 1, j), _tilt_tangent(p, b, node + 2, j)
        by_angle, by_rate = _by_beta(angle, t1, t2, t3), _by_beta(rate, t1, t2, t3)
        _through(angle, rate, A if j < 2 else B, 2 + j if j < 2 else 0, by_angle, by_rate)
        t1, t2, t3 = _tilt_tangent(p, c, node, j), _tilt_tangent(p, c, node + 1, j), _tilt_tangent(p, c, node + 2, j)
        by_angle, by_rate = _by_gamma(angle, t1, t2, t3), _by_gamma(rate, t1, t2, t3)
        _through(angle, rate, A if j < 2 else B, 4 + j if j < 2 else 1, by_angle, by_rate)
    before, speed = p[BY_ANGLE], p[BY_RATE]
    p[BY_ANGLE] = angle[0] * before + angle[1] * speed + angle[2]
    p[BY_RATE] = rate[0] * before + rate[1] * speed + rate[2]


@njit(cache=True, error_model="numpy")
def linearise(s, u, p, out, A, B):
    """`step`, and its derivatives by s and u, into A (6, 6) and B (6, 2): the chain rule through the scheme.

    Those of angle and rate by p[EXTRA] are left in p[BY_ANGLE] and p[BY_RATE]."""
    h, n = p[STEP], int(p[SUBSTEP_COUNT])
    A[:] = 0.0
    B[:] = 0.0
    A[0, 0] = A[1, 1] = 1.0
    p[BY_ANGLE] = p[BY_RATE] = 0.0
    theta, theta_d = s[0], s[1]
    start = theta, math.sin(theta), math.cos(theta)
    last = _node(p, s, u, 0)
    for i in range(n):
        first, middle, last = last, _node(p, s, u, 2 * i + 1), _node(p, s, u, 2 * i + 2)
        at1 = _ball(p, start, theta, theta_d)
        a1 = _acceleration(p, first, at1)
        d2 = theta_d + 0.5 * h * a1
        at2 = _ball(p, start, theta + 0.5 * h * theta_d, d2)
        a2 = _acceleration(p, middle, at2)
        d3 = theta_d + 0.5 * h * a2
        at3 = _ball(p, start, theta + 0.5 * h * d2, d3)
        a3 = _acceleration(p, middle, at3)
        at4 = _ball(p, start, theta + h * d3, theta_d + h * a3)
        a4 = _acceleration(p, last, at4)
        f1, f2 = _partials(p, first, at1), _partials(p, middle, at2)
        f3, f4 = _partials(p, middle, at3), _partials(p, last, at4)
        _advance(p, 2 * i, f1, f2, f3, f4, A, B)
        theta += h * theta_d + h * h / 6.0 * (a1 + a2 + a3)
        theta_d += h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
    out[0], out[1] = theta, theta_d
    out[2], out[3], _ = _tilt(p, _axes(p)[0], 2 * n, s[2], s[3], u[0])
    out[4], out[5], _ = _tilt(p, _axes(p)[1], 2 * n, s[4], s[5], u[1])
    _stage_tangents(p, 2 * n, A, B)


@njit(cache=True, error_model="numpy")
def _stage_tangents(p, node, A, B):
    """The rows of the stage in A and B."""
    b, c = _axes(p)
    for axis, row in ((b, 2), (c, 4)):
        for j in range(2):
            A[row, row + j], A[row + 1, row + j], _ = _tilt_tangent(p, axis, node, j)
        B[row, row // 2 - 1], B[row + 1, row // 2 - 1], _ = _tilt_tangent(p, axis, node, 2)
