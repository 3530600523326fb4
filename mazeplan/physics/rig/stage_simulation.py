"""Simulation of an axis of the stage (`physics.rig.stage`): dead band, gears and servo, exact for held commands."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from mazeplan.core.records import Array, IntArray
from mazeplan.physics.rig.stage import StageAxis

START = np.zeros(1, dtype=np.int64)  # one stretch, from the first sample on


def apply_backlash(u: Array, backlash: float, start: float | None = None) -> Array:
    """Output (N,) of gears with `backlash` rad for commands u (N,). start: output before the first command; by default
    the first command."""
    if backlash == 0.0:
        return u
    return _behind_gears(np.ascontiguousarray(u), 0.5 * backlash, float(u[0] if start is None else start))


@njit(cache=True, error_model="numpy")
def _behind_gears(u, half, at):
    out = np.empty(len(u))
    for i, value in enumerate(u):
        low, high = value - half, value + half
        if low > at:
            at = low
        if high < at:
            at = high
        out[i] = at
    return out


def apply_deadband(u: Array, deadband: float) -> Array:
    """Output (N,) of a servo that ignores changes of the commands u (N,) below `deadband` rad."""
    return _obeyed(np.ascontiguousarray(u), deadband) if deadband else u


@njit(cache=True, error_model="numpy")
def _obeyed(u, deadband):
    out, at = np.empty(len(u)), u[0]
    for i, value in enumerate(u):
        at = value if abs(value - at) >= deadband else at
        out[i] = at
    return out


def actuator_output(u: Array, axis: StageAxis) -> Array:
    """Output (N,) of deadband and gears for commands u (N,)."""
    return apply_backlash(apply_deadband(u, axis.deadband), axis.backlash)


def step_response(axis: StageAxis, t: Array) -> Array:
    """Angle after a unit step of the command at t = 0 (dead time not counted), shape as t; 0 before."""
    w, z = axis.natural_frequency, axis.damping
    late = np.maximum(t, 0.0)
    decay = np.exp(-z * w * late)
    if abs(z - 1.0) < 1e-6:
        rest = decay * (1.0 + w * late)
    elif z < 1.0:
        wd = w * math.sqrt(1.0 - z * z)
        rest = decay * (np.cos(wd * late) + z * w / wd * np.sin(wd * late))
    else:
        root = w * math.sqrt(z * z - 1.0)
        fast, slow = z * w + root, z * w - root
        rest = (fast * np.exp(-slow * late) - slow * np.exp(-fast * late)) / (2.0 * root)
    return np.where(t > 0.0, 1.0 - rest, 0.0)


def simulate_axis(axis: StageAxis, u: Array, dt: float, firsts: IntArray = START) -> Array:
    """Angle (N,) at the samples under commands u (N,), each held from its sample on.

    firsts: indices (K,) at which a stretch begins, ascending from 0

    In each stretch the axis starts at rest at the target of the first command. The response to each change of the
    command is known in closed form. The sum over the changes is a convolution, cut where the response has settled to
    2e-9. A coarser cut would cause steps in the derivatives of a fit."""
    settle = max(0.5, -20.0 / max(pole.real for pole in axis.poles()))
    n = min(len(u), math.ceil((settle + axis.dead_time) / dt) + 1)
    response = step_response(axis, np.arange(n, dtype=np.float64) * dt - axis.dead_time)
    impulse = np.diff(response, prepend=0.0)
    impulse[-1] += 1.0 - response[-1]
    return axis.offset + axis.gain * _convolved(impulse, np.ascontiguousarray(u), firsts)


@njit(cache=True, error_model="numpy")
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
