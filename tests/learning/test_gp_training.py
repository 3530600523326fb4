"""Training finds what data were drawn from, and is as good as another optimiser."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gaussian_processes import log_likelihood, plain
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process import kernels as sklearn_kernels

from mazeplan.learning.features import effect_features, inputs
from mazeplan.learning.gaussian_process import FAMILIES, GaussianProcess, Hyperparameters, KernelTerm, kernel
from mazeplan.learning.gp_training import Posterior, TrainingOptions, train
from mazeplan.physics.ball_model import RingKinematics

KERNELS: Any = sklearn_kernels
PLAIN = (((0, 1), ()),)
ODD = (*PLAIN, ((1, 0), (1.0, -1.0)))
QUICK = TrainingOptions(first=150, rows=150, starts=1, iterations=15, refinement=15, terms=PLAIN)


def bare(n):
    return np.zeros((n, 0))


def draw(hyper, n, seed=0):
    """Inputs (n, 2) of unlike units, features of unlike sizes, and values drawn from the process."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1.0, 1.0, (n, 2)) * [3.0, 30.0] + [0.5, 100.0]
    phi = rng.normal(size=(n, len(hyper.weight_sigma))) * ([10.0, 0.1] if len(hyper.weight_sigma) else 1.0)
    C = kernel(x, x, hyper) + (phi * hyper.weight_sigma**2) @ phi.T + hyper.noise**2 * np.eye(n)
    return x, phi, np.linalg.cholesky(C) @ rng.standard_normal(n)


@pytest.mark.parametrize("family", FAMILIES)
def test_hyperparameters_come_back(family):
    known = plain(np.array([1.0, 15.0]), 20.0, 6.0, family=family)
    x, phi, y = draw(known, 300, seed=3)
    found = train(x, phi, y, replace(QUICK, first=300, rows=300, family=family))
    assert found.family == family
    assert found.noise == pytest.approx(6.0, rel=0.15)
    lengths, amplitude = found.only.lengthscales, found.only.amplitude
    if family == "rbf":
        assert amplitude == pytest.approx(20.0, rel=0.2)
        np.testing.assert_allclose(lengths, [1.0, 15.0], rtol=0.2)
    else:  # of a rough process a bounded place tells how fast it moves away, not how far it would get
        np.testing.assert_allclose(amplitude**2 / lengths, 20.0**2 / np.array([1.0, 15.0]), rtol=0.3)
    assert log_likelihood(found, x, phi, y) > log_likelihood(known, x, phi, y) - 1.0


@pytest.mark.parametrize("family", FAMILIES)
def test_as_likely_as_the_optimum_of_scikit_learn(family):
    x, phi, y = draw(plain(np.array([1.5, 20.0]), 3.0, 1.0, family=family), 150, seed=1)
    ours = train(x, phi, y, replace(QUICK, refinement=40, family=family))
    shape = KERNELS.RBF([1.0, 10.0]) if family == "rbf" else KERNELS.Matern([1.0, 10.0], nu=0.5)
    form = KERNELS.ConstantKernel(4.0) * shape + KERNELS.WhiteKernel(0.1)
    fit: Any = GaussianProcessRegressor(form).fit(x, y)
    best = fit.kernel_.get_params()
    term = KernelTerm((0, 1), best["k1__k2__length_scale"], float(np.sqrt(best["k1__k1__constant_value"])))
    theirs = Hyperparameters((term,), float(np.sqrt(best["k2__noise_level"])), np.zeros(0), family)
    assert log_likelihood(ours, x, phi, y) > log_likelihood(theirs, x, phi, y) - 0.5  # for the priors; of about -200


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("terms", [PLAIN, ODD], ids=["plain", "odd"])
@pytest.mark.parametrize("sigma", [np.zeros(0), np.array([0.2, 30.0])], ids=["bare", "features"])
def test_the_gradient_is_that_of_finite_differences(family, terms, sigma):
    x, phi, y = draw(plain(np.array([1.5, 20.0]), 3.0, 0.5, sigma, family), 40)
    scaled = (x - x.mean(axis=0)) / x.std(axis=0), phi, y / y.std()
    posterior = Posterior(scaled, terms, family)
    q = posterior.start(np.random.default_rng(1), 1)
    _, gradient = posterior(q)
    assert len(q) == 3 * len(terms) + 1 + len(sigma)
    numeric = [(posterior(q + e)[0] - posterior(q - e)[0]) / 2e-5 for e in 1e-5 * np.eye(len(q))]
    np.testing.assert_allclose(gradient, numeric, rtol=1e-4, atol=1e-7)


def test_weights_of_physics_come_back_with_their_units():
    rng = np.random.default_rng(4)
    n, known = 200, {"rolling": 0.58, "viscous": 0.35, "dry": 0.5, "beta": 0.004, "gamma": -0.006}
    angle = rng.uniform(-np.pi, np.pi, n), rng.uniform(-0.09, 0.09, n), rng.uniform(-0.09, 0.09, n)
    rate = rng.normal(0.0, 3.0, n), rng.normal(0.0, 0.3, n), rng.normal(0.0, 0.3, n)
    k = RingKinematics(0.0892, angle[0], rate[0], angle[1], rate[1], 0.0 * rate[1], angle[2], rate[2], 0.0 * rate[2])
    x, phi = inputs(k), effect_features(k)
    weights = np.array([known["rolling"], known["viscous"], known["dry"], 0.58 * known["beta"], 0.58 * known["gamma"]])
    ripple = 0.8 * np.sin(3.0 * k.theta)  # a force that no feature has
    y = phi @ weights + ripple + rng.normal(0.0, 0.5, n)
    options = TrainingOptions(first=n, rows=n, starts=1, iterations=15, refinement=15)
    process = GaussianProcess.condition(train(x, phi, y, options), x, phi, y)
    deviation = np.sqrt(np.diag(process.covariance))
    assert (np.abs(process.weights - weights) < 3.0 * deviation).all()
    assert (deviation < [0.1, 0.2, 0.3, 0.01, 0.01]).all(), "an interval as wide as the prior says nothing"
    left = np.sqrt(np.mean((process.mean(x, phi) - phi @ weights - ripple) ** 2))
    assert left < 0.3


def test_the_same_seed_gives_the_same_and_starts_are_several():
    x, phi, y = draw(plain(np.array([1.5, 20.0]), 3.0, 0.5), 60)
    short = replace(QUICK, starts=3, iterations=2, refinement=2)
    first, again, other = (train(x, phi, y, replace(short, seed=seed)).only.lengthscales for seed in (7, 7, 8))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    posterior, drawn = Posterior((x, phi, y), PLAIN, "rbf"), np.random.default_rng(7)
    starts = [tuple(posterior.start(drawn, number)) for number in range(3)]
    assert len(set(starts)) == 3
    assert starts[0] == tuple(posterior.start(np.random.default_rng(8), 0)), "a sensible place, not a drawn one"
