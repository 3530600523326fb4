"""Where roll-outs begin: what a filter with the model knows of angle and rate at that moment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ring_record import DT, RADII, Ball, Tilt, motion

from mazeplan.learning.rollout import PAST, angle_noise, causal_start
from mazeplan.learning.samples import RingSamples
from mazeplan.physics.ball_model import RingKinematics

BALL, TILT, N = Ball(RADII[3], viscous=0.4, wave=0.5), Tilt.drawn(4), 600
START = np.arange(80, 560, 7)


def accelerate(k):
    """The truth, as a model."""
    tilt = (k.beta, k.beta_dot, k.beta_ddot, k.gamma, k.gamma_dot, k.gamma_ddot)
    return BALL.acceleration(k.theta, k.theta_dot, tilt)


def record(noise, segment=None):
    t = np.arange(N) * DT
    theta, rate, acceleration = motion(BALL, TILT, t)
    measured = theta + noise * np.random.default_rng(3).standard_normal(N)
    k = RingKinematics(RADII[3], theta, rate, *TILT.at(t))
    segment = np.zeros(N, dtype=np.int64) if segment is None else segment
    return RingSamples(3, DT, k, acceleration, measured, segment, np.arange(N), np.ones(N, dtype=bool))


def test_noise_of_an_angle_is_found_through_motion_and_impacts():
    samples = record(0.004)
    hit = samples.measured.copy()
    hit[300:] += 0.3
    for measured in (samples.measured, hit):
        assert angle_noise(replace(samples, measured=measured)) == pytest.approx(0.004, rel=0.15)


def test_the_right_model_knows_the_rate_better_than_differences_do():
    samples = record(0.004)
    theta, rate = causal_start(accelerate, samples, START, 0.004, 0.5)
    error = rate - samples.k.theta_dot[START]
    differences = (samples.measured[START] - samples.measured[START - 3]) / (3.0 * DT) - samples.k.theta_dot[START]
    assert np.std(error) < 0.05
    assert np.std(error) < 0.6 * np.std(differences)
    assert np.std(theta - samples.k.theta[START]) < 0.003


def test_later_samples_and_those_long_ago_have_no_say():
    samples = record(0.004)
    row = np.array([200])
    before = causal_start(accelerate, samples, row, 0.004, 0.5)
    other = samples.measured.copy()
    other[201:] += 1.0
    other[: 200 - PAST] -= 1.0
    after = causal_start(accelerate, replace(samples, measured=other), row, 0.004, 0.5)
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
    other[200] += 0.01
    assert before[0] != causal_start(accelerate, replace(samples, measured=other), row, 0.004, 0.5)[0]


def test_another_stretch_has_no_say():
    segment = (np.arange(N) >= 190).astype(np.int64)
    samples = record(0.0, segment)
    jumped = replace(samples, measured=samples.measured + 5.0 * (segment == 0))
    row = np.array([190, 193, 200])
    theta, rate = causal_start(accelerate, jumped, row, 1e-4, 0.5)
    assert np.array_equal((theta, rate), causal_start(accelerate, samples, row, 1e-4, 0.5))
    assert theta == pytest.approx(samples.k.theta[row], abs=1e-3)
    assert rate[0] == 0.0  # of a single sample nothing is known
    assert rate[2] == pytest.approx(samples.k.theta_dot[200], abs=0.1)
