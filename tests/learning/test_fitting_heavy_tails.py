"""Noise of each row: blows are found out, and bend the expectation less."""

from __future__ import annotations

import numpy as np
import pytest
from gaussian_processes import plain

from mazeplan.learning.fitting import FREEDOM, cross_residuals, row_noise, typical
from mazeplan.learning.gaussian_process import GaussianProcess

NOISE = 0.1
HYPER = plain(np.array([0.7]), 1.0, NOISE, np.array([2.0]))
LEAST = NOISE * np.sqrt(FREEDOM[0] / (FREEDOM[0] + 1.0))  # with the heaviest tails


def truth(x):
    """(n,) at (n, 1)."""
    return np.sin(2.0 * x[:, 0]) + 0.5 * x[:, 0]


def record(n=400, seed=0, every=60):
    """A sine and a line of which noisy values are taken, and every so many rows a blow of the same direction that takes
    three rows: inputs (n, 1), features (n, 1), values (n,), which rows are blown (n,)."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-3.0, 3.0, (n, 1))
    blown = np.arange(n) % every < 3 if every else np.zeros(n, dtype=bool)
    return x, x.copy(), truth(x) + rng.normal(0.0, NOISE, n) + 4.0 * blown, blown


def test_rows_of_a_blow_are_noisy_and_others_are_not():
    x, phi, y, blown = record()
    noise = row_noise(HYPER, x, phi, y)
    assert noise.shape == (400,)
    assert noise[blown].min() > 4.0 * np.median(noise[~blown])
    assert noise.min() >= LEAST
    assert np.median(noise[~blown]) < 1.2 * NOISE


def test_blows_bend_the_expectation_less():
    x, phi, y, _ = record()
    plain = GaussianProcess.condition(HYPER, x, phi, y)
    robust = typical(plain, y)
    at = np.linspace(-2.8, 2.8, 50)[:, None]
    error = [float(np.mean(np.abs(process.mean(at, at) - truth(at)))) for process in (plain, robust)]
    assert error[0] > 0.15, "the blows must matter"
    assert error[1] < 0.3 * error[0]


def test_a_row_has_no_part_in_what_it_leaves_over():
    x, phi, y, _ = record(every=0)
    moved = y.copy()
    moved[100] += 7.0  # were it in, less than that would be left
    change = cross_residuals(HYPER, x, phi, moved) - cross_residuals(HYPER, x, phi, y)
    assert change[100] == pytest.approx(7.0)
    assert np.abs(change[101:105]).max() == 0.0, "its neighbours in time do not see it either"
    assert np.abs(change).max() == change[100]
