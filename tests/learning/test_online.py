"""A process told a few rows at a time against the same process made at once, and what it forgets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gaussian_processes import plain
from scipy.stats import multivariate_normal

from mazeplan.core.errors import ModelError
from mazeplan.learning import fast_gp
from mazeplan.learning.gaussian_process import GaussianProcess, kernel
from mazeplan.learning.online_gp import RULES, OnlineProcess, Walk, novelty

HYPER = plain(np.linspace(0.8, 2.0, 9), 0.7, 0.4)
WALK = Walk(0.05, np.array([0.2, 0.05]))


def some(n, age, seed):
    """inputs (n, 9), features (n, 2), y (n,), ages (n,) of rows that look alike in part."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, 9)), rng.normal(size=(n, 2)), rng.normal(size=n), np.full(n, float(age))


def told(*parts):
    rows = OnlineProcess.begin(HYPER, WALK)
    for part in parts:
        rows = rows.added(*part)
    return rows


def by_formula(rows):
    """C entry by entry, as the module's formula stands."""
    n = len(rows)
    C = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            m = min(rows.age[i], rows.age[j])
            k = kernel(rows.inputs[i : i + 1], rows.inputs[j : j + 1], HYPER)[0, 0]
            weights = np.sum(rows.features[i] * WALK.weights**2 * rows.features[j])
            C[i, j] = k * (1.0 + WALK.process * m) + weights * m
    return C + HYPER.noise**2 * np.eye(n)


PARTS = [some(70, 0, 1), some(15, 1, 2), some(1, 2, 3), some(20, 4, 4)]


def test_rows_added_in_blocks_are_the_same_as_all_at_once():
    blocks, whole = told(*PARTS), told(tuple(np.concatenate(p) for p in zip(*PARTS, strict=True)))
    C = by_formula(blocks)
    np.testing.assert_allclose(blocks.factor, np.linalg.cholesky(C), atol=1e-9)
    np.testing.assert_allclose(blocks.factor, whole.factor, atol=1e-12)
    np.testing.assert_allclose(blocks.alpha, np.linalg.solve(C, blocks.y), atol=1e-8)
    np.testing.assert_allclose(blocks.inverse(), np.linalg.inv(C), atol=1e-8)


@pytest.mark.parametrize("gone", [[0], [105], [3, 40, 41, 72, 88, 105], list(range(70)), list(range(0, 106, 2)), []])
def test_rows_removed_leave_what_the_others_make_alone(gone):
    rows = told(*PARTS)
    stay = np.setdiff1d(np.arange(len(rows)), gone)
    alone = OnlineProcess.begin(HYPER, WALK).added(rows.inputs[stay], rows.features[stay], rows.y[stay], rows.age[stay])
    left = rows.removed(np.array(gone, dtype=np.int64))
    np.testing.assert_allclose(left.factor, alone.factor, atol=1e-10)
    np.testing.assert_allclose(left.alpha, alone.alpha, atol=1e-9)
    np.testing.assert_array_equal(left.y, alone.y)


def test_a_thousand_updates_lose_no_digits():
    rows = told(some(60, 0, 5))
    for t in range(1, 300):
        rows = rows.added(*some(4, t, 100 + t)).within(60, t)
    fresh = OnlineProcess.begin(HYPER, WALK).added(rows.inputs, rows.features, rows.y, rows.age)
    np.testing.assert_allclose(rows.alpha, fresh.alpha, rtol=1e-8, atol=1e-9)


def test_without_new_rows_nothing_changes():
    x, _, y, age = some(50, 0, 6)
    rows = told((x, np.ones((50, 2)), y, age))
    plain = GaussianProcess.condition(HYPER, x, np.zeros((50, 0)), y)
    for now in (0, 3, 1000):
        np.testing.assert_allclose(rows.process(now).alpha, plain.alpha, atol=1e-10)
        np.testing.assert_array_equal(rows.weights(now)[0], 0.0)
    np.testing.assert_allclose(np.diag(rows.weights(7)[1]), 7 * WALK.weights**2)


def test_prediction_is_that_of_process_and_weights_and_of_the_formula():
    rows, now = told(*PARTS), 6.0
    at, phi, _, _ = some(30, now, 7)
    mean, variance = rows.predict(at, phi, now)
    np.testing.assert_allclose(mean, rows.process(now).mean(at) + phi @ rows.weights(now)[0], atol=1e-10)
    larger = told(*PARTS, (at, phi, np.zeros(30), np.full(30, now)))
    C = by_formula(larger)
    cross, C = C[106:, :106], C[:106, :106]
    np.testing.assert_allclose(mean, cross @ np.linalg.solve(C, rows.y), atol=1e-9)
    prior = np.diag(by_formula(larger))[106:] - HYPER.noise**2
    np.testing.assert_allclose(variance, prior - np.sum(cross.T * np.linalg.solve(C, cross.T), axis=0), atol=1e-9)


def test_evidence_is_the_likelihood_of_rows_given_those_that_are_here():
    rows, more = told(*PARTS), some(12, 7, 15)
    whole = rows.added(*more)

    def likelihood(r):
        return multivariate_normal(np.zeros(len(r)), by_formula(r)).logpdf(r.y)

    assert rows.evidence(*more) == pytest.approx(likelihood(whole) - likelihood(rows), abs=1e-7)
    assert OnlineProcess.begin(HYPER, WALK).evidence(*PARTS[0]) == pytest.approx(likelihood(told(PARTS[0])), abs=1e-7)


def test_a_weight_that_changes_is_followed_and_an_old_one_forgotten():
    rng = np.random.default_rng(8)
    rows = OnlineProcess.begin(HYPER, WALK)
    for t in range(1, 31):
        x, phi, _, age = some(25, t, 200 + t)
        true = np.array([0.3 if t < 16 else -0.9, 0.0])
        rows = rows.added(x, phi, phi @ true + 0.2 * rng.normal(size=25), age).within(200, t)
        if t == 15:
            assert rows.weights(t)[0] == pytest.approx([0.3, 0.0], abs=0.1)
    weights, covariance = rows.weights(30)
    assert weights == pytest.approx([-0.9, 0.0], abs=0.1)
    assert np.sqrt(covariance[0, 0]) < 0.2
    assert np.mean(rows.age < 16) < 0.2  # rows of the old weight have left


def test_what_is_removed_is_what_tells_least_of_now():
    parts = [some(25, 0, 10), some(15, 3, 11)]
    parts[1][0][7], parts[1][1][7] = parts[1][0][8] + 1e-3, parts[1][1][8]  # the same row twice
    rows, now, one_by_one = told(*parts), 5.0, []
    at = rows.inputs, rows.features, now
    left = np.arange(40)
    for _ in range(12):
        unsure = [np.sum(rows.removed(np.array([*one_by_one, i])).predict(*at)[1]) for i in left]
        one_by_one.append(int(left[int(np.argmin(unsure))]))
        left = np.delete(left, int(np.argmin(unsure)))
    assert novelty(rows, 12, now).tolist() == one_by_one
    assert len({32, 33} & set(one_by_one)) <= 1  # once one of the two is gone the other is news


def test_of_two_rows_at_one_place_the_older_goes_first():
    x, phi, y, _ = some(30, 0, 14)
    x[20], phi[20] = x[21], phi[21]
    age = np.full(30, 9.0)
    for old, new in ((20, 21), (21, 20)):
        age[old], age[new] = 2.0, 9.0
        order = novelty(told((x, phi, y, age)), 30, 9.0).tolist()
        assert order.index(old) < order.index(new)


@pytest.mark.parametrize("name", RULES)
def test_a_budget_is_kept_by_every_rule(name):
    rows = told(*PARTS).within(50, 4.0, name)
    assert len(rows) == 50
    assert len(told(*PARTS).within(106, 4.0, name)) == 106
    if name == "oldest":
        assert rows.age.min() == 0.0
        assert (rows.age > 0.0).sum() == 36


def test_the_same_row_a_hundred_times_and_rows_without_noise_stay_positive_definite():
    x, phi, y, age = some(1, 0, 11)
    quiet = OnlineProcess.begin(replace(HYPER, noise=1e-9), WALK)
    rows = quiet.added(*(np.repeat(part, 50, axis=0) for part in (x, phi, y, age)))
    for _ in range(2):
        rows = rows.added(*(np.repeat(part, 25, axis=0) for part in (x, phi, y, age)))
    assert np.isfinite(rows.alpha).all()
    assert rows.process(1.0).mean(x) == pytest.approx(y, rel=1e-3)
    assert np.isfinite(rows.within(30, 1.0).alpha).all()


@pytest.mark.parametrize("part", range(4))
def test_a_row_that_is_no_number_never_gets_in(part):
    row = list(some(3, 1, 12))
    row[part] = row[part].copy()
    row[part].flat[1] = np.nan
    with pytest.raises(ModelError, match="not finite"):
        told(*PARTS).added(*row)


def test_the_compiled_predictor_takes_it():
    rows = told(*PARTS)
    rng = np.random.default_rng(13)
    states = rng.normal(size=(40, 6)) * [3.0, 1.0, 0.05, 0.5, 0.05, 0.5]
    s, c = np.sin, np.cos
    theta, rate, beta, beta_dot, gamma, gamma_dot = states.T
    at = np.stack([rate, beta_dot, gamma_dot, s(theta), c(theta), s(beta), c(beta), s(gamma), c(gamma)], axis=1)
    process = rows.process(4.0)
    np.testing.assert_allclose(fast_gp.evaluate(fast_gp.pack(process), states)[0], process.mean(at), atol=1e-6)
