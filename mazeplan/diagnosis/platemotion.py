"""How the plate moved: from the commands through the fitted stage, or from the measured tilt alone.

Through the stage there is no noise of the sensor left; without commands the tilt is smoothed, which a report says.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from mazeplan.data.smoothing import Smoothing, derivatives
from mazeplan.diagnosis.ringsystem import Tilt
from mazeplan.models.ring_dynamics import stage_transition
from mazeplan.models.stage import StageAxis
from mazeplan.records import Array

FINE = 6  # grid points a sample


@njit(cache=True, error_model="numpy")
def _march(target, M, stiffness, damping, start, out):
    """Angle, rate, acceleration (M, 3) of a second-order axis whose target is held over each step."""
    angle, rate = start, 0.0
    for i in range(len(target)):
        rest = target[i]
        out[i, 0], out[i, 1], out[i, 2] = angle, rate, stiffness * (rest - angle) - damping * rate
        gap = angle - rest
        angle, rate = rest + M[0, 0] * gap + M[0, 1] * rate, M[1, 0] * gap + M[1, 1] * rate


def simulated(u: Array, axis: StageAxis, dt: float) -> Array:
    """Angle, rate, acceleration (N FINE, 3) of an axis under commands u (N,), from rest at the first one's target."""
    target = np.repeat(axis.gain * u + axis.offset, FINE)
    out, wn = np.empty((len(target), 3)), axis.natural_frequency
    M = stage_transition(wn, axis.damping, dt / FINE)
    _march(target, M, wn * wn, 2.0 * axis.damping * wn, target[0], out)
    return out


def from_commands(t: Array, u_beta: Array, u_gamma: Array, beta: StageAxis, gamma: StageAxis) -> Tilt:
    """Through the stage; each axis's dead time moves its grid."""
    dt = float(np.median(np.diff(t)))
    grid = t[0] + dt / FINE * np.arange(len(t) * FINE)
    parts = []
    for u, axis in ((u_beta, beta), (u_gamma, gamma)):
        motion = simulated(u, axis, dt)
        shift = axis.dead_time
        parts.append(np.column_stack([np.interp(grid - shift, grid, column) for column in motion.T]))
    return Tilt(grid, np.hstack(parts), "commands, through the fitted stage")


def from_sensor(t: Array, beta: Array, gamma: Array, segment: Array) -> Tilt:
    """From the measured tilt, smoothed."""
    dt, parts = float(np.median(np.diff(t))), []
    for angle in (beta, gamma):
        smooth = derivatives(angle, dt, Smoothing("rts"), segment=segment)
        parts += [smooth.value, smooth.rate, smooth.acceleration]
    motion = np.nan_to_num(np.column_stack(parts))
    grid = t[0] + dt / FINE * np.arange(len(t) * FINE)
    coarse = Tilt(t[0] + dt * np.arange(len(t)), motion, "")
    return Tilt(grid, coarse.at(grid), "the tilt sensor, smoothed")
