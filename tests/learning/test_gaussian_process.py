"""The process against scikit-learn, against plain matrix algebra, and against itself under symmetry."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gaussian_processes import plain
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process import kernels as sklearn_kernels

from mazeplan.learning.gaussian_process import (
    FAMILIES,
    GaussianProcess,
    Hyperparameters,
    KernelTerm,
    kernel,
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


def test_each_row_may_have_a_noise_of_its_own():
    x, phi, y, at, phi_at = data()
    hyper = Hyperparameters(SUM, 0.3, SIGMA)
    noise = np.random.default_rng(1).uniform(0.1, 3.0, len(y))
    process = GaussianProcess.condition(hyper, x, phi, y, noise)
    S = np.diag(SIGMA**2)
    whole = dense_kernel(x, x, hyper) + phi @ S @ phi.T + np.diag(noise**2)
    cross = dense_kernel(at, x, hyper) + phi_at @ S @ phi.T
    np.testing.assert_allclose(process.mean(at, phi_at), cross @ np.linalg.solve(whole, y), rtol=1e-7, atol=1e-7)
    same = GaussianProcess.condition(hyper, x, phi, y, np.full(len(y), 0.3))
    np.testing.assert_allclose(same.alpha, GaussianProcess.condition(hyper, x, phi, y).alpha, rtol=1e-12)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_mean_is_that_of_scikit_learn(family):
    x, _, y, at, _ = data()
    hyper = plain(LENGTHS, 1.7, 0.3, family=family)
    shape = KERNELS.RBF(LENGTHS) if family == "rbf" else KERNELS.Matern(LENGTHS, nu=0.5)
    regressor: Any = GaussianProcessRegressor
    other = regressor(KERNELS.ConstantKernel(1.7**2) * shape, alpha=0.3**2, optimizer=None).fit(x, y)
    mean = other.predict(at)
    ours = GaussianProcess.condition(hyper, x, bare(len(y)), y)
    np.testing.assert_allclose(ours.mean(at), mean, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_kernel_is_that_of_its_formula_and_positive(family):
    x, _, _, at, _ = data(20)
    for terms in (SUM, ODD):
        hyper = Hyperparameters(terms, 0.1, NONE, family)
        np.testing.assert_allclose(kernel(x, at, hyper), dense_kernel(x, at, hyper), atol=1e-12)
        assert np.linalg.eigvalsh(kernel(x, x, hyper)).min() > -1e-10


@pytest.mark.parametrize("family", FAMILIES)
def test_an_odd_process_is_odd_and_nothing_on_the_mirror(family):
    x, _, y, at, _ = data()
    process = GaussianProcess.condition(Hyperparameters(ODD, 0.2, NONE, family), x, bare(60), y)
    np.testing.assert_allclose(process.mean(at * TURN), -process.mean(at), atol=1e-10)
    assert np.abs(process.mean(at)).max() > 0.5
    there = at * (TURN > 0.0)
    np.testing.assert_allclose(process.mean(there), 0.0, atol=1e-6)


@pytest.mark.parametrize("family", FAMILIES)
def test_inputs_far_from_zero_lose_no_digits(family):
    x, _, y, at, _ = data(30)
    hyper = plain(LENGTHS, 1.5, 0.2, family=family)
    near, far = (GaussianProcess.condition(hyper, x + shift, bare(30), y) for shift in (0.0, 1e4))
    np.testing.assert_allclose(far.mean(at + 1e4), near.mean(at), atol=1e-5)
