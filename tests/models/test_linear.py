"""Bayesian linear regression: known weights, evidence by brute force, features that say nothing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from mazeplan.models.linear import _evidence, fit_linear

KNOWN = np.array([2.0, -30.0, 0.004])  # of features of unlike sizes
SIZES = np.array([1.0, 0.1, 500.0])


def data(n=300, seed=0, noise=0.3, extra=0):
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, 3 + extra)) * np.concatenate([SIZES, np.ones(extra)])
    return X, X[:, :3] @ KNOWN + rng.normal(0.0, noise, n)


def log_evidence(log_values, X, y):
    """Log density of y for given logs of the precisions and of the noise variance, by the whole (N, N) matrix."""
    precision, noise = np.exp(log_values[:-1]), np.exp(log_values[-1])
    return float(multivariate_normal.logpdf(y, np.zeros(len(y)), (X / precision) @ X.T + noise * np.eye(len(y))))


def best_evidence(X, y):
    """The highest of them, climbed to from several places."""
    starts = ([a] * X.shape[1] + [b] for a in (-3.0, 0.0, 3.0) for b in (-3.0, 0.0))
    bounds = [(-25.0, 25.0)] * X.shape[1] + [(-10.0, 10.0)]
    return max(
        -minimize(lambda v: -log_evidence(v, X, y), start, bounds=bounds, method="L-BFGS-B").fun for start in starts
    )


def test_known_weights_come_back_within_their_errors():
    z = []
    for seed in range(40):
        fit = fit_linear(*data(seed=seed))
        assert fit.noise == pytest.approx(0.3, rel=0.15)
        z.append((fit.weights - KNOWN) / fit.stderr)
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


def test_evidence_is_the_density_of_the_values_and_the_highest():
    X, y = data(n=40, seed=3)
    X = X / SIZES
    fit = fit_linear(X, y)
    assert fit.evidence == pytest.approx(best_evidence(X, y), abs=1e-4)


def test_evidence_of_given_precisions_by_brute_force():
    X, y = data(n=25, seed=1)
    X = X / SIZES
    for precision, noise in ((np.array([0.3, 4.0, 0.01]), 0.2), (np.array([50.0, 1e-3, 7.0]), 3.0)):
        ours = _evidence(X.T @ X, X.T @ y, float(y @ y), precision, noise, 25)
        assert ours == pytest.approx(log_evidence(np.log([*precision, noise]), X, y), abs=1e-8)


def test_units_do_not_matter():
    X, y = data()
    one, other = fit_linear(X, y), fit_linear(X / SIZES, y)
    np.testing.assert_allclose(one.weights * SIZES, other.weights, rtol=1e-8)
    np.testing.assert_allclose(one.stderr * SIZES, other.stderr, rtol=1e-8)
    assert one.evidence == pytest.approx(other.evidence, abs=1e-8)
    np.testing.assert_allclose(fit_linear(X, 1000.0 * y).weights, 1000.0 * one.weights, rtol=1e-4)


def test_features_that_say_nothing_get_nothing():
    shares = []
    for seed in range(20):
        X, y = data(seed=seed, extra=4)
        fit = fit_linear(X, y)
        plain = np.linalg.lstsq(X, y, rcond=None)[0]
        np.testing.assert_allclose(fit.weights[:3], KNOWN, rtol=0.2)
        assert np.abs(fit.weights[3:]).max() < 0.1
        shares += list(np.abs(fit.weights[3:] / plain[3:]))
    assert np.median(shares) < 0.02, "least squares would have fitted the noise"


def test_a_feature_that_is_always_zero_or_twice_there_does_no_harm():
    X, y = data()
    wide = np.hstack([X, np.zeros((len(X), 1)), X[:, :1]])
    fit = fit_linear(wide, y)
    assert np.isfinite(fit.weights).all()
    assert np.isfinite(fit.evidence)
    assert fit.weights[3] == 0.0
    assert fit.weights[0] + fit.weights[4] == pytest.approx(KNOWN[0], rel=0.05)
    np.testing.assert_allclose(fit.mean(wide), fit_linear(X, y).mean(X), atol=0.02)


def test_a_perfect_fit_is_found_and_its_numbers_are_finite():
    X, y = data(noise=0.0)
    fit = fit_linear(X, y)
    np.testing.assert_allclose(fit.weights, KNOWN, rtol=1e-9)
    assert np.isfinite([*fit.stderr, fit.evidence]).all()
    assert 0.0 < fit.noise < 1e-4


def test_a_target_of_zeros_gives_zeros():
    fit = fit_linear(data()[0], np.zeros(300))
    np.testing.assert_array_equal(fit.weights, 0.0)
    assert np.isfinite(fit.stderr).all()


def test_variance_is_that_of_the_prediction():
    X, y = data()
    fit = fit_linear(X, y)
    drawn = np.random.default_rng(0).multivariate_normal(fit.weights, fit.covariance, 20000) @ X[:20].T
    np.testing.assert_allclose(fit.mean(X[:20]), drawn.mean(axis=0), atol=0.002)
    np.testing.assert_allclose(fit.variance(X[:20]), drawn.var(axis=0), rtol=0.06)


def test_more_rows_than_features_are_needed():
    X, y = data(n=3)
    with pytest.raises(ValueError, match="got 3 samples, expected more than 3"):
        fit_linear(X, y)
