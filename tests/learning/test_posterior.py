"""Functions drawn from the posterior of a Gaussian process have its mean and variance."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mazeplan.core.errors import ModelError
from mazeplan.learning.gaussian_process import GaussianProcess, Hyperparameters, KernelTerm
from mazeplan.learning.posterior import ProcessDraws

ODD = (-1.0, -1.0, 1.0)


def drawn_from(family, features=1):
    """A process of a plain and an odd term on three inputs, and states to ask it in: rows of its own, and others."""
    rng = np.random.default_rng(3)
    x = rng.uniform(-1.0, 1.0, (40, 3))
    phi = x[:, :features] + 0.5
    terms = (KernelTerm((0, 1), np.array([0.5, 0.8]), 1.5), KernelTerm((0, 1, 2), np.array([0.7, 0.6, 0.9]), 0.8, ODD))
    hyper = Hyperparameters(terms, 0.2, np.full(features, 0.7), family)
    gp = GaussianProcess.condition(hyper, x, phi, np.sin(3.0 * x[:, 0]) + x[:, 2])
    at = np.concatenate([x[:4], rng.uniform(-2.0, 2.0, (8, 3))])
    return gp, at, at[:, :features] + 0.5


@pytest.mark.parametrize("family", ["rbf", "exponential"])
def test_functions_drawn_of_a_process_have_its_mean_and_variance(family):
    gp, at, phi = drawn_from(family)
    count = 1500
    draws = ProcessDraws(gp, gp, count, np.random.default_rng(4))
    each = draws.mean(np.tile(at, (count, 1)), np.tile(phi, (count, 1))).reshape(count, len(at))
    mean, variance = gp.mean(at, phi), gp.variance(at, phi)
    assert variance.min() < 0.3 < 1.5 < variance.max()
    np.testing.assert_allclose(each.mean(axis=0), mean, atol=4.0 * math.sqrt(variance.max() / count))
    # the waves are as many as they are: a variance is off by some percent where the data say nothing
    np.testing.assert_allclose(each.var(axis=0), variance, rtol=0.25)
    one = draws.mean(np.tile(at[0], (count, 1)), np.tile(phi[0], (count, 1)))  # a function has one value in one state
    np.testing.assert_allclose(one, each[:, 0], atol=1e-9)


def test_the_middle_of_the_draws_may_be_another_process_on_the_same_rows():
    gp, at, phi = drawn_from("exponential")
    other = replace(gp, alpha=0.5 * gp.alpha, weights=gp.weights + 2.0)
    count, found = 300, []
    for centre in (gp, other):
        draws = ProcessDraws(gp, centre, count, np.random.default_rng(4))
        found.append(draws.mean(np.tile(at, (count, 1)), np.tile(phi, (count, 1))).reshape(count, len(at)))
    expected = np.tile(other.mean(at, phi) - gp.mean(at, phi), (count, 1))
    np.testing.assert_allclose(found[1] - found[0], expected, atol=1e-8)


def test_a_process_without_its_factor_cannot_be_drawn_from():
    gp, _, _ = drawn_from("rbf")
    with pytest.raises(ModelError, match="for its mean alone"):
        ProcessDraws(replace(gp, factor=np.zeros((0, 0))), gp, 3, np.random.default_rng(0))
