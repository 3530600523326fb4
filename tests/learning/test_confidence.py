"""Bands around roll-outs: on records of a known ball, whose doubts are known, too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ring_record import DT, RADII, Ball, Tilt

from mazeplan.learning.ball_models import LinearBall
from mazeplan.learning.confidence import (
    DRAWS,
    HIGH,
    LOW,
    ConfidenceOptions,
    band,
    confidence,
    residual_stretches,
)
from mazeplan.learning.features import paper_features
from mazeplan.learning.fitting import Fitted, correlation_time, fit_kind
from mazeplan.learning.linear import fit_linear
from mazeplan.learning.rollout import STEPS, choose_windows
from mazeplan.learning.samples import RingSamples
from mazeplan.physics.formulas.arrays import RingKinematics

BALL, TILT, NOISE = Ball(RADII[3], viscous=0.4), Tilt.drawn(4), 2e-3


@pytest.fixture(scope="module")
def rough():
    """100 s of a ball that is pushed at random, its angle measured with NOISE rad."""
    rng, n = np.random.default_rng(1), 3000
    t = np.arange(n) * DT
    tilt = TILT.at(t)
    theta, rate = np.zeros(n), np.zeros(n)
    push = 2.0 * rng.standard_normal(n)  # rad/s^2
    total = np.zeros(n)
    for i in range(n - 1):
        now = [part[i] for part in tilt]
        total[i] = float(BALL.acceleration(theta[i], rate[i], now)) + push[i]
        theta[i + 1] = theta[i] + DT * rate[i] + 0.5 * DT * DT * total[i]
        rate[i + 1] = rate[i] + DT * total[i]
    total[-1] = total[-2]
    k = RingKinematics(RADII[3], theta, rate, *tilt)
    measured = theta + NOISE * rng.standard_normal(n)
    return RingSamples(3, DT, k, total, measured, np.zeros(n, dtype=np.int64), np.arange(n), np.ones(n, dtype=bool))


@pytest.fixture(scope="module")
def fitted(rough):
    return fit_kind("pi", rough, np.arange(1500))


def bands(fitted, rough, rollouts=4000, rates="smoothed", **other):
    mask = np.arange(len(rough)) >= 1500
    windows = choose_windows(rough, mask)
    rng = np.random.default_rng(0)
    test = replace(rough, **other)
    options = ConfidenceOptions(rollouts)
    return confidence(fitted, rough, np.arange(1500), test, windows, rates, 1.0, rng, options)


@pytest.mark.parametrize("rates", ["smoothed", "delayed"])
def test_nine_of_ten_measured_angles_lie_in_the_band(rough, fitted, rates):
    found = bands(fitted, rough, rates=rates)
    assert found.rollouts == 4000
    assert found.low.shape == (80, STEPS + 1)
    assert 0.8 < np.mean(found.coverage[1:]) < 0.97
    width = np.mean(found.high - found.low, axis=0)
    assert (np.diff(width) > 0.0)[2:].all()
    off = np.quantile(found.measured - found.middle, [LOW, HIGH], axis=0)
    assert width[40] == pytest.approx((off[1] - off[0])[40], rel=0.25)  # no wider than it must be
    assert (found.low < found.middle).all()
    assert (found.middle < found.high).all()


def test_one_more_draw_lies_in_the_band_nine_times_of_ten():
    rng = np.random.default_rng(0)
    drawn, more = rng.standard_normal((DRAWS, 40_000)), rng.standard_normal(40_000)
    low, middle, high = band(drawn)
    assert np.mean((low <= more) & (more <= high)) == pytest.approx(HIGH - LOW, abs=0.01)
    assert np.mean(more <= middle) == pytest.approx(0.5, abs=0.01)


def test_a_model_that_thinks_nothing_is_left_over_is_too_sure(rough, fitted):
    calm = replace(rough, theta_ddot=fitted.model.mean(rough.k))
    mask = np.arange(len(rough)) >= 1500
    windows, rng = choose_windows(rough, mask), np.random.default_rng(0)
    found = confidence(fitted, calm, np.arange(1500), rough, windows, "smoothed", 1.0, rng, ConfidenceOptions(4000))
    assert found.coverage[40] < 0.75


def test_few_data_make_a_wide_band(rough, fitted):
    rows = np.arange(12)
    few = Fitted(LinearBall(fit_linear(paper_features(rough.at(rows)), rough.theta_ddot[rows])))
    wide, narrow = (bands(model, rough, 1000) for model in (few, fitted))
    assert np.mean((wide.high - wide.low)[:, 40]) > 1.5 * np.mean((narrow.high - narrow.low)[:, 40])


def test_stretches_left_over_are_wholly_among_the_rows(rough, fitted):
    rng = np.random.default_rng(0)
    left = residual_stretches(fitted.model, rough, np.r_[100:160, 200:230], rng)
    assert left.shape == (20, STEPS + 1)  # none in 30 rows
    expected = (rough.theta_ddot - fitted.model.mean(rough.k))[100:141]
    np.testing.assert_allclose(left[np.argmin(np.abs(left[:, 0] - expected[0]))], expected)
    assert len(residual_stretches(fitted.model, rough, np.arange(30), rng)) == 0


def test_what_is_left_over_is_counted_once_unless_it_repeats(rough):
    rng = np.random.default_rng(0)
    each = rng.standard_normal((200, STEPS + 1))
    assert correlation_time(each) == 1.0
    assert correlation_time(np.zeros((0, STEPS + 1))) == 1.0
    held = np.repeat(rng.standard_normal((200, 11)), 4, axis=1)[:, : STEPS + 1]
    assert 3.0 < correlation_time(held) < 5.0
