"""Acausal smoothing of sampled signals and their derivatives, by one of two methods.

savgol  Savitzky and Golay (1964): derivatives at the middle of a polynomial fitted to a window of samples. Its effect
        on a signal is the same everywhere (`acceleration_kernel`); it gives nothing at the edges.
rts     Rauch, Tung and Striebel (1965): the third derivative of the signal (model "jerk"), or the fourth ("snap"), is
        white noise of density q, and the samples have white noise of standard deviation sigma. A Kalman filter and a
        smoother give the mean of the signal given all samples, also at edges and in gaps, with an unknown start.
        q and sigma maximise the likelihood of the samples,

            -2 log L = sum_k [ log S_k + e_k^2 / S_k ],    e_k, S_k: innovation of the filter and its variance.

        Only q / sigma^2 decides the smoothing; given this ratio, sigma follows in closed form. So the search is over
        one number. The backward pass is that of Bryson and Frazier (1963), which needs no inverse.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np
from numba import njit
from scipy.optimize import minimize_scalar

from mazeplan.core.records import Array, IntArray

# decades of q / sigma^2, in units of one step, that are searched: from one parabola through 300 samples to a signal
# that meets each sample within a hundredth of its noise
RATIOS = (-12.0, 4.0)
GRID = 17  # ratios tried before the best is refined
DIFFUSE = 1e7  # prior variance of the states over that of a sample and of a step; a larger one would lose digits
SETTLED = 1e-12  # relative change per step below which the filter's covariance counts as constant
BRIDGE = 5  # longest run of missing samples (NaN) within a stretch, rts only; savgol bridges none
TINY = 1e-200  # minimum variance, so that a constant signal has a likelihood


def smoothed(signal: Array, window: int, *, deriv: int = 0, dt: float = 1.0) -> Array:
    """Savitzky-Golay estimate, cubic over `window` samples (odd), of a signal (N,) or its derivative (per dt^deriv)."""
    if len(signal) < window:
        raise ValueError(f"got {len(signal)} samples, expected at least {window}, a window")
    out, half = np.empty(len(signal)), window // 2
    out[half : len(out) - half] = np.correlate(signal, savgol_weights(window, 3, deriv, dt), mode="valid")
    for k in range(half):  # at the ends, the polynomial of the first and of the last window
        out[k] = savgol_weights(window, 3, deriv, dt, k - half) @ signal[:window]
        out[-1 - k] = savgol_weights(window, 3, deriv, dt, half - k) @ signal[-window:]
    return out


@cache
def savgol_weights(window: int, order: int, deriv: int, dt: float, at: int = 0) -> Array:
    """Weights (window,) that give a derivative of the polynomial of this order through a window of samples dt apart.

    at: sample of the derivative, from the middle of the window. scipy.signal does the same, but takes half a second to
    import."""
    j = np.arange(-(window // 2), window // 2 + 1) - at
    return math.factorial(deriv) / dt**deriv * np.linalg.pinv(np.vander(j, order + 1, increasing=True))[deriv]


@dataclass(frozen=True)
class Smoothing:
    """Settings of a smoothing.

    window:  samples (odd) of the polynomial; for both methods, shorter stretches give NaN
    order:   degree of the polynomial, savgol only
    model:   rts only: jerk or snap, see above
    """

    method: Literal["savgol", "rts"] = "savgol"
    window: int = 7
    order: int = 2
    model: Literal["jerk", "snap"] = "jerk"

    @property
    def states(self) -> int:
        """Number of states of the rts model."""
        return 3 if self.model == "jerk" else 4


@dataclass(frozen=True)
class Derivatives:
    """Smoothed signal (N,), and its first and second derivative, per s and s^2; NaN: unknown."""

    value: Array
    rate: Array
    acceleration: Array


def derivatives(
    signal: Array, dt: float, smoothing: Smoothing | None = None, *, segment: Array | IntArray | None = None
) -> Derivatives:
    """Signal (N,), rate and acceleration from samples `dt` s apart, NaN: missing.

    segment (N,): number of the uninterrupted stretch of each row; None: one stretch.

    An angle must be continuous within a stretch (`unwrapped`). rts has one noise for all stretches. The result is NaN
    in short stretches; for savgol, where the window does not fit or meets a missing sample; for rts, outside a stretch
    and in long gaps.
    """
    smoothing = smoothing or Smoothing()
    number = np.zeros(len(signal), dtype=np.int64) if segment is None else _numbers(segment)
    out, half = np.full((3, len(signal)), np.nan), smoothing.window // 2
    if smoothing.method == "savgol":
        for start, stop in _runs(number, np.ones(len(signal), dtype=bool), 0):
            if stop - start < smoothing.window:
                continue
            for deriv in range(3):
                weights = savgol_weights(smoothing.window, smoothing.order, deriv, dt)
                out[deriv, start + half : stop - half] = np.correlate(signal[start:stop], weights, mode="valid")
        return Derivatives(*out)
    seen = np.isfinite(signal)
    runs = _runs(number, seen, BRIDGE)
    pieces = [(start, stop) for start, stop in runs if np.count_nonzero(seen[start:stop]) >= smoothing.window]
    if pieces:
        step, disturbance = _chain(smoothing.states)
        q, sigma = _most_likely([signal[start:stop] for start, stop in pieces], dt, step, disturbance)
        ratio = q * dt ** (2 * smoothing.states - 1) / sigma**2
        for start, stop in pieces:
            states = _rts(signal[start:stop] - signal[start], step, ratio * disturbance)
            out[:, start:stop] = states[:, :3].T / np.array([[1.0], [dt], [dt**2]])
            out[0, start:stop] += signal[start]
    return Derivatives(*out)


def unwrapped(angle: Array, segment: Array | IntArray | None = None) -> Array:
    """An angle (N,), rad, without jumps of whole turns within each segment; NaN stays NaN."""
    angle = np.array(angle, dtype=np.float64)
    seen = np.flatnonzero(np.isfinite(angle))
    number = _numbers(np.zeros(len(angle)) if segment is None else segment)[seen]
    turns = np.concatenate([[0.0], -np.cumsum(np.round(np.diff(angle[seen]) / (2.0 * np.pi)))])[: len(seen)]
    # a segment starts with its measured angle: subtract the turns before it
    _, first, at = np.unique(number, return_index=True, return_inverse=True)
    angle[seen] += 2.0 * np.pi * (turns - turns[first][at])
    return angle


def acceleration_kernel(window: int = 7, order: int = 2) -> Array:
    """Weights (window,) with which a Savitzky-Golay second derivative averages the true one; they sum to 1.

    For weights c_j on samples x_j of a signal with x'' = a the estimate is sum_j c_j x_j = integral of a(s) K(s) with
    Peano's K(s) = sum_j c_j max(j - s, 0), s in samples: c takes value and slope at any s to 0. K is linear between
    samples; if a is too, the integral is sum_m w_m a_m with w_m = (K_{m-1} + 4 K_m + K_{m+1}) / 6, exactly.
    """
    half = window // 2
    j = np.arange(-half, half + 1)
    c = savgol_weights(window, order, 2, 1.0)
    knots = np.arange(-half - 1, half + 2)
    K = np.maximum(j - knots[:, None], 0) @ c
    K[[0, 1, -2, -1]] = 0.0  # at the ends and beyond; else rounding
    return (K[:-2] + 4.0 * K[1:-1] + K[2:]) / 6.0


def _numbers(segment: Array | IntArray) -> IntArray:
    """Number of changes of segment up to each row, (N,), including changes at rows without a sample."""
    return np.cumsum(np.diff(np.asarray(segment, dtype=np.float64), prepend=segment[:1]) != 0.0)


def _runs(number: IntArray, seen: np.ndarray, bridge: int) -> list[tuple[int, int]]:
    """(first, one past last) seen row of each stretch: one segment, at most `bridge` missing rows in a row."""
    rows = np.flatnonzero(seen)
    if not rows.size:
        return []
    cut = np.flatnonzero((np.diff(rows) > bridge + 1) | (np.diff(number[rows]) != 0)) + 1
    firsts, lasts = rows[np.concatenate([[0], cut])], rows[np.concatenate([cut - 1, [len(rows) - 1]])]
    return [(int(a), int(b) + 1) for a, b in zip(firsts, lasts, strict=True)]


def _chain(n: int) -> tuple[Array, Array]:
    """Transition (n, n) of n integrators in a row over one step, and covariance of unit white noise at their input."""
    step, disturbance = np.eye(n), np.empty((n, n))
    for i in range(n):
        for k in range(n):
            if k >= i:
                step[i, k] = 1.0 / math.factorial(k - i)
            p, q = n - 1 - i, n - 1 - k  # the impulse response of state i is s^p / p!
            disturbance[i, k] = 1.0 / (math.factorial(p) * math.factorial(q) * (p + q + 1))
    return step, disturbance


def _most_likely(pieces: list[Array], dt: float, step: Array, disturbance: Array) -> tuple[float, float]:
    """q and sigma by maximum likelihood over all stretches.

    The first n samples of a stretch determine its unknown start; they do not count."""
    n = len(step)
    nothing = np.empty((0, n))

    def variance_and_loss(decade: float) -> tuple[float, float]:
        ratio, logs, squares, count = 10.0**decade, 0.0, 0.0, 0
        for y in pieces:
            part = _forward(y - y[0], step, ratio * disturbance, nothing, np.empty((0, n, n)), nothing, np.empty(0))
            logs, squares, count = logs + part[0], squares + part[1], count + part[2]
        variance = max(squares / max(count, 1), TINY)
        return variance, count * math.log(variance) + logs + squares / variance

    decades = np.linspace(*RATIOS, GRID)
    best = int(np.argmin([variance_and_loss(float(decade))[1] for decade in decades]))
    bounds = decades[max(best - 1, 0)], decades[min(best + 1, GRID - 1)]
    found: Any = minimize_scalar(
        lambda at: variance_and_loss(at)[1], bounds=bounds, method="bounded", options={"xatol": 1e-3}
    )
    variance = variance_and_loss(float(found.x))[0]
    return variance * 10.0 ** float(found.x) / dt ** (2 * n - 1), math.sqrt(variance)


@njit(cache=True)
def _rts(y: Array, step: Array, disturbance: Array) -> Array:
    """States (N, n) given all samples y (N,), NaN: missing; in units of the noise of a sample."""
    n, N = len(step), len(y)
    x, P, gain, pull = np.empty((N, n)), np.empty((N, n, n)), np.empty((N, n)), np.empty(N)
    _forward(y, step, disturbance, x, P, gain, pull)
    r, back = np.zeros(n), np.empty(n)
    for k in range(N - 1, -1, -1):  # r: adjoint of the prediction of k, from the samples from k on
        for i in range(n):
            back[i] = 0.0
            for j in range(n):
                back[i] += step[j, i] * r[j]
        taken = pull[k]
        for i in range(n):
            taken -= gain[k, i] * back[i]
        back[0] += taken
        for i in range(n):
            r[i] = back[i]
        for i in range(n):
            for j in range(n):
                x[k, i] += P[k, i, j] * r[j]
    return x


@njit(cache=True)
def _forward(
    y: Array, step: Array, disturbance: Array, x_kept: Array, P_kept: Array, gain_kept: Array, pull_kept: Array
) -> tuple[float, float, int]:
    """Kalman filter: sums of log S and e^2 / S over the samples of y (N,) except the first n, and their number.

    S is in units of the noise of a sample: 1 plus the variance of the prediction. The filter keeps prediction,
    covariance, gain and e / S of each step unless the arrays are empty."""
    n, keep = len(step), len(x_kept) > 0
    x, moved, P = np.zeros(n), np.empty(n), np.zeros((n, n))
    for i in range(n):
        P[i, i] = DIFFUSE * (1.0 + disturbance[n - 1, n - 1])
    after, next_P, gain = np.empty((n, n)), np.empty((n, n)), np.zeros(n)
    S, log_S, settled = 1.0, 0.0, False
    logs, squares, count, met = 0.0, 0.0, 0, 0
    for k in range(len(y)):
        seen = not np.isnan(y[k])
        if not (seen and settled):
            S = P[0, 0] + 1.0
            log_S = np.log(S)
            for i in range(n):
                gain[i] = P[i, 0] / S if seen else 0.0
        e = y[k] - x[0] if seen else 0.0
        if keep:
            pull_kept[k] = e / S
            for i in range(n):
                x_kept[k, i], gain_kept[k, i] = x[i], gain[i]
                for j in range(n):
                    P_kept[k, i, j] = P[i, j]
        if seen:
            met += 1
            if met > n:
                logs, squares, count = logs + log_S, squares + e * e / S, count + 1
        for i in range(n):
            moved[i] = 0.0
            for j in range(i, n):
                moved[i] += step[i, j] * (x[j] + gain[j] * e)
        for i in range(n):
            x[i] = moved[i]
        if not (seen and settled):
            settled = _predict_covariance(P, gain, S, step, disturbance, after, next_P) and seen
    return logs, squares, count


@njit(cache=True)
def _predict_covariance(
    P: Array, gain: Array, S: float, step: Array, disturbance: Array, after: Array, next_P: Array
) -> bool:
    """Update P in place by a sample with this gain and one step. Returns whether P is settled.

    after, next_P: scratch space."""
    n = len(step)
    for i in range(n):
        for j in range(n):
            after[i, j] = P[i, j] - gain[i] * S * gain[j]
    for i in range(n):
        for j in range(i, n):
            total = disturbance[i, j]
            for a in range(i, n):
                for b in range(j, n):
                    total += step[i, a] * after[a, b] * step[j, b]
            next_P[i, j] = next_P[j, i] = total
    same = True
    for i in range(n):
        for j in range(n):
            if abs(next_P[i, j] - P[i, j]) > SETTLED * np.sqrt(next_P[i, i] * next_P[j, j]):
                same = False
    for i in range(n):
        for j in range(n):
            P[i, j] = next_P[i, j]
    return same
