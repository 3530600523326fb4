"""The process against scikit-learn, against plain matrix algebra, and against itself under symmetry."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gaussian_processes import log_likelihood, plain
from scipy.stats import multivariate_normal
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process import kernels as sklearn_kernels

from mazeplan.core.errors import ModelError
from mazeplan.learning import gaussian_process
from mazeplan.learning.gaussian_process import (
    FAMILIES,
    GaussianProcess,
    Hyperparameters,
    KernelTerm,
    kernel,
    prior_variance,
)

KERNELS: Any = sklearn_kernels
LENGTHS = np.array([0.7, 1.5, 4.0])
SIGMA = np.array([2.0, 0.3])
NONE = np.zeros(0)
TURN = np.array([-1.0, 1.0, -1.0])
SUM = (KernelTerm((0, 1, 2), LENGTHS, 1.3), KernelTerm((2, 0), np.array([0.9, 0.6]), 0.8, (1.0, -1.0)))
ODD = (KernelTerm((0, 1, 2), LENGTHS, 1.3, tuple(TURN)),)


def data(n=60, seed=0):
    """Training inputs (n, 3), features (n, 2), values (n,), and as many of the first two to predict at."""
    rng = np.random.default_rng(seed)
    x, at = rng.normal(0.0, 1.5, (n, 3)), rng.normal(0.0, 1.5, (n, 3))
    return x, rng.normal(size=(n, 2)), rng.normal(0.0, 2.0, n), at, rng.normal(size=(n, 2))


def bare(n):
    return np.zeros((n, 0))


def dense_kernel(a, b, hyper):
    """The kernel entry by entry, as its formula stands."""
    out = np.zeros((len(a), len(b)))
    for term in hyper.terms:
        for i, x in enumerate(a[:, list(term.columns)]):
            for j, y in enumerate(b[:, list(term.columns)]):
                for sign, other in [(1.0, y)] + ([(-1.0, np.array(term.flip) * y)] if term.flip else []):
                    r = np.linalg.norm((x - other) / term.lengthscales)
                    shape = np.exp(-(r**2) / 2) if hyper.family == "rbf" else np.exp(-r)
                    out[i, j] += sign * term.amplitude**2 * shape
    return out


def log_density(y, covariance):
    normal: Any = multivariate_normal
    return float(normal.logpdf(y, np.zeros(len(y)), covariance))


def dense(hyper, x, phi, y, at, phi_at):
    """Mean, variance, weights and their covariance by inverting the matrix, and the matrix itself."""
    S = np.diag(hyper.weight_sigma**2)
    whole = dense_kernel(x, x, hyper) + phi @ S @ phi.T + hyper.noise**2 * np.eye(len(y))
    cross = dense_kernel(at, x, hyper) + phi_at @ S @ phi.T
    inverse = np.linalg.inv(whole)
    own = np.diag(dense_kernel(at, at, hyper) + phi_at @ S @ phi_at.T)
    variance = own - np.einsum("ni,ij,nj->n", cross, inverse, cross)
    gain = S @ phi.T @ inverse
    return cross @ inverse @ y, variance, gain @ y, S - gain @ phi @ S, whole


def test_each_row_may_have_a_noise_of_its_own():
    x, phi, y, at, phi_at = data()
    hyper = Hyperparameters(SUM, 0.3, SIGMA)
    noise = np.random.default_rng(1).uniform(0.1, 3.0, len(y))
    process = GaussianProcess.condition(hyper, x, phi, y, noise)
    S = np.diag(SIGMA**2)
    whole = dense_kernel(x, x, hyper) + phi @ S @ phi.T + np.diag(noise**2)
    cross = dense_kernel(at, x, hyper) + phi_at @ S @ phi.T
    np.testing.assert_allclose(process.mean(at, phi_at), cross @ np.linalg.solve(whole, y), rtol=1e-7, atol=1e-7)
    assert log_likelihood(process, y) == pytest.approx(log_density(y, whole))
    same = GaussianProcess.condition(hyper, x, phi, y, np.full(len(y), 0.3))
    np.testing.assert_allclose(same.alpha, GaussianProcess.condition(hyper, x, phi, y).alpha, rtol=1e-12)


@pytest.mark.parametrize("family", FAMILIES)
def test_mean_and_variance_are_those_of_scikit_learn(family):
    x, _, y, at, _ = data()
    hyper = plain(LENGTHS, 1.7, 0.3, family=family)
    shape = KERNELS.RBF(LENGTHS) if family == "rbf" else KERNELS.Matern(LENGTHS, nu=0.5)
    regressor: Any = GaussianProcessRegressor
    other = regressor(KERNELS.ConstantKernel(1.7**2) * shape, alpha=0.3**2, optimizer=None).fit(x, y)
    mean, deviation = other.predict(at, return_std=True)
    ours = GaussianProcess.condition(hyper, x, bare(len(y)), y)
    np.testing.assert_allclose(ours.mean(at), mean, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(ours.variance(at), deviation**2, rtol=1e-7, atol=1e-7)
    assert np.ptp(deviation) > 0.1, "rows that all are as far away would show nothing"
    likelihood = other.log_marginal_likelihood_value_
    np.testing.assert_allclose(log_likelihood(ours, y), likelihood, rtol=1e-7)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("terms", [SUM[:1], SUM, ODD], ids=["plain", "sum", "odd"])
@pytest.mark.parametrize("sigma", [NONE, SIGMA, np.array([0.0, 0.5])], ids=["bare", "features", "one_off"])
def test_conditioning_is_plain_matrix_algebra(family, terms, sigma):
    x, phi, y, at, phi_at = data(25)
    phi, phi_at = phi[:, : len(sigma)], phi_at[:, : len(sigma)]
    hyper = Hyperparameters(terms, 0.4, sigma, family)
    process = GaussianProcess.condition(hyper, x, phi, y)
    mean, variance, weights, covariance, whole = dense(hyper, x, phi, y, at, phi_at)
    close: dict[str, Any] = {"rtol": 1e-6, "atol": 1e-6}
    np.testing.assert_allclose(process.mean(at, phi_at), mean, **close)
    np.testing.assert_allclose(process.variance(at, phi_at), variance, **close)
    np.testing.assert_allclose(process.weights, weights, **close)
    np.testing.assert_allclose(process.covariance, covariance, **close)
    np.testing.assert_allclose(log_likelihood(process, y), log_density(y, whole), rtol=1e-8)
    assert len(process) == 25


@pytest.mark.parametrize("family", FAMILIES)
def test_the_prior_is_the_kernel_with_itself_and_positive(family):
    x, _, _, at, _ = data(20)
    for terms in (SUM, ODD):
        hyper = Hyperparameters(terms, 0.1, NONE, family)
        np.testing.assert_allclose(kernel(x, at, hyper), dense_kernel(x, at, hyper), atol=1e-12)
        np.testing.assert_allclose(prior_variance(at, hyper), np.diag(dense_kernel(at, at, hyper)), atol=1e-12)
        assert np.linalg.eigvalsh(kernel(x, x, hyper)).min() > -1e-10


@pytest.mark.parametrize("family", FAMILIES)
def test_an_odd_process_is_odd_and_knows_nothing_on_the_mirror(family):
    x, _, y, at, _ = data()
    process = GaussianProcess.condition(Hyperparameters(ODD, 0.2, NONE, family), x, bare(60), y)
    np.testing.assert_allclose(process.mean(at * TURN), -process.mean(at), atol=1e-10)
    np.testing.assert_allclose(process.variance(at * TURN), process.variance(at), atol=1e-10)
    assert np.abs(process.mean(at)).max() > 0.5
    there = at * (TURN > 0.0)
    np.testing.assert_allclose([process.mean(there), process.variance(there)], 0.0, atol=1e-6)


def test_batches_do_not_show(monkeypatch):
    x, phi, y, at, phi_at = data()
    process = GaussianProcess.condition(Hyperparameters(SUM, 0.3, SIGMA), x, phi, y)
    whole = process.mean(at, phi_at), process.variance(at, phi_at)
    monkeypatch.setattr(gaussian_process, "BATCH", 7)
    for a, b in zip(whole, (process.mean(at, phi_at), process.variance(at, phi_at)), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)
    assert process.mean(at[:0], phi_at[:0]).shape == process.variance(at[:0]).shape == (0,)


@pytest.mark.parametrize("family", FAMILIES)
def test_inputs_far_from_zero_lose_no_digits(family):
    x, _, y, at, _ = data(30)
    hyper = plain(LENGTHS, 1.5, 0.2, family=family)
    near, far = (GaussianProcess.condition(hyper, x + shift, bare(30), y) for shift in (0.0, 1e4))
    np.testing.assert_allclose(far.mean(at + 1e4), near.mean(at), atol=1e-5)
    np.testing.assert_allclose(far.variance(at + 1e4), near.variance(at), atol=1e-5)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"noise": 0.0}, "noise"),
        ({"noise": np.nan}, "noise"),
        ({"weight_sigma": np.array([1.0, -1.0])}, "weight_sigma"),
        ({"weight_sigma": np.array([np.inf])}, "weight_sigma"),
        ({"family": "cubic"}, "family"),
        ({"terms": (KernelTerm((0,), np.array([0.0]), 1.0),)}, "lengthscales"),
        ({"terms": (SUM[0], KernelTerm((0,), np.array([np.nan]), 1.0))}, "lengthscales"),
        ({"terms": (SUM[0], KernelTerm((0,), np.array([1.0]), -1.0))}, "amplitude"),
    ],
)
def test_bad_numbers_are_named(change, key):
    with pytest.raises(ModelError, match=f"^{key}: got"):
        Hyperparameters(**{"terms": SUM, "noise": 0.1, "weight_sigma": SIGMA} | change)


def test_what_cannot_be_conditioned_says_so():
    x, phi, y, at, _ = data(20)
    hyper = plain(LENGTHS, 1.0, 0.3, SIGMA)
    for inputs, features in ((x[:5], phi), (x, phi[:5]), (x, phi[:, :1])):
        with pytest.raises(ModelError, match="for 20 values"):
            GaussianProcess.condition(hyper, inputs, features, y)
    with pytest.raises(ModelError, match="not positive definite"):
        GaussianProcess.condition(plain(LENGTHS, 1.0, 1e-3, 1e12 * SIGMA), x, phi, y)
    blind = replace(GaussianProcess.condition(hyper, x, phi, y), factor=np.zeros((0, 0)))
    assert np.isfinite(blind.mean(at)).all()
    with pytest.raises(ModelError, match="mean alone"):
        blind.variance(at)


def test_only_a_plain_kernel_has_one_term():
    assert Hyperparameters(SUM[:1], 0.1, NONE).only is SUM[0]
    for terms in (SUM, ODD):
        with pytest.raises(ModelError, match=r"^kernel: got"):
            _ = Hyperparameters(terms, 0.1, NONE).only
