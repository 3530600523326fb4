"""What a filter knew at the time: angle and rate from the samples up to now, by a Kalman filter."""

from __future__ import annotations

import numpy as np
from numba import njit

from mazeplan.data.smoothing import Noise
from mazeplan.records import Array, IntArray


def causal_estimates(signal: Array, dt: float, noise: Noise, segment: Array | IntArray) -> tuple[Array, Array]:
    """Value and rate (N,), each from the samples of its stretch up to and with its own.

    The model is that of `smoothing` with white jerk: state value, rate, acceleration; noise: its process density
    (unit^2/s^5) and the standard deviation of a sample. NaN samples are passed over."""
    transition = np.array([[1.0, dt, 0.5 * dt * dt], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
    powers = np.array(
        [[dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2], [dt**3 / 6, dt**2 / 2, dt]]
    )
    out = np.full((2, len(signal)), np.nan)
    starts = np.flatnonzero(np.diff(segment, prepend=segment[:1] - 1)).astype(np.int64)
    _run(signal, starts, transition, noise.process * powers, noise.noise**2, out)
    return out[0], out[1]


@njit(cache=True)
def _run(y, starts, F, Q, R, out):
    n = len(y)
    for part in range(len(starts)):
        end = starts[part + 1] if part + 1 < len(starts) else n
        x, P, begun = np.zeros(3), np.zeros((3, 3)), False
        for i in range(starts[part], end):
            if begun:
                x, P = F @ x, F @ P @ F.T + Q
            if np.isfinite(y[i]):
                if not begun:  # nothing is known of rate and acceleration yet: 3 rad/s, 10 rad/s^2
                    x[0], P[0, 0], P[1, 1], P[2, 2], begun = y[i], R, 9.0, 100.0, True
                else:
                    gain = P[:, 0] / (P[0, 0] + R)
                    x, P = x + gain * (y[i] - x[0]), P - np.outer(gain, P[0])
            if begun:
                out[0, i], out[1, i] = x[0], x[1]
