"""The compiled mean against the plain one, its derivatives, and what culling leaves out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from finite_differences import jacobian
from gaussian_processes import plain, state_gradient, state_inputs

from mazeplan.learning import fast_gp
from mazeplan.learning.fast_gp import BINS, mean_and_gradient, pack
from mazeplan.learning.features import inputs
from mazeplan.learning.gaussian_process import GaussianProcess, Hyperparameters, KernelTerm
from mazeplan.physics.ball_model import RingKinematics

SPREAD = np.array([math.pi, 2.0, 0.08, 0.5, 0.08, 0.5])  # of states: rad, rad/s
SCALES = np.array([1.5, 0.8, 0.8, 0.3, 0.3, 0.1, 0.02, 0.1, 0.02])  # length scales in the order of the inputs


def kinematics(states):
    zero = np.zeros(len(states))
    theta, theta_dot, beta, beta_dot, gamma, gamma_dot = states.T
    return RingKinematics(0.0689, theta, theta_dot, beta, beta_dot, zero, gamma, gamma_dot, zero)


def drawn(rng, n, turns=1.0):
    return SPREAD * [turns, 1, 1, 1, 1, 1] * rng.uniform(-1.0, 1.0, (n, 6))


def scales(theta=0.3):
    out = SCALES.copy()
    out[3:5] = theta
    return out


def process(states, lengthscales=SCALES, amplitude=2.0, noise=0.3, seed=0):
    """A process that fits a wavy function of theta and noise: its weights are as large as those of real data."""
    rng = np.random.default_rng(seed)
    y = 1.5 * np.sin(7.0 * states[:, 0]) - 0.3 * states[:, 1] + noise * rng.standard_normal(len(states))
    hyper = plain(np.asarray(lengthscales), amplitude, noise)
    return GaussianProcess.condition(hyper, inputs(kinematics(states)), np.zeros((len(states), 0)), y)


def exact(gp, states):
    return gp.mean(state_inputs(states)), state_gradient(gp, states)


def evaluate(packed, states):
    """Mean (N,) and its derivatives (N, 6) at states (N, 6)."""
    out = np.empty((len(states), 6))
    return np.array([mean_and_gradient(packed, 0, state, row) for state, row in zip(states, out, strict=True)]), out


def assert_agreement(gp, states):
    """Mean within 1e-6 rad/s^2, derivatives within 1e-6 of the largest of their column (and of 1)."""
    mean, by_state = evaluate(pack(gp), states)
    wanted, slopes = exact(gp, states)
    np.testing.assert_allclose(mean, wanted, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(by_state, slopes, rtol=1e-6, atol=1e-6 / gp.hyper.only.lengthscales.min())


@pytest.mark.parametrize("n", [1, 2, 3, 127, 128, 129, 400, 1500])
def test_mean_and_derivatives_are_those_of_the_process(n):
    rng = np.random.default_rng(n)
    gp = process(drawn(rng, n))
    assert np.abs(exact(gp, drawn(rng, 50))[0]).max() > 1e-3  # something to compare
    assert_agreement(gp, drawn(rng, 200, turns=9.0))


def test_far_from_all_rows_nothing_is_left():
    rng = np.random.default_rng(9)
    gp = process(drawn(rng, 300))
    for column, size in ((1, 1e3), (3, 1e4), (5, -1e150)):
        states = drawn(rng, 20)
        states[:, column] = size
        mean, by_state = evaluate(pack(gp), states)
        assert np.abs(mean).max() < 1e-9
        assert np.isfinite(by_state).all()
        assert np.abs(by_state[:, 1:]).max() < 1e-9
    assert_agreement(gp, 8.0 * drawn(rng, 200))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("column", range(6))
def test_a_state_that_is_no_number_gives_none_and_reads_no_other_memory(column, bad):
    packed = pack(process(drawn(np.random.default_rng(10), 40)))
    state = np.zeros(6)
    state[column] = bad
    mean, by_state = evaluate(packed, state[None])
    assert math.isnan(mean[0])
    assert np.isnan(by_state[0]).any()


@pytest.mark.slow
@pytest.mark.parametrize("pair", [(0.02, 0.02), (0.05, 0.3), (0.1, 0.02)])
def test_the_bound_holds_wherever_in_their_bins_query_and_rows_are(pair):
    """The worst of 17 x 17 places in every two bins, for value and derivative by a scaled input."""
    rng, fine = np.random.default_rng(20), np.linspace(0.0, 1.0, 17)
    at = -math.pi + 2.0 * math.pi / BINS * (np.arange(BINS)[:, None] + fine)
    flat = np.stack([np.sin(at) / pair[0], np.cos(at) / pair[1]], axis=-1).reshape(-1, 2)
    nearest = np.full((BINS, BINS), np.inf)
    for i in range(BINS):
        squares = ((flat[17 * i : 17 * (i + 1), None] - flat[None]) ** 2).sum(axis=-1)
        nearest[i] = np.sqrt(squares.reshape(17, BINS, 17).min(axis=(0, 2)))
    worst = 4.0 * np.exp(-0.5 * nearest**2) * np.maximum(nearest, 1.0)
    for size in np.geomspace(1.0, 1e4, 12):
        weights = size * rng.uniform(0.0, 1.0, BINS)
        needed = fast_gp._reach(np.array(pair), 2.0, weights)
        assert needed.mean() < 0.7  # and not by leaving out nothing
        assert np.where(needed, 0.0, worst * weights).sum(axis=1).max() <= fast_gp.TOLERANCE


def test_it_is_the_same_anywhere_in_a_longer_vector():
    rng = np.random.default_rng(14)
    gp = process(drawn(rng, 300))
    packed, states = pack(gp), drawn(rng, 30)
    longer = np.concatenate([rng.standard_normal(37), packed])
    means, slopes = evaluate(packed, states)
    for state, mean, slope in zip(states, means, slopes, strict=True):
        by_state = np.full(6, np.nan)
        assert fast_gp.mean_and_gradient(longer, 37, state, by_state) == pytest.approx(mean, abs=1e-12)
        np.testing.assert_allclose(by_state, slope, atol=1e-12)


def test_derivatives_equal_finite_differences():
    rng = np.random.default_rng(15)
    packed = pack(process(drawn(rng, 300), scales(1.0)))
    for state in drawn(rng, 20):
        numeric = jacobian(lambda s: evaluate(packed, s[None])[0][0], state, 1e-4)
        np.testing.assert_allclose(evaluate(packed, state[None])[1][0], numeric, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("columns", [(0, 1, 2, 3, 4, 5, 7), (0, 3, 4), (0, 1, 2, 3, 4, 5, 6, 7), (0, 5, 7)])
def test_a_kernel_that_does_not_look_at_all_inputs(columns):
    """The loop without the cosines of the tilt is one of its own; other inputs left out are carried along."""
    rng = np.random.default_rng(21)
    states = drawn(rng, 300)
    x, y = inputs(kinematics(states)), np.sin(3.0 * states[:, 0]) + states[:, 1] + 9.0 * states[:, 2]
    hyper = Hyperparameters((KernelTerm(columns, SCALES[list(columns)], 2.0),), 0.3, np.zeros(0))
    gp = GaussianProcess.condition(hyper, x, np.zeros((len(x), 0)), y)
    assert_agreement(gp, drawn(rng, 200))
