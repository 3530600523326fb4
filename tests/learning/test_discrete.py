"""The discrete map: it learns a step well, and is worse over forty of them than an equation of motion."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest
from ring_record import DT, RADII, Ball, Tilt, motion

from mazeplan.learning.fitting import DiscreteMap, FitOptions, fit_discrete, fit_kind, roll_out_discrete
from mazeplan.learning.gp_training import TrainingOptions
from mazeplan.learning.rollout import STEPS, choose_windows, roll_out
from mazeplan.learning.samples import RingSamples
from mazeplan.physics.ball_model import RingKinematics

QUICK = FitOptions(most=200, training=TrainingOptions(first=80, rows=120, starts=1, iterations=12, refinement=4))


def samples_of(theta, theta_dot, theta_ddot, tilt, segment=None, good=None):
    n = len(theta)
    return RingSamples(
        3,
        DT,
        RingKinematics(RADII[3], theta, theta_dot, *tilt),
        theta_ddot,
        theta,
        np.zeros(n, dtype=np.int64) if segment is None else segment,
        np.arange(n),
        np.ones(n, dtype=bool) if good is None else good,
    )


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    torch = pytest.importorskip("torch")
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def linear(n=400, segment=None, good=None, seed=0):
    """theta_{k+1} = theta_k + .3 v_k, v_{k+1} = .9 v_k + 2 beta_k + 1 gamma_k: small angles, so nearly linear in the
    inputs of the process too."""
    rng = np.random.default_rng(seed)
    beta, gamma = 0.1 * rng.standard_normal((2, n))
    theta, v = np.full(n, 0.2), np.zeros(n)
    for k in range(n - 1):
        v[k + 1] = 0.9 * v[k] + 2.0 * beta[k] + gamma[k]
        theta[k + 1] = 0.7 * theta[k] + 0.3 * v[k]
    zeros = np.zeros(n)
    return samples_of(theta, v, zeros, (beta, zeros, zeros, gamma, zeros, zeros), segment, good)


def test_pairs_do_not_reach_over_a_border():
    """What follows a row is learned only where it is good and of the same stretch."""
    rng = np.random.default_rng(2)
    n = 400
    whole = linear(n)
    theta, v = whole.k.theta.copy(), whole.k.theta_dot.copy()
    # every fifth row is rubbish, but it is not good, or a stretch of its own
    wild = np.arange(5, n, 5)
    segment, good = np.zeros(n, dtype=np.int64), np.ones(n, dtype=bool)
    half = len(wild) // 2
    good[wild[:half]] = False
    segment[wild[half:]] = 1 + np.arange(len(wild) - half)
    theta[wild], v[wild] = rng.uniform(-3.0, 3.0, (2, len(wild)))
    tilt = (whole.k.beta, whole.k.beta_dot, whole.k.beta_ddot, whole.k.gamma, whole.k.gamma_dot, whole.k.gamma_ddot)
    spoiled = samples_of(theta, v, np.zeros(n), tilt, segment, good)
    rows = np.setdiff1d(np.arange(n - 100), wild)
    model = fit_discrete(spoiled, rows, QUICK)
    expected = np.arange(n - 100, n - 1)
    _, rate = model.next(whole.at(expected))
    assert np.sqrt(np.mean((rate - whole.k.theta_dot[expected + 1]) ** 2)) < 0.05 * np.std(whole.k.theta_dot)
    assert len(fit_discrete(spoiled, np.arange(5), QUICK).rate) == 4  # what follows row 4 is not good


def test_it_rolls_out_step_by_step_along_the_measured_tilt():
    class Known:
        """The map of `linear`, known."""

        def next(self, k):
            return 0.7 * k.theta + 0.3 * k.theta_dot, 0.9 * k.theta_dot + 2.0 * k.beta + k.gamma

    samples = linear()
    start, known = np.array([10, 200]), cast(DiscreteMap, Known())
    done = roll_out_discrete(known, samples, start, samples.k.theta[start], samples.k.theta_dot[start])
    assert done.angle.shape == (2, STEPS + 1)
    assert done.angle == pytest.approx(samples.k.theta[start[:, None] + np.arange(STEPS + 1)], abs=1e-12)
    assert done.error.max() < 1e-12
    off = roll_out_discrete(known, samples, start, samples.k.theta[start] + 0.1, samples.k.theta_dot[start])
    assert off.error[:, :3] == pytest.approx(np.array([[0.1, 0.07, 0.049]] * 2))


def test_after_forty_steps_it_is_worse_than_the_equation_of_motion():
    t, ball = np.arange(1200) * DT, Ball(RADII[3], viscous=0.4, wave=0.5)
    tilt = Tilt.drawn(4)
    samples = samples_of(*motion(ball, tilt, t), tilt.at(t))
    rows, held = np.arange(800), np.arange(1200) >= 800
    windows = choose_windows(samples, held)
    begin = samples.k.theta[windows.start], samples.k.theta_dot[windows.start]
    discrete = roll_out_discrete(fit_discrete(samples, rows, QUICK), samples, windows.start, *begin)
    continuous = roll_out(fit_kind("sp", samples, rows, QUICK).mean, samples, windows.start, *begin)
    assert discrete.after(40) > 2.0 * continuous.after(40)
    assert continuous.after(40) < 0.15
