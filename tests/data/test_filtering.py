"""The causal filter against a dense conditioning on all samples so far, and against what it must not know."""

from __future__ import annotations

import numpy as np
import pytest

from mazeplan.data.filtering import causal_estimates
from mazeplan.data.smoothing import Noise

DT = 1.0 / 30.0
NOISE = Noise(process=40.0, noise=2e-3)
START = (3.0, 10.0)  # rad/s, rad/s^2: what may be expected of rate and acceleration at the first sample


def walk(n, seed=0):
    """A signal seen through noise, (n,)."""
    t = np.arange(n) * DT
    return 0.3 * np.sin(3.0 * t) + 0.5 * t + NOISE.noise * np.random.default_rng(seed).standard_normal(n)


def prior(n, process):
    """Covariance of (value, rate) at samples, (2 n, 2 n), about the first sample: integrals of white jerk, by
    quadrature, plus what is not known of the start."""
    t, fine = np.arange(n) * DT, 200
    s = (np.arange((n - 1) * fine) + 0.5) * DT / fine
    late = np.clip(t[:, None] - s[None, :], 0.0, None)
    here = (late > 0.0).astype(float)
    value, rate = 0.5 * late**2, late * here
    both = np.concatenate([value, rate])
    start = np.concatenate([np.stack([t, 0.5 * t**2]).T, np.stack([np.ones(n), t]).T])
    return process * DT / fine * both @ both.T + start @ np.diag(np.square(START)) @ start.T


def dense(y, noise):
    """Value and rate (n,), each by Gaussian conditioning on the samples up to its own; NaN samples say nothing.

    The first sample seen is the origin: its value is only as well known as a sample is."""
    n, out = len(y), np.full((2, len(y)), np.nan)
    cov = prior(n, noise.process)
    cov[:n, :n] += noise.noise**2  # of the origin, which all values share
    for k in range(n):
        seen = [j for j in range(1, k + 1) if np.isfinite(y[j])]
        gain = cov[np.ix_([k, n + k], seen)] @ np.linalg.inv(
            cov[np.ix_(seen, seen)] + noise.noise**2 * np.eye(len(seen))
        )
        out[:, k] = gain @ (y[seen] - y[0])
    return out[0] + y[0], out[1]


@pytest.mark.parametrize("missing", [(), (3,), (5, 6, 7, 11)])
def test_it_is_the_conditional_mean_given_the_samples_so_far(missing):
    y = walk(16)
    y[list(missing)] = np.nan
    value, rate = causal_estimates(y, DT, NOISE, np.zeros(16))
    expected = dense(y, NOISE)
    assert value == pytest.approx(expected[0], abs=2e-6)
    assert rate == pytest.approx(expected[1], abs=2e-4)


def test_it_follows_a_moving_signal():
    n = 300
    y, t = walk(n), np.arange(n) * DT
    value, rate = causal_estimates(y, DT, NOISE, np.zeros(n))
    assert np.sqrt(np.mean((value - 0.3 * np.sin(3.0 * t) - 0.5 * t)[20:] ** 2)) < NOISE.noise
    assert np.sqrt(np.mean((rate - 0.9 * np.cos(3.0 * t) - 0.5)[20:] ** 2)) < 0.1  # differences: .085 rms of noise


def test_later_samples_change_no_earlier_estimate():
    y = walk(60)
    value, rate = causal_estimates(y, DT, NOISE, np.zeros(60))
    other = y.copy()
    other[40:] += 5.0
    value_then, rate_then = causal_estimates(other, DT, NOISE, np.zeros(60))
    assert np.array_equal(value[:40], value_then[:40])
    assert np.array_equal(rate[:40], rate_then[:40])
    assert abs(value[40] - value_then[40]) > 1.0


def test_each_stretch_begins_anew():
    y = walk(60)
    segment = np.repeat([4, 2, 2], 20)  # numbers need not grow
    value, rate = causal_estimates(y, DT, NOISE, segment)
    for part in (slice(0, 20), slice(20, 60)):
        alone = causal_estimates(y[part], DT, NOISE, segment[part])
        assert np.array_equal(value[part], alone[0])
        assert np.array_equal(rate[part], alone[1])
    assert value[20] == y[20]
    assert rate[20] == 0.0


def test_missing_samples_are_passed_over():
    y = walk(40)
    y[:3] = np.nan
    y[20:25] = np.nan
    value, rate = causal_estimates(y, DT, NOISE, np.zeros(40))
    assert np.isnan(value[:3]).all()  # nothing is known yet
    assert np.isnan(rate[:3]).all()
    assert np.isfinite(value[3:]).all()
    assert np.array_equal(value[3:], causal_estimates(y[3:], DT, NOISE, np.zeros(37))[0])
    # in a gap it goes on by rate and acceleration
    steps = np.diff(value[19:25])
    assert np.diff(steps, n=2) == pytest.approx(0.0, abs=1e-12)
    nothing = causal_estimates(np.full(5, np.nan), DT, NOISE, np.zeros(5))
    assert np.isnan(nothing).all()
    assert causal_estimates(np.zeros(0), DT, NOISE, np.zeros(0))[0].shape == (0,)
