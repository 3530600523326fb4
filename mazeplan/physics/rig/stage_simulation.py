"""Simulation of an axis of the stage (`physics.rig.stage`): steps, dead band, gears and servo.

Held commands are exact. A limited rate needs small steps."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from mazeplan.core.maths.compiled import KERNEL
from mazeplan.core.records import Array, IntArray
from mazeplan.physics.rig.stage import REACHED_S, StageAxis

START = np.zeros(1, dtype=np.int64)  # one stretch, from the first sample on
SUBSTEP = 1.0 / 480.0  # s, largest step with a limited rate
TURNS = 4  # moments of a sample at which gears behind the lag may turn


@njit(**KERNEL)
def _behind_gears(u, half):
    """Output (N,) of gears with the play 2 `half`, rad, for commands u (N,); it begins with the first command."""
    out, at = np.empty(len(u)), u[0]
    for i, value in enumerate(u):
        low, high = value - half, value + half
        if low > at:
            at = low
        if high < at:
            at = high
        out[i] = at
    return out


@njit(**KERNEL)
def _obeyed(u, deadband):
    """Output (N,) of a servo that ignores changes of the commands u (N,) below `deadband`, rad."""
    out, at = np.empty(len(u)), u[0]
    for i, value in enumerate(u):
        at = value if abs(value - at) >= deadband else at
        out[i] = at
    return out


def actuator_output(u: Array, axis: StageAxis) -> Array:
    """Output (N,) of what acts in front of the lag, steps, deadband and gears, for commands u (N,)."""
    if axis.resolution:
        u = np.round(u / axis.resolution) * axis.resolution
    if axis.deadband:
        u = _obeyed(np.ascontiguousarray(u), axis.deadband)
    if axis.backlash and not axis.behind:
        u = _behind_gears(np.ascontiguousarray(u), 0.5 * axis.backlash)
    return u


def step_response(axis: StageAxis, t: Array) -> Array:
    """Angle after a unit step of the command at t = 0 (dead time not counted), shape as t; 0 before."""
    w, z = axis.natural_frequency, axis.damping
    late = np.maximum(t, 0.0)
    if axis.order == 0:
        rest = np.zeros_like(late)
    elif axis.order == 1:
        rest = np.exp(-w * late)
    elif abs(z - 1.0) < 1e-6:
        rest = np.exp(-z * w * late) * (1.0 + w * late)
    elif z < 1.0:
        wd = w * math.sqrt(1.0 - z * z)
        rest = np.exp(-z * w * late) * (np.cos(wd * late) + z * w / wd * np.sin(wd * late))
    else:
        root = w * math.sqrt(z * z - 1.0)
        fast, slow = z * w + root, z * w - root
        rest = (fast * np.exp(-slow * late) - slow * np.exp(-fast * late)) / (2.0 * root)
    return np.where(t > 0.0, 1.0 - rest, 0.0)


def simulate_axis(axis: StageAxis, u: Array, dt: float, firsts: IntArray = START) -> Array:
    """Angle (N,) at the samples under commands u (N,), each held from its sample on.

    firsts: indices (K,) at which a stretch begins, ascending from 0

    In each stretch the axis starts at rest at the target of the first command, in the middle of its gears. Without a
    limited rate and gears behind the lag, the response to
    each change of the command is known in closed form. The sum over the changes is a convolution, cut where the
    response has settled to 2e-9. A coarser cut would cause steps in the derivatives of a fit."""
    u = np.ascontiguousarray(u)
    if axis.behind and axis.backlash:
        return fine_motion(axis, u, dt, TURNS, firsts)[::TURNS, 0]
    if math.isfinite(axis.rate_limit):
        return fine_motion(axis, u, dt, 1, firsts)[:, 0]
    settle = max(0.5, 20.0 / axis.slowest())
    n = min(len(u), math.ceil((settle + axis.dead_time) / dt) + 1)
    response = step_response(axis, np.arange(n, dtype=np.float64) * dt - axis.dead_time)
    impulse = np.diff(response, prepend=0.0)
    impulse[-1] += 1.0 - response[-1]
    return axis.offset + axis.gain * _convolved(impulse, u, firsts)


def fine_motion(axis: StageAxis, u: Array, dt: float, per: int, firsts: IntArray = START) -> Array:
    """Angle, rate, acceleration (N per, 3) of an axis at `per` moments of each sample, under commands u (N,).

    Shapes and start as in `simulate_axis`."""
    parts = max(math.ceil(dt / per / SUBSTEP), 1)
    h = dt / per / parts
    target = axis.gain * np.ascontiguousarray(u) + axis.offset
    M, numbers = axis.transition(h), np.array([axis.natural_frequency, axis.damping, axis.rate_limit])
    late = round(axis.dead_time / h)
    rest = axis.dead_time - late * h  # of the dead time, s: less than a step, by interpolation
    out = np.empty((len(u) * per, 3))
    _march(target, M, axis.order, numbers, late, rest, h, per * parts, parts, firsts, out)
    if axis.behind and axis.backlash:
        _with_play(out, 0.5 * axis.backlash, firsts * per)
    return out


@njit(**KERNEL)
def _with_play(motion, half, firsts):
    """Motion (M, 3) of servos -> that of the plate behind gears: it stands while the servo turns in the play."""
    for j in range(len(firsts)):
        at = motion[firsts[j], 0]
        for i in range(firsts[j], firsts[j + 1] if j + 1 < len(firsts) else len(motion)):
            row = motion[i]
            new = min(max(at, row[0] - half), row[0] + half)
            if new == at:
                row[1] = row[2] = 0.0
            at = row[0] = new


@njit(**KERNEL)
def _march(target, M, order, numbers, late, rest, h, steps, parts, firsts, out):
    """March an axis in steps of h s, `steps` for each target (N,); a row of out for each `parts` of them.

    late: dead time in steps; rest: dead time beyond them, s"""
    w, zeta, limit = numbers[0], numbers[1], numbers[2]
    for j in range(len(firsts)):
        first, end = firsts[j], firsts[j + 1] if j + 1 < len(firsts) else len(target)
        angle, rate = target[first], 0.0
        for i in range((end - first) * steps):
            at = max(i - late, 0) // steps
            aim = target[first + at]
            away = angle - aim
            if i % parts == 0:
                a = -w * w * away - 2.0 * zeta * w * rate if order == 2 else 0.0  # as `StageAxis.acceleration`
                a = min(max(a, (-limit - rate) / REACHED_S), (limit - rate) / REACHED_S)
                row = out[(first * steps + i) // parts]
                row[0], row[1], row[2] = angle - rest * rate, rate, a
            rate_new = M[1, 0] * away + M[1, 1] * rate
            new = aim + M[0, 0] * away + M[0, 1] * rate
            if abs(new - angle) > limit * h:
                new = angle + (limit * h if new > angle else -limit * h)
                rate_new = limit if new > angle else -limit
            if order == 0:
                rate_new = (new - angle) / h if limit < math.inf else 0.0
            angle, rate = new, rate_new


@njit(**KERNEL)
def _convolved(impulse, u, firsts):
    """Each stretch of u (N,) from its first value on, convolved with an impulse response (n,)."""
    out = np.empty(len(u))
    for j in range(len(firsts)):
        first, end = firsts[j], firsts[j + 1] if j + 1 < len(firsts) else len(u)
        change, angle = u[first:end] - u[first], out[first:end]
        angle[:] = u[first]
        for k in range(min(len(impulse), len(change))):
            earlier, later = change[: len(change) - k], angle[k:]
            for i in range(len(later)):  # this order of loops compiles to vector instructions
                later[i] += impulse[k] * earlier[i]
    return out
