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
of 40 steps by less than 1e-3 rad at its end. One sub-step instead of two would be off by ten times as much and save
a quarter of the planning time.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from mazeplan.errors import ModelError
from mazeplan.models import surface
from mazeplan.models.surface import force, slope
from mazeplan.records import Array

if TYPE_CHECKING:
    from mazeplan.models.modelfile import RigModel

GRAVITY = 9.81  # m/s^2
SUBSTEPS = 2
ROLLING_BETWEEN_FLOOR_AND_WALL = 5.0 / 9.0  # 1 / (1 + 2 * 2/5): a solid sphere that turns on floor and wall at once

_DRIVE, _VISCOUS, _DRY, _WIDTH, _BETA_0, _GAMMA_0, _STEP, _SUBSTEPS, EXTRA, BY_ANGLE, BY_RATE, _AXES = range(12)
_GAIN, _OFFSET, _STIFFNESS, _DAMPING, _TABLE = range(5)
_NODE = 4  # the entries of a 2x2 transition matrix in the table


def _positive(name: str, value: float) -> None:
    if not 0.0 < value < math.inf:
        raise ModelError(f"got {value}, expected a number > 0", key=name)


def _finite(name: str, value: float) -> None:
    if not math.isfinite(value):
        raise ModelError(f"got {value}, expected a finite number", key=name)


@dataclass(frozen=True)
class AxisParameters:
    """One axis of the stage, second order. gain: -; natural_frequency: rad/s; damping: ratio; offset: rad."""

    gain: float = 1.0
    natural_frequency: float = 26.0
    damping: float = 0.9
    offset: float = 0.0

    def __post_init__(self) -> None:
        _positive("stage gain", self.gain)
        _positive("stage natural_frequency", self.natural_frequency)
        _positive("stage damping", self.damping)
        _finite("stage offset", self.offset)


@dataclass(frozen=True)
class RingParameters:
    """Everything the step needs.

    radius: m, where the ball's centre travels; rolling_factor: times the gravity part; viscous: 1/s; dry: rad/s^2;
    dry_width: rad/s over which dry friction changes sign; offset_beta, offset_gamma: tilt of the table, rad;
    beta, gamma: the stage; dt: s; gravity: m/s^2; physics: False leaves only what the turning plate does, for models
    that learned all the rest; surface: what the floor adds, as `surface.pack` has it, or empty. Raises ModelError for
    values out of range.
    """

    radius: float
    rolling_factor: float = ROLLING_BETWEEN_FLOOR_AND_WALL
    viscous: float = 0.0
    dry: float = 0.0
    dry_width: float = 0.1
    offset_beta: float = 0.0
    offset_gamma: float = 0.0
    beta: AxisParameters = AxisParameters()
    gamma: AxisParameters = AxisParameters()
    dt: float = 1.0 / 30.0
    gravity: float = GRAVITY
    physics: bool = True
    surface: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("radius", "rolling_factor", "dry_width", "dt", "gravity"):
            _positive(name, getattr(self, name))
        for name in ("viscous", "dry"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ModelError(f"got {getattr(self, name)}, expected a number >= 0", key=name)
        for name in ("offset_beta", "offset_gamma"):
            _finite(name, getattr(self, name))

    @classmethod
    def from_model(cls, model: RigModel, ring: int, radius: float) -> RingParameters:
        """The parameters of a fitted model for one ring, at its track radius (m)."""
        ball = model.ball(ring)
        axes = [
            AxisParameters(axis.gain, axis.natural_frequency, axis.damping, axis.offset)
            for axis in (model.true_stage.beta, model.true_stage.gamma)
        ]
        return cls(
            radius=radius,
            rolling_factor=ball.parameter("rolling_inertia", "factor", 1.0),
            viscous=max(0.0, ball.parameter("viscous_friction", "coefficient", 0.0)),
            dry=max(0.0, ball.parameter("dry_friction", "coefficient", 0.0)),
            offset_beta=ball.parameter("tilt_offset", "beta", 0.0),
            offset_gamma=ball.parameter("tilt_offset", "gamma", 0.0),
            beta=axes[0],
            gamma=axes[1],
            physics=not (model.kind == "np" and ring in model.processes),
            surface=tuple(surface.pack(ball)),
        )

    def pack(self) -> Array:
        """The vector that the compiled functions read: ball, integration, then per axis its numbers and its table of
        transition matrices at 0, 1/2, 1, 3/2 ... SUBSTEPS integration steps, then what the floor adds."""
        on = 1.0 if self.physics else 0.0
        ball = [
            on * self.rolling_factor * self.gravity / self.radius,
            on * self.viscous,
            on * self.dry,
            self.dry_width,
            self.offset_beta,
            self.offset_gamma,
            self.dt / SUBSTEPS,
            SUBSTEPS,
            0.0,  # EXTRA
            0.0,  # BY_ANGLE, BY_RATE: scratch space of `linearise`
            0.0,
        ]
        axes = [number for axis in (self.beta, self.gamma) for number in _pack_axis(axis, self.dt)]
        return np.array(ball + axes + list(self.surface or np.zeros(surface.SIZE)), dtype=float)


def _pack_axis(axis: AxisParameters, dt: float) -> list[float]:
    wn = axis.natural_frequency
    numbers = [axis.gain, axis.offset, wn * wn, 2.0 * axis.damping * wn]
    for node in range(2 * SUBSTEPS + 1):
        numbers.extend(stage_transition(wn, axis.damping, 0.5 * node * dt / SUBSTEPS).ravel())
    return numbers


def stage_transition(wn: float, zeta: float, t: float) -> Array:
    """exp(M t) of M = [[0, 1], [-wn^2, -2 zeta wn]], shape (2, 2), for any damping.

    exp(M t) = exp(-zeta wn t) [cosh(mu t) I + sinh(mu t)/mu (M + zeta wn I)],  mu = wn sqrt(zeta^2 - 1).
    """
    mu = wn * cmath.sqrt(complex(zeta * zeta - 1.0))
    slope = t if abs(mu * t) < 1e-9 else (cmath.sinh(mu * t) / mu).real
    rest = np.array([[zeta * wn, 1.0], [-wn * wn, -zeta * wn]])
    return math.exp(-zeta * wn * t) * (cmath.cosh(mu * t).real * np.eye(2) + slope * rest)


@njit(cache=True, error_model="numpy", inline="always")
def _tilt(p, axis, node, angle, rate, u):
    """Angle, rate and acceleration of one axis (its block in p) at a node of its table, from its start and command."""
    at = axis + _TABLE + _NODE * node
    rest = p[axis + _GAIN] * u + p[axis + _OFFSET]
    a = rest + p[at] * (angle - rest) + p[at + 1] * rate
    r = p[at + 2] * (angle - rest) + p[at + 3] * rate
    return a, r, p[axis + _STIFFNESS] * (rest - a) - p[axis + _DAMPING] * r


@njit(cache=True, error_model="numpy", inline="always")
def _axes(p):
    """Where the two axes begin in p."""
    size = _TABLE + _NODE * (2 * int(p[_SUBSTEPS]) + 1)
    return _AXES, _AXES + size


@njit(cache=True, error_model="numpy", inline="always")
def _surface(p):
    """Where what the floor adds begins in p."""
    return _AXES + 2 * (_TABLE + _NODE * (2 * int(p[_SUBSTEPS]) + 1))


@njit(cache=True, error_model="numpy", inline="always")
def _node(p, s, u, node):
    """The plate at a node as the ball feels it: beta_d, beta_dd, gamma_d, sin and cos of gamma, beta', gamma'."""
    b, c = _axes(p)
    beta, beta_d, beta_dd = _tilt(p, b, node, s[2], s[3], u[0])
    gamma, gamma_d, _ = _tilt(p, c, node, s[4], s[5], u[1])
    beta_g, gamma_g = beta + p[_BETA_0], gamma + p[_GAMMA_0]
    return (
        beta_d,
        beta_dd,
        gamma_d,
        math.sin(gamma),
        math.cos(gamma),
        math.sin(beta_g),
        math.cos(beta_g),
        math.sin(gamma_g),
        math.cos(gamma_g),
    )


@njit(cache=True, error_model="numpy", inline="always")
def _acceleration(p, plate, theta, theta_d):
    """theta_dd with the plate as at a node."""
    beta_d, beta_dd, gamma_d, sin_c, cos_c, sin_bg, cos_bg, sin_cg, _ = plate
    sin, cos = math.sin(theta), math.cos(theta)
    turning = beta_dd * sin_c + 2.0 * beta_d * gamma_d * cos_c * sin * sin
    centripetal = (gamma_d * gamma_d - beta_d * beta_d * cos_c * cos_c) * sin * cos
    gravity = -p[_DRIVE] * (sin_bg * sin + sin_cg * cos_bg * cos)
    friction = p[_VISCOUS] * theta_d + p[_DRY] * math.tanh(theta_d / p[_WIDTH])
    total = turning + centripetal + gravity - friction + p[EXTRA]
    at = _surface(p)
    if p[at] != 0.0:
        total += force(p, at, theta)
    return total


@njit(cache=True, error_model="numpy", inline="always")
def _partials(p, plate, theta, theta_d):
    """Derivatives of theta_dd at a node by theta, theta_d, beta, beta_d, beta_dd, gamma, gamma_d."""
    beta_d, beta_dd, gamma_d, sin_c, cos_c, sin_bg, cos_bg, sin_cg, cos_cg = plate
    sin, cos = math.sin(theta), math.cos(theta)
    drive, tanh = p[_DRIVE], math.tanh(theta_d / p[_WIDTH])
    centripetal = gamma_d * gamma_d - beta_d * beta_d * cos_c * cos_c
    at, floor = _surface(p), 0.0
    if p[at] != 0.0:
        floor = slope(p, at, theta)
    return (
        4.0 * beta_d * gamma_d * cos_c * sin * cos
        + centripetal * (cos * cos - sin * sin)
        - drive * (sin_bg * cos - sin_cg * cos_bg * sin)
        + floor,
        -p[_VISCOUS] - p[_DRY] / p[_WIDTH] * (1.0 - tanh * tanh),
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
    h, n = p[_STEP], int(p[_SUBSTEPS])
    theta, theta_d = s[0], s[1]
    last = _node(p, s, u, 0)
    for i in range(n):
        first, middle, last = last, _node(p, s, u, 2 * i + 1), _node(p, s, u, 2 * i + 2)
        a1 = _acceleration(p, first, theta, theta_d)
        d2 = theta_d + 0.5 * h * a1
        a2 = _acceleration(p, middle, theta + 0.5 * h * theta_d, d2)
        d3 = theta_d + 0.5 * h * a2
        a3 = _acceleration(p, middle, theta + 0.5 * h * d2, d3)
        a4 = _acceleration(p, last, theta + h * d3, theta_d + h * a3)
        theta += h * theta_d + h * h / 6.0 * (a1 + a2 + a3)
        theta_d += h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
    b, c = _axes(p)
    beta, beta_d, _ = _tilt(p, b, 2 * n, s[2], s[3], u[0])
    gamma, gamma_d, _ = _tilt(p, c, 2 * n, s[4], s[5], u[1])
    out[0], out[1], out[2], out[3], out[4], out[5] = theta, theta_d, beta, beta_d, gamma, gamma_d


@njit(cache=True, error_model="numpy")
def _tilt_tangent(p, axis, node, column):
    """Derivatives of angle, rate, acceleration at a node by the axis's start angle (column 0), rate (1), command
    (2)."""
    at = axis + _TABLE + _NODE * node
    rest = 0.0
    if column == 2:
        rest = p[axis + _GAIN]
        a, r = rest * (1.0 - p[at]), -rest * p[at + 2]
    else:
        a, r = p[at + column], p[at + 2 + column]
    return a, r, p[axis + _STIFFNESS] * (rest - a) - p[axis + _DAMPING] * r


@njit(cache=True, error_model="numpy")
def _forced(p, f, node, column):
    """Change of theta_dd at a node through the tilt, by column: 0, 1 theta and its rate (none), 2-4 beta's start angle,
    start rate, command, 5-7 gamma's, 8 the part held over the step."""
    if column < 2:
        return 0.0
    if column == 8:
        return 1.0
    b, c = _axes(p)
    if column < 5:
        a, r, rr = _tilt_tangent(p, b, node, column - 2)
        return f[2] * a + f[3] * r + f[4] * rr
    a, r, _ = _tilt_tangent(p, c, node, column - 5)
    return f[5] * a + f[6] * r


@njit(cache=True, error_model="numpy")
def _advance_tangent(p, h, node, f1, f2, f3, f4, column, d, dd):
    """Carry the tangent (d, dd) of (theta, theta_d) in one column through one Runge-Kutta step."""
    middle2, middle3 = _forced(p, f2, node + 1, column), _forced(p, f3, node + 1, column)
    a1 = f1[0] * d + f1[1] * dd + _forced(p, f1, node, column)
    r2 = dd + 0.5 * h * a1
    a2 = f2[0] * (d + 0.5 * h * dd) + f2[1] * r2 + middle2
    r3 = dd + 0.5 * h * a2
    a3 = f3[0] * (d + 0.5 * h * r2) + f3[1] * r3 + middle3
    a4 = f4[0] * (d + h * r3) + f4[1] * (dd + h * a3) + _forced(p, f4, node + 2, column)
    return d + h * dd + h * h / 6.0 * (a1 + a2 + a3), dd + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)


@njit(cache=True, error_model="numpy")
def linearise(s, u, p, out, A, B):
    """`step`, and its derivatives by s and u, into A (6, 6) and B (6, 2): the chain rule through the scheme.

    Those of angle and rate by p[EXTRA] are left in p[BY_ANGLE] and p[BY_RATE]."""
    h, n = p[_STEP], int(p[_SUBSTEPS])
    A[:] = 0.0
    B[:] = 0.0
    A[0, 0] = A[1, 1] = 1.0
    theta, theta_d, by_angle, by_rate = s[0], s[1], 0.0, 0.0
    last = _node(p, s, u, 0)
    for i in range(n):
        first, middle, last = last, _node(p, s, u, 2 * i + 1), _node(p, s, u, 2 * i + 2)
        a1 = _acceleration(p, first, theta, theta_d)
        d2 = theta_d + 0.5 * h * a1
        t2 = theta + 0.5 * h * theta_d
        a2 = _acceleration(p, middle, t2, d2)
        d3 = theta_d + 0.5 * h * a2
        t3 = theta + 0.5 * h * d2
        a3 = _acceleration(p, middle, t3, d3)
        d4, t4 = theta_d + h * a3, theta + h * d3
        f1 = _partials(p, first, theta, theta_d)
        f2 = _partials(p, middle, t2, d2)
        f3 = _partials(p, middle, t3, d3)
        f4 = _partials(p, last, t4, d4)
        for j in range(8):  # columns as in _forced: six states and two commands, the commands behind their axis
            if j == 4 or j == 7:
                k = 0 if j == 4 else 1
                B[0, k], B[1, k] = _advance_tangent(p, h, 2 * i, f1, f2, f3, f4, j, B[0, k], B[1, k])
            else:
                k = j if j < 4 else j - 1
                A[0, k], A[1, k] = _advance_tangent(p, h, 2 * i, f1, f2, f3, f4, j, A[0, k], A[1, k])
        by_angle, by_rate = _advance_tangent(p, h, 2 * i, f1, f2, f3, f4, 8, by_angle, by_rate)
        a4 = _acceleration(p, last, t4, d4)
        theta += h * theta_d + h * h / 6.0 * (a1 + a2 + a3)
        theta_d += h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
    out[0], out[1] = theta, theta_d
    out[2], out[3], _ = _tilt(p, _axes(p)[0], 2 * n, s[2], s[3], u[0])
    out[4], out[5], _ = _tilt(p, _axes(p)[1], 2 * n, s[4], s[5], u[1])
    p[BY_ANGLE], p[BY_RATE] = by_angle, by_rate
    _stage_tangents(p, 2 * n, A, B)


@njit(cache=True, error_model="numpy")
def _stage_tangents(p, node, A, B):
    """The rows of the stage in A and B."""
    b, c = _axes(p)
    for axis, row in ((b, 2), (c, 4)):
        for j in range(2):
            A[row, row + j], A[row + 1, row + j], _ = _tilt_tangent(p, axis, node, j)
        B[row, row // 2 - 1], B[row + 1, row // 2 - 1], _ = _tilt_tangent(p, axis, node, 2)
