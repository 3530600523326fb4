"""The compiled mean against the plain one, its derivatives, what culling leaves out, and the variance of few rows."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from finite_differences import jacobian
from gaussian_processes import nearest_variance, plain, state_gradient, state_inputs
from numba import njit

from mazeplan.core.errors import ModelError
from mazeplan.core.maths.exponential import exp2_below, exp_below
from mazeplan.learning import fast_gp
from mazeplan.learning.fast_gp import BINS, HEAD, RANGES, D, evaluate, pack
from mazeplan.learning.features import inputs
from mazeplan.learning.gaussian_process import GaussianProcess, Hyperparameters, KernelTerm
from mazeplan.physics.formulas.arrays import RingKinematics

SPREAD = np.array([math.pi, 2.0, 0.08, 0.5, 0.08, 0.5])  # of states: rad, rad/s
SCALES = np.array([1.5, 0.8, 0.8, 0.3, 0.3, 0.1, 0.02, 0.1, 0.02])  # length scales in the order of the inputs
THETA = np.eye(6)[0]
TABLE = fast_gp._TABLE
SIZE = 1 + 2 * RANGES  # numbers of one bin in the table


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


def assert_agreement(gp, states):
    """Mean within 1e-6 rad/s^2, derivatives within 1e-6 of the largest of their column (and of 1)."""
    mean, by_state = evaluate(pack(gp), states)
    wanted, slopes = exact(gp, states)
    np.testing.assert_allclose(mean, wanted, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(by_state, slopes, rtol=1e-6, atol=1e-6 / gp.hyper.only.lengthscales.min())


def ranges_of(packed, i):
    """Ranges of rows of bin i, (R, 2)."""
    at = TABLE + i * SIZE
    return packed[at + 1 : at + 1 + 2 * int(packed[at])].reshape(-1, 2).astype(int)


def reached(packed):
    """How many rows a query in each bin looks at, (BINS,)."""
    return np.array([(part := ranges_of(packed, i))[:, 1].sum() - part[:, 0].sum() for i in range(BINS)])


@pytest.mark.parametrize("n", [1, 2, 3, 127, 128, 129, 400, 1500])
def test_mean_and_derivatives_are_those_of_the_process(n):
    rng = np.random.default_rng(n)
    gp = process(drawn(rng, n))
    assert np.abs(exact(gp, drawn(rng, 50))[0]).max() > 1e-3  # something to compare
    assert_agreement(gp, drawn(rng, 200, turns=9.0))


@pytest.mark.parametrize("theta", [0.05, 0.1, 0.3, 1.0, 5.0])
def test_at_any_length_scale_in_theta(theta):
    rng = np.random.default_rng(5)
    rows = drawn(rng, 500)
    gp = process(rows, scales(theta))
    assert_agreement(gp, drawn(rng, 200, turns=5.0))
    assert_agreement(gp, rows[:50])  # at its own rows
    assert_agreement(gp, rows[:50] + 0.3 * theta * THETA)


def test_edges_of_bins_belong_to_one_of_both():
    rng = np.random.default_rng(7)
    edges = -math.pi + 2.0 * math.pi / BINS * np.arange(BINS + 1)
    rows = drawn(rng, BINS + 1)
    rows[:, 0] = edges  # rows on the edges, too
    gp = process(rows, scales(0.05))
    for shift in (-1e-12, 0.0, 1e-12, 1e-3, -1e-3, 4.0 * math.pi):
        states = drawn(rng, BINS + 1)
        states[:, 0] = edges + shift
        assert_agreement(gp, states)


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
    assert math.isnan(fast_gp.mean(packed, 0, state))


def clustered(rng, clusters=40, each=30):
    """Rows in narrow clusters in theta, with empty bins between them."""
    centres = -math.pi + 2.0 * math.pi * (np.arange(clusters) + 0.5) / clusters
    rows = drawn(rng, clusters * each)
    rows[:, 0] = np.repeat(centres, each) + 0.01 * rng.uniform(-1, 1, clusters * each)
    return rows


def test_many_clusters_are_joined_into_few_ranges_without_losing_a_row():
    rng = np.random.default_rng(11)
    gp = process(clustered(rng), np.array([1.5, 0.8, 0.8, 0.05, 5.0, 0.1, 0.02, 0.1, 0.02]))  # both sides of sin(theta)
    packed = pack(gp)
    counts = packed[TABLE:HEAD:SIZE]
    assert counts.max() <= RANGES
    assert counts.max() > 1
    assert_agreement(gp, drawn(rng, 400, turns=3.0))


def test_culling_leaves_out_more_the_rougher_the_process_is():
    rng = np.random.default_rng(12)
    gp, looked_at = process(drawn(rng, 600)), {}
    for theta in (0.05, 0.1, 0.3, 5.0):
        hyper = plain(scales(theta), 2.0, 0.3)  # with the weights of another, which is all the same
        looked_at[theta] = reached(pack(replace(gp, hyper=hyper))).mean()
    assert looked_at[5.0] == 600
    assert looked_at[0.05] < 0.3 * 600
    assert looked_at[0.05] < looked_at[0.1] < looked_at[0.3] <= 600


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


def test_the_mean_alone_is_the_same_anywhere_in_a_longer_vector():
    rng = np.random.default_rng(14)
    gp = process(drawn(rng, 300))
    packed, states = pack(gp), drawn(rng, 30)
    longer = np.concatenate([rng.standard_normal(37), packed])
    means, slopes = evaluate(packed, states)
    for state, mean, slope in zip(states, means, slopes, strict=True):
        by_state = np.full(6, np.nan)
        assert fast_gp.mean(packed, 0, state) == pytest.approx(mean, abs=1e-12)
        assert fast_gp.mean(longer, 37, state) == pytest.approx(mean, abs=1e-12)
        assert fast_gp.mean_and_gradient(longer, 37, state, by_state) == pytest.approx(mean, abs=1e-12)
        np.testing.assert_allclose(by_state, slope, atol=1e-12)


def test_derivatives_equal_finite_differences():
    rng = np.random.default_rng(15)
    packed = pack(process(drawn(rng, 300), scales(1.0)))
    for state in drawn(rng, 20):
        numeric = jacobian(lambda s: fast_gp.mean(packed, 0, s), state, 1e-4)
        np.testing.assert_allclose(evaluate(packed, state[None])[1][0], numeric, rtol=1e-5, atol=1e-5)


@njit
def exp_of(x):
    out = np.empty_like(x)
    for i in range(len(x)):
        out[i] = exp_below(x[i])
    return out


def test_exp_is_that_of_the_library():
    x = np.concatenate([np.linspace(-700.0, 0.0, 125), [-1e-300, -1e-9, -0.34657359027997264, 1e-12]])
    np.testing.assert_allclose(exp_of(x), np.exp(x), rtol=4e-14)  # above 0 only by rounding


@njit
def exp2_of(x):
    out = np.empty_like(x)
    for i in range(len(x)):
        out[i] = exp2_below(x[i])
    return out


def test_powers_of_two_are_those_of_the_library():
    x = np.concatenate([np.linspace(-1000.0, 0.0, 5001), [-1e-300, -1e-9, -0.5, -0.5 - 1e-15, -1.5, 1e-12]])
    np.testing.assert_allclose(exp2_of(x), np.exp2(x), rtol=2e-12)


@pytest.mark.parametrize("columns", [(0, 1, 2, 3, 4, 5, 7), (0, 3, 4), (0, 1, 2, 3, 4, 5, 6, 7), (0, 5, 7)])
def test_a_kernel_that_does_not_look_at_all_inputs(columns):
    """The loop without the cosines of the tilt is one of its own; other inputs left out are carried along."""
    rng = np.random.default_rng(21)
    states = drawn(rng, 300)
    x, y = inputs(kinematics(states)), np.sin(3.0 * states[:, 0]) + states[:, 1] + 9.0 * states[:, 2]
    hyper = Hyperparameters((KernelTerm(columns, SCALES[list(columns)], 2.0),), 0.3, np.zeros(0))
    gp = GaussianProcess.condition(hyper, x, np.zeros((len(x), 0)), y)
    assert_agreement(gp, drawn(rng, 200))
    packed, gap = pack(gp), np.empty(D)
    for state in drawn(rng, 20):
        exact_one = nearest_variance(gp, inputs(kinematics(state[None])))[0]
        assert fast_gp.variance(packed, 0, state, 0.09, gap) == pytest.approx(exact_one, abs=1e-6)


def test_another_kernel_is_refused():
    gp = process(drawn(np.random.default_rng(16), 10))
    with pytest.raises(ModelError, match="family: got a kernel exponential, expected rbf"):
        pack(replace(gp, hyper=replace(gp.hyper, family="exponential")))
    term = gp.hyper.only
    with pytest.raises(ModelError, match="plain kernel"):
        pack(replace(gp, hyper=replace(gp.hyper, terms=(term, KernelTerm(term.columns, term.lengthscales, 1.0)))))


# --- variance ---
