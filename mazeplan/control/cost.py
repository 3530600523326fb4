"""Cost of a motion along one ring, compiled, with analytic derivatives.

The errors are e = theta - theta*, v = theta_dot - theta_dot* and c = lean(s) - lean*. Each step costs

    w_theta past(e) phi(e; a_theta) + [w_speed + w_arrival zone(e)] phi(v; a_speed) + w_lean phi(c; a_lean)
    + 1/2 w_rate (beta_dot^2 + gamma_dot^2) + w_u sum_i [cosh(u_i / scale) - 1]

The final state costs the first line again, with the final weights but the same w_arrival. phi is the smooth absolute
value

    phi(e; a) = sqrt(e^2 + a^2) - a        (near e = 0: e^2 / 2a)

The absolute value pulls equally strongly at any distance from the goal, which makes the motion near time-optimal. cosh
is quadratic for small commands and steep towards the limit. Both are from Tassa, Erez, Todorov, IROS 2012.

    lean(s) = sin(beta) cos(theta) - sin(gamma) cos(beta) sin(theta)

is the outward acceleration over g. A positive lean pushes the ball against the outer wall, a negative one against the
inner wall. The Hessians leave out the curvature of lean(s) and of zone(e) (Gauss-Newton), so they are all positive
semidefinite. All gradients are exact.

If theta_dot* = 0, the ball stops at the goal: past = 1 and zone = 0. Otherwise the ball passes the goal at this speed:

    past(e)   behind the goal, in the direction of travel, a small fraction: the angle does not call the ball back
    zone(e)   exp(-e^2 / 2 z^2): the speed counts near the goal, and the ball may be fast on the way there

theta - theta* is the plain difference: the caller moves theta* to the right turn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from mazeplan.core.field_checks import check_numbers
from mazeplan.core.maths.compiled import CALLEE, KERNEL
from mazeplan.core.records import Array

_THETA, _SPEED, _ARRIVAL, _LEAN, _RATE, _CONTROL, _SCALE, _A_THETA, _A_SPEED, _A_LEAN = range(10)
_ZONE, _PAST, _F_THETA, _F_SPEED, _F_LEAN, _GOAL, _GOAL_SPEED, _GOAL_LEAN = range(10, 18)
_PACKED = (
    *("theta", "speed", "arrival", "lean", "rate", "control", "control_scale", "width_theta", "width_speed"),
    *("width_lean", "arrival_zone", "past", "final_theta", "final_speed", "final_lean"),
)  # in this order


@dataclass(frozen=True, kw_only=True)
class CostParameters:
    """All settings of the cost: weights of each step and of the last state, shapes of the penalties, and how the price
    of speed depends on the delay (`seen_late`). Raises SettingsError for a negative value.

    With the defaults and 5 degrees of tilt, a ball travels pi/4 along ring 2 of the packaged map in 0.65 s, without
    overshoot."""

    theta: float = 1.0  # weight of the angle error, 1/rad
    speed: float = 0.1  # of the speed error, s/rad
    arrival: float = 0.2  # in addition, of the speed error near the goal, s/rad
    lean: float = 1.0  # of the lean error, 1/rad
    rate: float = 0.0  # of the tilt rates, (s/rad)^2
    control: float = 0.003  # of the commands, no unit
    control_scale: float = 0.06  # scale of the commands in cosh, rad
    width_theta: float = 0.03  # widths a of the smooth absolute values, rad, rad/s, rad
    width_speed: float = 0.2
    width_lean: float = 0.02
    arrival_zone: float = 0.06  # width z of the zone around the goal, rad
    past: float = 0.05  # factor of the angle's weight behind the goal
    final_theta: float = 5.0
    final_speed: float = 0.5
    final_lean: float = 0.0
    prompt: float = 1.0
    prompt_s: float = 0.0
    late_s: float = 0.06

    def __post_init__(self) -> None:
        widths = ("width_theta", "width_speed", "width_lean", "arrival_zone")
        check_numbers(self, positive=("control", "control_scale", "late_s", *widths))

    def seen_late(self, late_s: float) -> CostParameters:
        """The cost for a rig whose commands act `late_s` s after the measurement.

        During the delay the ball moves unseen by its speed times the delay, so surprises cost more. Therefore the
        price of speed grows with the delay: from the share `prompt` for delays up to `prompt_s` to the full price from
        the field `late_s` on."""
        begin = min(self.prompt_s, self.late_s)
        late = min(max(late_s - begin, 0.0) / max(self.late_s - begin, 1e-9), 1.0)
        return replace(self, speed=(self.prompt + (1.0 - self.prompt) * late) * self.speed)

    def pack(self, goal_theta: float, goal_theta_dot: float = 0.0, lean: float = 0.0) -> Array:
        """The vector for the compiled functions: the weights, then the targets (rad, rad/s, rad)."""
        weights = [float(getattr(self, name)) for name in _PACKED]
        return np.array([*weights, goal_theta, goal_theta_dot, lean])


@njit(**KERNEL)
def lean_of(theta, beta, gamma):
    """Outward acceleration over g at angle theta."""
    return math.sin(beta) * math.cos(theta) - math.sin(gamma) * math.cos(beta) * math.sin(theta)


@njit(**KERNEL)
def penalty(e, a):
    """(phi, phi', phi'') of an error e with width a."""
    root = math.sqrt(e * e + a * a)
    return e * e / (root + a), e / root, a * a / (root * root * root)


@njit(**CALLEE)
def _theta_weight(e, q):
    """Factor of the angle's weight: below 1 behind a goal that the ball passes at speed."""
    return q[_PAST] if e * q[_GOAL_SPEED] > 0.0 else 1.0


@njit(**CALLEE)
def _arrival(e, q):
    """Additional weight of the speed near a goal that the ball passes at speed."""
    return 0.0 if q[_GOAL_SPEED] == 0.0 else q[_ARRIVAL] * math.exp(-0.5 * e * e / (q[_ZONE] * q[_ZONE]))


@njit(**CALLEE)
def _state_cost(s, q, theta, speed, lean):
    """Cost of the three errors with the given weights."""
    e = s[0] - q[_GOAL]
    cost = theta * _theta_weight(e, q) * penalty(e, q[_A_THETA])[0]
    cost += (speed + _arrival(e, q)) * penalty(s[1] - q[_GOAL_SPEED], q[_A_SPEED])[0]
    if lean > 0.0:
        cost += lean * penalty(lean_of(s[0], s[2], s[4]) - q[_GOAL_LEAN], q[_A_LEAN])[0]
    return cost


@njit(**CALLEE)
def _state_derivatives(s, q, theta, speed, lean, lx, lxx):
    """Gradient (6,) and Gauss-Newton Hessian (6, 6) of `_state_cost`."""
    lx[:] = 0.0
    lxx[:] = 0.0
    e = s[0] - q[_GOAL]
    _, d, dd = penalty(e, q[_A_THETA])
    weight = theta * _theta_weight(e, q)
    lx[0], lxx[0, 0] = weight * d, weight * dd
    near = _arrival(e, q)
    c, d, dd = penalty(s[1] - q[_GOAL_SPEED], q[_A_SPEED])
    lx[0] -= near * c * e / (q[_ZONE] * q[_ZONE])
    lx[1], lxx[1, 1] = (speed + near) * d, (speed + near) * dd
    if lean > 0.0:
        sin, cos = math.sin(s[0]), math.cos(s[0])
        sin_b, cos_b, sin_c, cos_c = math.sin(s[2]), math.cos(s[2]), math.sin(s[4]), math.cos(s[4])
        _, d, dd = penalty(sin_b * cos - sin_c * cos_b * sin - q[_GOAL_LEAN], q[_A_LEAN])
        by_theta = -sin_b * sin - sin_c * cos_b * cos
        by_beta, by_gamma = cos_b * cos + sin_c * sin_b * sin, -cos_c * cos_b * sin
        d, dd = lean * d, lean * dd
        lx[0] += d * by_theta
        lx[2] += d * by_beta
        lx[4] += d * by_gamma
        lxx[0, 0] += dd * by_theta * by_theta
        lxx[2, 2] += dd * by_beta * by_beta
        lxx[4, 4] += dd * by_gamma * by_gamma
        lxx[0, 2] = lxx[2, 0] = dd * by_theta * by_beta
        lxx[0, 4] = lxx[4, 0] = dd * by_theta * by_gamma
        lxx[2, 4] = lxx[4, 2] = dd * by_beta * by_gamma


@njit(**KERNEL)
def running(k, s, u, q):
    """Cost of step k (the same for every k)."""
    cost = _state_cost(s, q, q[_THETA], q[_SPEED], q[_LEAN]) + 0.5 * q[_RATE] * (s[3] * s[3] + s[5] * s[5])
    return cost + q[_CONTROL] * (math.cosh(u[0] / q[_SCALE]) + math.cosh(u[1] / q[_SCALE]) - 2.0)


@njit(**KERNEL)
def running_derivatives(k, s, u, q, lx, lu, lxx, luu):
    """Gradients (6,), (2,) and Hessians (6, 6), (2, 2) of `running`, which has no mixed term of state and control."""
    _state_derivatives(s, q, q[_THETA], q[_SPEED], q[_LEAN], lx, lxx)
    lx[3], lx[5] = q[_RATE] * s[3], q[_RATE] * s[5]
    lxx[3, 3] = lxx[5, 5] = q[_RATE]
    scale, weight = q[_SCALE], q[_CONTROL]
    luu[0, 1] = luu[1, 0] = 0.0
    for i in range(2):
        lu[i] = weight / scale * math.sinh(u[i] / scale)
        luu[i, i] = weight / (scale * scale) * math.cosh(u[i] / scale)


@njit(**KERNEL)
def final(s, q):
    """Cost of the last state."""
    return _state_cost(s, q, q[_F_THETA], q[_F_SPEED], q[_F_LEAN])


@njit(**KERNEL)
def final_derivatives(s, q, lx, lxx):
    """Gradient (6,) and Gauss-Newton Hessian (6, 6) of `final`."""
    _state_derivatives(s, q, q[_F_THETA], q[_F_SPEED], q[_F_LEAN], lx, lxx)
