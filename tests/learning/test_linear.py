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
        fit = fit_linear(*data(seed=seed))
        assert fit.noise == pytest.approx(0.3, rel=0.15)
        z.append((fit.weights - KNOWN) / np.sqrt(np.diag(fit.covariance)))
    assert np.abs(z).max() < 4.5
    np.testing.assert_allclose(np.std(z, axis=0), 1.0, atol=0.3)  # the errors are as large as said, in every unit
    np.testing.assert_allclose(np.mean(z, axis=0), 0.0, atol=0.5)


def test_almost_without_noise_it_is_exact_and_agrees_with_least_squares():
    X, y = data(noise=1e-4)
    fit = fit_linear(X, y)
    np.testing.assert_allclose(fit.weights, KNOWN, rtol=1e-4)
    np.testing.assert_allclose(fit.weights, np.linalg.lstsq(X, y, rcond=None)[0], rtol=1e-6)
    inverse = np.linalg.inv(X.T @ X)
    np.testing.assert_allclose(fit.covariance, fit.noise**2 * inverse, rtol=1e-4)


def test_a_feature_that_is_always_zero_or_twice_there_does_no_harm():
    X, y = data()
    wide = np.hstack([X, np.zeros((len(X), 1)), X[:, :1]])
    fit = fit_linear(wide, y)
    assert np.isfinite(fit.weights).all()
    assert np.isfinite(fit.covariance).all()
    assert fit.weights[3] == 0.0
    assert fit.weights[0] + fit.weights[4] == pytest.approx(KNOWN[0], rel=0.05)
    np.testing.assert_allclose(fit.mean(wide), fit_linear(X, y).mean(X), atol=0.02)
