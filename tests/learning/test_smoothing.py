"""Smoothing: known polynomials, known noise, the measured rig, and a second route to each estimate."""

from __future__ import annotations

from math import factorial
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import savgol_filter

from mazeplan.core.logs.table import read_table
from mazeplan.learning.smoothing import (
    Smoothing,
    _chain,
    _most_likely,
    _rts,
    acceleration_kernel,
    derivatives,
    smoothed,
    unwrapped,
)

DT = 1.0 / 30.0
RTS = {model: Smoothing("rts", model=model) for model in ("jerk", "snap")}


def rms(x):
    return np.sqrt(np.mean(np.square(x)))


# --- Savitzky and Golay


def test_savgol_is_exact_on_its_polynomials_and_empty_at_edges_and_gaps():
    t = np.arange(60) * DT
    signal = 2.0 - 3.0 * t + 4.0 * t**2
    signal[30] = np.nan
    d = derivatives(signal, DT, segment=np.repeat([3, 1], [40, 20]))
    known = np.zeros(60, dtype=bool)
    known[[*range(3, 27), *range(34, 37), *range(43, 57)]] = True
    for found, truth in ((d.value, signal), (d.rate, -3.0 + 8.0 * t), (d.acceleration, 8.0 + 0.0 * t)):
        assert np.array_equal(np.isfinite(found), known)
        assert found[known] == pytest.approx(truth[known], abs=1e-9)


def measured(name):
    """A table of the measured rig, or skip."""
    root = Path(__file__).resolve().parents[2]
    for home in (root, root.parent):
        if (path := home / "shared" / "data" / name).is_file():
            return read_table(path)
    return pytest.skip(f"the measured data {name} are not here")


@pytest.mark.parametrize("ring", [1, 2, 3, 4])
def test_the_measured_derivatives_are_reproduced(ring):
    table = measured(f"cme-rig/ring{ring}.csv")
    for name in ("theta", "beta", "gamma"):
        d = derivatives(table[name], DT, segment=table.segment)
        # 9 significant digits of theta (up to 100 rad) are 5e-9 to 5e-7; the weights sum to .5 x 900 in absolute value
        for found, column, digits in ((d.rate, f"{name}_dot", 2e-6), (d.acceleration, f"{name}_ddot", 1e-4)):
            assert np.array_equal(np.isnan(found), np.isnan(table[column]))
            assert found == pytest.approx(table[column], abs=digits, nan_ok=True)


@pytest.mark.parametrize(("window", "order"), [(7, 2), (7, 3), (5, 2), (11, 4), (9, 5), (3, 2)])
def test_second_derivative_is_the_kernels_mean_of_the_true_acceleration(window, order):
    rng = np.random.default_rng(2)
    a = rng.standard_normal(80)  # linear between samples: twice integrated by hand
    x, v = np.zeros(80), 0.3
    for k in range(79):
        x[k + 1] = x[k] + v * DT + (a[k] / 3.0 + a[k + 1] / 6.0) * DT**2
        v += 0.5 * (a[k] + a[k + 1]) * DT
    kernel, half = acceleration_kernel(window, order), window // 2
    found = derivatives(x, DT, Smoothing(window=window, order=order)).acceleration
    assert kernel.shape == (window,)
    assert kernel.sum() == pytest.approx(1.0)
    assert kernel == pytest.approx(kernel[::-1])
    assert found[half:-half] == pytest.approx(np.correlate(a, kernel, mode="valid"), abs=1e-8)


# --- Rauch, Tung and Striebel


def least_squares(y, dt, q, sigma, order):
    """States (N, order) that minimise squared samples and steps, each over its covariance: one dense system."""
    N, n = len(y), order
    F = np.array([[dt ** (j - i) / factorial(j - i) if j >= i else 0.0 for j in range(n)] for i in range(n)])
    nodes, weights = np.polynomial.legendre.leggauss(8)  # Q = q int F(s) e_n e_n' F(s)' ds
    s = 0.5 * dt * (nodes + 1.0)
    response = np.array([s ** (n - 1 - i) / factorial(n - 1 - i) for i in range(n)])
    Q = q * (response * weights * 0.5 * dt) @ response.T
    root = np.linalg.inv(np.linalg.cholesky(Q))
    seen = np.flatnonzero(np.isfinite(y))
    A, b = np.zeros((len(seen) + n * (N - 1), n * N)), np.zeros(len(seen) + n * (N - 1))
    A[np.arange(len(seen)), n * seen], b[: len(seen)] = 1.0 / sigma, y[seen] / sigma
    for k in range(N - 1):
        rows = slice(len(seen) + n * k, len(seen) + n * (k + 1))
        A[rows, n * k : n * k + n], A[rows, n * k + n : n * k + 2 * n] = -root @ F, root
    scale = dt ** np.tile(np.arange(n), N)  # states in units of one step: a better conditioned system
    return (np.linalg.lstsq(A / scale, b, rcond=None)[0] / scale).reshape(N, n)


@pytest.mark.parametrize("model", ["jerk", "snap"])
@pytest.mark.parametrize("process", [1e-2, 1e2, 1e5, 1e8])
def test_rts_is_the_least_squares_solution(model, process):
    rng = np.random.default_rng(4)
    y = 5.0 + np.sin(4.0 * np.arange(60) * DT) + 0.01 * rng.standard_normal(60)
    y[[3, 20, 21, 22, 23, 24, 50]] = np.nan
    process = process if model == "jerk" else 100.0 * process
    order = 3 if model == "jerk" else 4
    step, disturbance = _chain(order)
    found = _rts(y - y[0], step, process * DT ** (2 * order - 1) / 0.01**2 * disturbance)
    states = least_squares(y - y[0], DT, process, 0.01, order)
    for i in range(3):
        assert np.isfinite(found).all()
        assert found[:, i] / DT**i == pytest.approx(states[:, i], abs=1e-6 * np.ptp(states[:, i]))


def likelihood(y, dt, q, sigma, order):
    """-2 log L of the samples given q and sigma, with no knowledge of the start: by the covariance of all samples."""
    N = len(y)
    t = np.arange(N) * dt
    nodes, w = np.polynomial.legendre.leggauss(4)  # exact between samples, where all responses are polynomials
    s, w = (t[:-1, None] + 0.5 * dt * (nodes + 1.0)).ravel(), np.tile(0.5 * dt * w, N - 1)
    response = np.maximum(t[:, None] - s, 0.0) ** (order - 1) / factorial(order - 1)
    start = np.vander(t, order)
    V = q * (response * w) @ response.T + sigma**2 * np.eye(N)
    free = np.linalg.svd(start.T)[2][order:]  # combinations of samples that do not see the start
    e, V = free @ y, free @ V @ free.T
    return np.linalg.slogdet(V)[1] + e @ np.linalg.solve(V, e)


def test_noise_is_that_of_the_largest_likelihood():
    """Over short stretches, so that what their unknown starts cost is seen."""
    rng = np.random.default_rng(5)
    y = np.cumsum(np.cumsum(np.cumsum(rng.standard_normal(120) * 0.5))) * DT + 0.01 * rng.standard_normal(120)
    parts = y.reshape(15, 8)
    q, sigma = _most_likely(list(parts), DT, *_chain(3))

    def loss(process=1.0, noise=1.0):
        return sum(likelihood(part, DT, process * q, noise * sigma, 3) for part in parts)

    for name in ("process", "noise"):
        assert loss(**{name: 0.97}) > loss() < loss(**{name: 1.03})


def test_rts_recovers_the_noise_that_made_a_signal():
    rng, n, q, sigma = np.random.default_rng(7), 20000, 50.0, 2e-3
    s = np.zeros(3)
    F = np.array([[1.0, DT, DT**2 / 2], [0.0, 1.0, DT], [0.0, 0.0, 1.0]])
    Q = q * np.array(
        [[DT**5 / 20, DT**4 / 8, DT**3 / 6], [DT**4 / 8, DT**3 / 3, DT**2 / 2], [DT**3 / 6, DT**2 / 2, DT]]
    )
    kicks = rng.standard_normal((n, 3)) @ np.linalg.cholesky(Q).T
    states = np.empty((n, 3))
    for k in range(n):
        states[k] = s
        s = F @ s + kicks[k]
    y = states[:, 0] + sigma * rng.standard_normal(n)
    process, noise = _most_likely([y], DT, *_chain(3))
    assert noise == pytest.approx(sigma, rel=0.02)
    assert process == pytest.approx(q, rel=0.1)


def test_rts_bridges_short_gaps_and_stops_at_long_ones():
    t = np.arange(120) * DT
    y = np.sin(3.0 * t) + 1e-4 * np.random.default_rng(8).standard_normal(120)
    y[:2] = y[40:45] = y[80:86] = y[-3:] = np.nan
    d = derivatives(y, DT, RTS["snap"])
    known = np.ones(120, dtype=bool)
    known[[0, 1, *range(80, 86), 117, 118, 119]] = False
    for found, truth, error in ((d.value, np.sin(3 * t), 3e-3), (d.rate, 3 * np.cos(3 * t), 0.1)):
        assert np.array_equal(np.isfinite(found), known)
        assert found[known] == pytest.approx(truth[known], abs=error)


def test_segments_are_smoothed_apart_with_one_noise():
    rng = np.random.default_rng(9)
    t = np.arange(300) * DT
    y = np.sin(2.0 * t) + 1e-3 * rng.standard_normal(300) + np.repeat([0.0, 50.0], 150)
    segment = np.repeat([1.0, 2.0], 150)
    both = derivatives(y, DT, RTS["jerk"], segment=segment)
    step, disturbance = _chain(3)
    q, sigma = _most_likely([y[:150], y[150:]], DT, step, disturbance)
    for part in (slice(0, 150), slice(150, 300)):
        own = _rts(y[part] - y[part][0], step, q * DT**5 / sigma**2 * disturbance)
        assert both.acceleration[part] == pytest.approx(own[:, 2] / DT**2, abs=1e-9)
    assert rms(both.acceleration + 4.0 * np.sin(2.0 * t)) < 0.2


def test_unwrapping_skips_what_was_not_seen_and_starts_anew_in_a_segment():
    theta = np.linspace(0.0, 40.0, 200)
    wrapped = np.mod(theta, 2 * np.pi)
    assert unwrapped(wrapped) == pytest.approx(theta)
    holes = np.where(np.arange(200) % 7 == 0, np.nan, wrapped)
    assert unwrapped(holes)[1:7] == pytest.approx(theta[1:7])
    assert unwrapped(holes) == pytest.approx(np.where(np.isnan(holes), np.nan, theta), nan_ok=True)
    segment = np.repeat([0, 5, 0], [80, 60, 60])
    apart = unwrapped(wrapped, segment)
    for start, stop in ((0, 80), (80, 140), (140, 200)):
        assert apart[start] == wrapped[start]
        assert np.diff(apart[start:stop]) == pytest.approx(np.diff(theta[start:stop]))
    assert len(unwrapped(np.full(3, np.nan))) == 3


@pytest.mark.parametrize(("window", "deriv"), [(7, 0), (11, 1), (21, 2)])
def test_a_smoothed_signal_is_that_of_scipy_at_the_ends_too(window, deriv):
    signal = np.random.default_rng(window).standard_normal(60).cumsum()
    expected = savgol_filter(signal, window, 3, deriv=deriv, delta=0.05)
    np.testing.assert_allclose(smoothed(signal, window, deriv=deriv, dt=0.05), expected, rtol=1e-9, atol=1e-9)
