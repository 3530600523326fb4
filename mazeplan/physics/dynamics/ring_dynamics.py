"""Discrete dynamics of the ball in one ring and of the tilting stage, compiled, with derivatives.

State s = (theta, theta_dot, beta, beta_dot, gamma, gamma_dot), control u = (u_beta, u_gamma), one step of dt.

    theta_dd = sum of effects (`formulas.equation`) + e
    beta_dd  = wn^2 (gain (u_beta + coupling u_gamma) + offset - beta) - 2 zeta wn beta_d        (gamma likewise)

e is constant during a step: the output of a learned part (`gp_dynamics`), or 0. In dry friction, tanh replaces the
sign; that suits planning, but not identification.

The stage is linear with a held input, so its solution is exact (zero-order hold, any damping). The classical
Runge-Kutta scheme of order 4 integrates theta in SUBSTEPS steps on the exact tilt. One step of 1/30 s differs from an
adaptive integrator by less than 1e-5 rad and 2e-4 rad/s (tilts to 5 degrees, tilt rates to 1 rad/s, speeds to 8 rad/s).
A plan of 40 steps differs by less than 1e-3 rad at its end. One sub-step instead of two has ten times the error.

Effects are compiled functions whose addresses are in p (`RingParameters.pack`). One function evaluates the plate at
each node of the scheme. Another function evaluates the ball at each stage. Angles change little within a step, so one
library call for sine and cosine per step is enough.

A Runge-Kutta step has many inputs and two results. Therefore `_step_adjoint` computes derivatives backwards: from each
result to the four accelerations, and from these to the tilt at their nodes. From one sub-step to the next, derivatives
are propagated forwards.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from mazeplan.core.maths.compiled import CALLEE, KERNEL, pointer_to, shifted
from mazeplan.core.maths.trigonometry import sine_and_cosine
from mazeplan.physics.dynamics import ring_parameters as at
from mazeplan.physics.formulas.compiled import call_partials, call_plate, call_value
from mazeplan.physics.formulas.symbols import PLATE

OUT = len(PLATE)  # start, in the scratch space, of the derivatives of a sub-step's stages
COEFFICIENTS = OUT + at.STAGES * at.SLOPES  # start, in the scratch space, of the coefficients of the nodes


@njit(cache=True, error_model="numpy", inline="always")
def _tilt(p, axis, node, angle, rate, u):
    """Angle, rate and acceleration of one axis at a node, from its angle and rate at the start and its command u.

    axis: start of its block in p; node: of the table in this block."""
    row = axis + at.TABLE + at.NODE * node
    rest = p[axis + at.GAIN] * u + p[axis + at.OFFSET]
    a = rest + p[row] * (angle - rest) + p[row + 1] * rate
    r = p[row + 2] * (angle - rest) + p[row + 3] * rate
    return a, r, p[axis + at.STIFFNESS] * (rest - a) - p[axis + at.DAMPING] * r


@njit(cache=True, error_model="numpy", inline="always")
def _axes(p):
    """Where the blocks of beta and gamma start in p."""
    size = at.TABLE + at.NODE * (2 * int(p[at.SUBSTEP_COUNT]) + 1)
    return at.AXES, at.AXES + size


@njit(cache=True, error_model="numpy", inline="always")
def _mixed(p, u):
    """Command that reaches each axis: its command in u (2,), plus a share of the other axis's command."""
    b, c = _axes(p)
    return u[0] + p[b + at.COUPLING] * u[1], u[1] + p[c + at.COUPLING] * u[0]


@njit(cache=True, error_model="numpy", inline="always")
def _scratch(p, row):
    """Pointer into the scratch space."""
    return pointer_to(p, int(p[at.SCRATCH]) + row)


@njit(**CALLEE)
def _node(p, s, u, node, function):
    """Evaluate the coefficients of a node from the plate's motion there; returns a pointer to them.

    function: index in p of the address of `plate` or `plate_partials`."""
    b, c = _axes(p)
    ub, uc = _mixed(p, u)
    w, out = _scratch(p, 0), _scratch(p, COEFFICIENTS + node * int(p[at.EVERY]))
    w[0], w[1], w[2] = _tilt(p, b, node, s[2], s[3], ub)
    w[3], w[4], w[5] = _tilt(p, c, node, s[4], s[5], uc)
    w[6], w[7] = p[at.RADIUS], p[at.BALL]
    call_plate(np.int64(p[function]), (0.0, w, pointer_to(p, int(p[at.PARAMETERS])), out))
    return out


@njit(cache=True, error_model="numpy", inline="always")
def _turned(start, theta):
    """Sine and cosine of theta; start: (angle, its sine, its cosine) of an angle near theta."""
    angle, sin, cos = start
    small, near = sine_and_cosine(theta - angle)
    return sin * near + cos * small, cos * near - sin * small


@njit(cache=True, error_model="numpy", inline="always")
def _acceleration(p, plate, start, theta, theta_d):
    """theta_dd, rad/s^2; plate: coefficients of a node."""
    sin, cos = _turned(start, theta)
    parameters = pointer_to(p, int(p[at.PARAMETERS]))
    return call_value(np.int64(p[at.VALUE_AT]), (theta, theta_d, sin, cos, plate, parameters)) + p[at.EXTRA]


@njit(cache=True, error_model="numpy", inline="always")
def _partials(p, plate, start, theta, theta_d, stage):
    """theta_dd, and a pointer to its derivatives at a stage of the scheme: by theta, theta_d, beta, beta_d, beta_dd,
    gamma, gamma_d."""
    sin, cos = _turned(start, theta)
    out = _scratch(p, OUT + at.SLOPES * stage)
    parameters = pointer_to(p, int(p[at.PARAMETERS]))
    call_partials(np.int64(p[at.PARTIALS_AT]), (theta, theta_d, sin, cos, plate, parameters, out))
    return out[0] + p[at.EXTRA], shifted(out, 1)


@njit(**KERNEL)
def acceleration(s, u, p):
    """theta_dd, rad/s^2, in a state (6,) under a command (2,)."""
    start = s[0], math.sin(s[0]), math.cos(s[0])
    return _acceleration(p, _node(p, s, u, np.int64(0), at.PLATE_AT), start, s[0], s[1])


@njit(**KERNEL)
def step(s, u, p, out):
    """Write the state one dt later into out (6,); s (6,), u (2,), p = RingParameters.pack()."""
    h, n = p[at.STEP], int(p[at.SUBSTEP_COUNT])
    theta, theta_d = s[0], s[1]
    start = theta, math.sin(theta), math.cos(theta)
    last = _node(p, s, u, np.int64(0), at.PLATE_AT)
    for i in range(n):
        first, middle = last, _node(p, s, u, 2 * i + 1, at.PLATE_AT)
        last = _node(p, s, u, 2 * i + 2, at.PLATE_AT)
        a1 = _acceleration(p, first, start, theta, theta_d)
        d2 = theta_d + 0.5 * h * a1
        a2 = _acceleration(p, middle, start, theta + 0.5 * h * theta_d, d2)
        d3 = theta_d + 0.5 * h * a2
        a3 = _acceleration(p, middle, start, theta + 0.5 * h * d2, d3)
        a4 = _acceleration(p, last, start, theta + h * d3, theta_d + h * a3)
        theta += h * theta_d + h * h / 6.0 * (a1 + a2 + a3)
        theta_d += h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
    _stage_end(p, s, u, 2 * n, out)
    out[0], out[1] = theta, theta_d


@njit(cache=True, error_model="numpy", inline="always")
def _stage_end(p, s, u, node, out):
    """Write angles and rates of the stage at a node into out[2:]."""
    b, c = _axes(p)
    ub, uc = _mixed(p, u)
    out[2], out[3], _ = _tilt(p, b, node, s[2], s[3], ub)
    out[4], out[5], _ = _tilt(p, c, node, s[4], s[5], uc)


@njit(cache=True, error_model="numpy", inline="always")
def _tilt_tangent(p, axis, node, column):
    """Derivatives of an axis's angle, rate and acceleration at a node by one of its inputs.

    column: 0 for the angle at the start, 1 for the rate at the start, 2 for the command."""
    row = axis + at.TABLE + at.NODE * node
    rest = 0.0
    if column == 2:
        rest = p[axis + at.GAIN]
        a, r = rest * (1.0 - p[row]), -rest * p[row + 2]
    else:
        a, r = p[row + column], p[row + 2 + column]
    return a, r, p[axis + at.STIFFNESS] * (rest - a) - p[axis + at.DAMPING] * r


@njit(cache=True, error_model="numpy", inline="always")
def _step_adjoint(h, f1, f2, f3, f4, x, y):
    """Derivatives of x theta + y theta_d after a Runge-Kutta step by the inputs of the step, backwards through it.

    f1 to f4: derivatives of the four accelerations, from `_partials`. Returns the derivatives by theta and by theta_d
    before the step, by a number added to all four accelerations, and by the tilt at the first, the middle and the last
    node. The tilt is (beta, beta_d, beta_dd, gamma, gamma_d)."""
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
    """Derivative of a `_step_adjoint` result through beta, whose tangents at the three nodes are t1, t2, t3."""
    first, middle, last = traced[3], traced[4], traced[5]
    total = first[0] * t1[0] + first[1] * t1[1] + first[2] * t1[2]
    total += middle[0] * t2[0] + middle[1] * t2[1] + middle[2] * t2[2]
    return total + last[0] * t3[0] + last[1] * t3[1] + last[2] * t3[2]


@njit(cache=True, error_model="numpy", inline="always")
def _by_gamma(traced, t1, t2, t3):
    """Derivative of a `_step_adjoint` result through gamma, whose acceleration does not act on the ball."""
    first, middle, last = traced[3], traced[4], traced[5]
    total = first[3] * t1[0] + first[4] * t1[1] + middle[3] * t2[0] + middle[4] * t2[1]
    return total + last[3] * t3[0] + last[4] * t3[1]


@njit(cache=True, error_model="numpy", inline="always")
def _propagate_column(angle, rate, X, k, add_angle, add_rate):
    """Propagate column k of X, the derivatives of angle and rate, through a sub-step.

    add_angle, add_rate: what the sub-step itself adds to the two derivatives."""
    before, speed = X[0, k], X[1, k]
    X[0, k] = angle[0] * before + angle[1] * speed + add_angle
    X[1, k] = rate[0] * before + rate[1] * speed + add_rate


@njit(**CALLEE)
def _advance(p, node, f1, f2, f3, f4, A, B):
    """Propagate A, B and the derivatives by p[EXTRA] through the sub-step that begins at a node."""
    b, c = _axes(p)
    angle = _step_adjoint(p[at.STEP], f1, f2, f3, f4, 1.0, 0.0)
    rate = _step_adjoint(p[at.STEP], f1, f2, f3, f4, 0.0, 1.0)
    _propagate_column(angle, rate, A, 0, 0.0, 0.0)
    _propagate_column(angle, rate, A, 1, 0.0, 0.0)
    by_angle, by_rate, by_angle_c, by_rate_c = 0.0, 0.0, 0.0, 0.0
    for j in range(3):
        t1, t2, t3 = _tilt_tangent(p, b, node, j), _tilt_tangent(p, b, node + 1, j), _tilt_tangent(p, b, node + 2, j)
        by_angle, by_rate = _by_beta(angle, t1, t2, t3), _by_beta(rate, t1, t2, t3)
        t1, t2, t3 = _tilt_tangent(p, c, node, j), _tilt_tangent(p, c, node + 1, j), _tilt_tangent(p, c, node + 2, j)
        by_angle_c, by_rate_c = _by_gamma(angle, t1, t2, t3), _by_gamma(rate, t1, t2, t3)
        if j < 2:
            _propagate_column(angle, rate, A, 2 + j, by_angle, by_rate)
            _propagate_column(angle, rate, A, 4 + j, by_angle_c, by_rate_c)
    mix_b, mix_c = p[b + at.COUPLING], p[c + at.COUPLING]  # column 2 is by the command that reaches an axis
    _propagate_column(angle, rate, B, 0, by_angle + mix_c * by_angle_c, by_rate + mix_c * by_rate_c)
    _propagate_column(angle, rate, B, 1, by_angle_c + mix_b * by_angle, by_rate_c + mix_b * by_rate)
    before, speed = p[at.BY_ANGLE], p[at.BY_RATE]
    p[at.BY_ANGLE] = angle[0] * before + angle[1] * speed + angle[2]
    p[at.BY_RATE] = rate[0] * before + rate[1] * speed + rate[2]


@njit(**KERNEL)
def linearise(s, u, p, out, A, B):
    """As `step`; also writes the derivatives by s into A (6, 6) and by u into B (6, 2), by the chain rule.

    Afterwards p[BY_ANGLE] and p[BY_RATE] hold the derivatives of angle and rate by p[EXTRA]."""
    h, n = p[at.STEP], int(p[at.SUBSTEP_COUNT])
    A[:] = 0.0
    B[:] = 0.0
    A[0, 0] = A[1, 1] = 1.0
    p[at.BY_ANGLE] = p[at.BY_RATE] = 0.0
    theta, theta_d = s[0], s[1]
    start = theta, math.sin(theta), math.cos(theta)
    last = _node(p, s, u, np.int64(0), at.PLATE_PARTIALS_AT)
    for i in range(n):
        first, middle = last, _node(p, s, u, 2 * i + 1, at.PLATE_PARTIALS_AT)
        last = _node(p, s, u, 2 * i + 2, at.PLATE_PARTIALS_AT)
        a1, f1 = _partials(p, first, start, theta, theta_d, 0)
        d2 = theta_d + 0.5 * h * a1
        a2, f2 = _partials(p, middle, start, theta + 0.5 * h * theta_d, d2, 1)
        d3 = theta_d + 0.5 * h * a2
        a3, f3 = _partials(p, middle, start, theta + 0.5 * h * d2, d3, 2)
        a4, f4 = _partials(p, last, start, theta + h * d3, theta_d + h * a3, 3)
        _advance(p, 2 * i, f1, f2, f3, f4, A, B)
        theta += h * theta_d + h * h / 6.0 * (a1 + a2 + a3)
        theta_d += h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
    _stage_end(p, s, u, 2 * n, out)
    out[0], out[1] = theta, theta_d
    _stage_tangents(p, 2 * n, A, B)


@njit(**CALLEE)
def _stage_tangents(p, node, A, B):
    """Fill the rows of the stage in A and B."""
    b, c = _axes(p)
    for axis, row in ((b, 2), (c, 4)):
        own = row // 2 - 1
        for j in range(2):
            A[row, row + j], A[row + 1, row + j], _ = _tilt_tangent(p, axis, node, j)
        B[row, own], B[row + 1, own], _ = _tilt_tangent(p, axis, node, 2)
        B[row, 1 - own] = p[axis + at.COUPLING] * B[row, own]
        B[row + 1, 1 - own] = p[axis + at.COUPLING] * B[row + 1, own]
