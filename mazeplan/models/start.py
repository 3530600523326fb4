"""Where a roll-out begins: angle and rate as a filter with a model knew them, from samples up to then and no later.

An extended Kalman filter over the last PAST samples, for all windows side by side: the model says how the ball is
accelerated, the camera where it is. A filter without a model would have to find the acceleration in the noise, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mazeplan.models.samples import RingSamples, pick
from mazeplan.physics.arrays import RingKinematics
from mazeplan.records import Array, IntArray

PAST = 45  # samples; 1.5 s at 30 Hz
FIRST = 4  # samples apart, whose difference is the first guess of the rate
MEMORY = 0.1  # s for which an error of the model lasts


def angle_noise(samples: RingSamples) -> float:
    """Standard deviation (rad) of a measured angle, from third differences, robust against impacts."""
    rough = np.diff(samples.measured, n=3)[np.diff(samples.segment)[2:] == 0] if len(samples) > 3 else np.zeros(0)
    rough = rough[np.isfinite(rough)]
    return 1.4826 * float(np.median(np.abs(rough))) / math.sqrt(20.0) if len(rough) else 0.0  # 1, 3, 3, 1


def causal_start(
    accelerate: Callable[[RingKinematics], Array], samples: RingSamples, start: IntArray, noise: float, misfit: float
) -> tuple[Array, Array]:
    """Angle and rate (W,) at rows `start`. noise: of a measured angle, rad; misfit: rms error of the model, rad/s^2."""
    return causal_estimate(accelerate, samples, start, noise, misfit)[:2]


def causal_estimate(
    accelerate: Callable[[RingKinematics], Array], samples: RingSamples, start: IntArray, noise: float, misfit: float
) -> tuple[Array, Array, Array]:
    """The same, and how well it is known: covariance (W, 2, 2) of angle and rate."""
    dt, R = samples.dt, max(noise, 1e-5) ** 2
    first = np.maximum(start - PAST, np.searchsorted(samples.segment, samples.segment[start]))
    ahead = np.minimum(first + FIRST, start)
    theta = samples.measured[first].copy()
    rate = (samples.measured[ahead] - theta) / (dt * np.maximum(ahead - first, 1))
    P = np.zeros((len(start), 2, 2))
    P[:, 0, 0], P[:, 1, 1] = R, 2.0 * R / (FIRST * dt) ** 2 + (misfit * FIRST * dt) ** 2
    F = np.array([[1.0, dt], [0.0, 1.0]])
    Q = 2.0 * MEMORY * misfit**2 * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    for i in range(PAST):
        row = first + i
        on = row < start
        if not on.any():
            break
        now, following = np.minimum(row, start), np.minimum(row + 1, start)
        push = accelerate(replace(pick(samples.k, now), theta=theta, theta_dot=rate))
        predicted, faster = theta + dt * rate + 0.5 * dt * dt * push, rate + dt * push
        P_ahead = F @ P @ F.T + Q
        gain = P_ahead[:, :, 0] / (P_ahead[:, 0, 0] + R)[:, None]
        innovation = samples.measured[following] - predicted
        theta = np.where(on, predicted + gain[:, 0] * innovation, theta)
        rate = np.where(on, faster + gain[:, 1] * innovation, rate)
        P = np.where(on[:, None, None], P_ahead - gain[:, :, None] * P_ahead[:, :1, :], P)
    return theta, rate, P
