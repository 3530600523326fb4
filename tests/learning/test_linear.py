"""Bayesian linear regression: known weights, features that say nothing."""

from __future__ import annotations

import numpy as np
import pytest

from mazeplan.learning.fitting import fit_linear

KNOWN = np.array([2.0, -30.0, 0.004])  # of features of unlike sizes
SIZES = np.array([1.0, 0.1, 500.0])


def data(n=300, seed=0, noise=0.3, extra=0):
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, 3 + extra)) * np.concatenate([SIZES, np.ones(extra)])
    return X, X[:, :3] @ KNOWN + rng.normal(0.0, noise, n)


def test_known_weights_come_back_within_their_errors():
    z = []
    for seed in range(40):
        X, y = data(seed=seed)
        z.append((fit_linear(X, y) - KNOWN) / (0.3 * np.sqrt(np.diag(np.linalg.inv(X.T @ X)))))
    assert np.abs(z).max() < 4.5
    np.testing.assert_allclose(np.mean(z, axis=0), 0.0, atol=0.5)


def test_almost_without_noise_it_is_exact_and_agrees_with_least_squares():
    X, y = data(noise=1e-4)
    weights = fit_linear(X, y)
    np.testing.assert_allclose(weights, KNOWN, rtol=1e-4)
    np.testing.assert_allclose(weights, np.linalg.lstsq(X, y, rcond=None)[0], rtol=1e-6)


def test_a_feature_that_is_always_zero_or_twice_there_does_no_harm():
    X, y = data()
    wide = np.hstack([X, np.zeros((len(X), 1)), X[:, :1]])
    weights = fit_linear(wide, y)
    assert np.isfinite(weights).all()
    assert weights[3] == 0.0
    assert weights[0] + weights[4] == pytest.approx(KNOWN[0], rel=0.05)
    np.testing.assert_allclose(wide @ weights, X @ fit_linear(X, y), atol=0.02)
