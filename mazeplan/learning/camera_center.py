"""A camera that counts the angle about a point other than the centre of the rings.

With the ball at angle phi of a ring of radius R about C, and the camera's centre at C - R (x, y),

    theta = arg(e^(i phi) + x + i y),    d theta/d phi = (1 + x cos phi + y sin phi) / |e^(i phi) + x + i y|^2

Gravity, openings and walls depend on phi, so a model in theta must learn a distortion of each term. The centre is found
by minimising the residual of a linear model of the acceleration in phi. Models are fitted in phi. Errors are reported
in theta.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize

from mazeplan.core.records import Array, IntArray
from mazeplan.learning.features import wall_features
from mazeplan.learning.samples import RingSamples, delayed
from mazeplan.learning.smoothing import Smoothing, acceleration_kernel, derivatives

FURTHEST = 0.4  # maximum distance of the centre, radii
MIN_GAIN = 30.0  # minimum gain of -2 log L by a centre, after the penalty
MAX_SPREAD = 0.02  # maximum rms difference of accelerations that one smoothing made, over their spread
WINDOWS = (5, 7, 9, 11)  # samples, of a Savitzky-Golay smoothing of order 2
MIN_ROWS = 100  # minimum number of rows
AGREED = 0.15  # radii; maximum difference of the centre by half of the rows from that by all rows
BLOCK_S = 10.0  # s
TAIL = 0.02  # share of residuals that is clipped at either end, for impacts


@dataclass(frozen=True)
class Centre:
    """The centre of the rings as the camera sees it, in radii of the ring."""

    x: float
    y: float

    def seen(self, phi: Array) -> Array:
        """theta of a ball at phi; on the same turn."""
        c, s = np.cos(phi), np.sin(phi)
        return phi + np.arctan2(self.y * c - self.x * s, 1.0 + self.x * c + self.y * s)

    def straight(self, theta: Array) -> Array:
        """phi of a ball that is seen at theta; on the same turn."""
        c, s = np.cos(theta), np.sin(theta)
        across = self.x * s - self.y * c  # sin(phi - theta)
        return theta + np.arcsin(np.clip(across, -1.0, 1.0))

    def slope(self, theta: Array) -> Array:
        """d phi / d theta."""
        c, s = np.cos(theta), np.sin(theta)
        across = self.x * s - self.y * c
        return 1.0 + (self.x * c + self.y * s) / np.sqrt(np.maximum(1.0 - across**2, 1e-6))


def straightened(samples: RingSamples, centre: Centre, rates: str, smoothing: Smoothing) -> RingSamples:
    """The samples with phi in place of theta; rates: see `SampleOptions`."""
    measured = centre.straight(samples.measured)
    smooth = derivatives(measured, samples.dt, smoothing, segment=samples.segment)
    if rates == "smoothed":
        rate = samples.k.theta_dot * centre.slope(samples.k.theta)
    else:
        rate = delayed(measured, samples.segment, samples.dt)
    k = replace(samples.k, theta=centre.straight(samples.k.theta), theta_dot=rate)
    good = samples.good & np.isfinite(smooth.acceleration) & np.isfinite(rate)
    return replace(samples, k=k, measured=measured, theta_ddot=smooth.acceleration, good=good)


def smoothing_of(samples: RingSamples, rows: IntArray, tried: Smoothing) -> Smoothing | None:
    """The smoothing that made the accelerations of some rows: `tried` or one of WINDOWS; None if none of them did."""
    target = samples.theta_ddot[rows]
    for smoothing in (tried, *(replace(Smoothing(), window=window) for window in WINDOWS)):
        own = derivatives(samples.measured, samples.dt, smoothing, segment=samples.segment).acceleration[rows]
        there = np.isfinite(own)
        if there.sum() > MIN_ROWS and np.sqrt(np.mean((own - target)[there] ** 2)) < MAX_SPREAD * np.std(target[there]):
            return smoothing
    return None


def find_centre(samples: RingSamples, rows: IntArray, smoothing: Smoothing) -> Centre | None:
    """The centre found from some rows; None if the camera counts about it, or if two halves of the rows disagree.

    smoothing: the smoothing that made the accelerations.

    The halves consist of blocks. They disagree if another cause looks like a centre, in a short record of one part of
    the ring."""
    own = derivatives(samples.measured, samples.dt, smoothing, segment=samples.segment).acceleration
    rows = rows[np.isfinite(own[rows])]
    half = (rows // max(1, round(BLOCK_S / samples.dt))) % 2 == 0
    if min(half.sum(), (~half).sum()) < MIN_ROWS:
        return None
    whole, gain = _fitted(samples, rows, smoothing)
    parts = (_fitted(samples, some, smoothing)[0] for some in (rows[half], rows[~half])) if gain > MIN_GAIN else ()
    agreed = [max(abs(part.x - whole.x), abs(part.y - whole.y)) < AGREED for part in parts]
    return whole if agreed and all(agreed) else None


def _fitted(samples: RingSamples, rows: IntArray, smoothing: Smoothing) -> tuple[Centre, float]:
    """The centre with the smallest residual of theta_dd, and its gain of -2 log L after the penalty."""

    def left(x: Array) -> float:
        """Mean square of the residual of theta_dd."""
        if np.hypot(*x) > FURTHEST:
            return math.inf
        centre = Centre(float(x[0]), float(x[1]))
        there = straightened(samples, centre, "smoothed", smoothing)
        k, y = there.at(rows), there.theta_ddot[rows]
        slope = centre.slope(samples.k.theta[rows])
        A, b = wall_features(k) / slope[:, None], y / slope
        w, *_ = np.linalg.lstsq(A, b, rcond=None)
        e = A @ w - b
        return float(np.mean(np.clip(e, *np.quantile(e, [TAIL, 1.0 - TAIL])) ** 2))

    simplex = [[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]]
    options = {"xatol": 1e-4, "fatol": 1e-6, "initial_simplex": simplex}
    found: Any = minimize(left, np.zeros(2), method="Nelder-Mead", options=options)
    kernel = acceleration_kernel(smoothing.window, smoothing.order)
    worth = max(len(rows) * float(np.sum(kernel**2)), 2.0)  # neighbours share most of their samples
    gain = worth * math.log(left(np.zeros(2)) / max(float(found.fun), 1e-300)) - 2.0 * math.log(worth)
    return Centre(float(found.x[0]), float(found.x[1])), gain
