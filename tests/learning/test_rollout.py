"""Windows and roll-outs: against motions integrated by scipy, and against windows chosen by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ring_record import DT, RADII, Ball, Tilt, motion

from mazeplan.learning.rollout import (
    MAX_OPENING_ANGLE,
    MIN_WINDOWS,
    STEPS,
    choose_windows,
    roll_out,
    roll_out_delayed,
)
from mazeplan.learning.samples import RingSamples
from mazeplan.physics.ball_model import RingKinematics

BALL = Ball(RADII[3], viscous=0.4, wave=0.5)
TILT = Tilt.drawn(4)


def samples_from(theta, theta_dot, theta_ddot, tilt, segment=None, good=None):
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


@pytest.fixture(scope="module")
def truth():
    """Noise-free samples of 20 s."""
    t = np.arange(600) * DT
    return samples_from(*motion(BALL, TILT, t), TILT.at(t))


def of(ball):
    """The ball's own equation as a model."""

    def accelerate(k):
        tilt = (k.beta, k.beta_dot, k.beta_ddot, k.gamma, k.gamma_dot, k.gamma_ddot)
        return ball.acceleration(k.theta, k.theta_dot, tilt)

    return accelerate


# --- roll-outs


def test_the_true_model_stays_on_the_truth(truth):
    start = choose_windows(truth, truth.good).start
    done = roll_out(of(BALL), truth, start, truth.k.theta[start], truth.k.theta_dot[start])
    assert done.angle.shape == done.error.shape == (len(start), STEPS + 1)
    rows = start[:, None] + np.arange(STEPS + 1)
    assert np.ptp(truth.k.theta[rows], axis=1).max() > 0.5  # they do go somewhere
    assert done.after(40) < 1e-3
    assert done.error.max() < 5e-3
    assert np.array_equal(done.error[:, 0], np.zeros(len(start)))
    assert np.array_equal(done.error, np.abs(done.angle - truth.k.theta[rows]))


def test_the_tilt_is_taken_from_the_rows_of_the_window(truth):
    def pushed(k):
        return k.beta_dot  # so the rate grows by what beta does

    start = np.array([100, 250])
    done = roll_out(pushed, truth, start, np.zeros(2), TILT.at(start * DT)[0])
    for window, row in enumerate(start):
        fine = np.linspace(row * DT, (row + STEPS) * DT, 4001)
        expected = np.trapezoid(TILT.at(fine)[0], fine)
        assert done.angle[window, STEPS] == pytest.approx(expected, abs=3e-4)  # of up to .08


def late_motion(ball, tilt, steps, fine=100):
    """theta (steps,) of a ball whose drag is that of the difference of angles two and three samples ago.

    An equation with memory, so it is integrated step by step (Stoermer), finely."""
    h, past = DT / fine, 3 * fine
    theta = np.full(past + steps * fine + 1, 0.3)
    t = (np.arange(len(theta)) - past) * h
    b, bd, bdd, g, gd, gdd = tilt.at(t)
    free = replace(ball, viscous=0.0)
    for i in range(past, len(theta) - 1):
        late = (theta[i - 2 * fine] - theta[i - 3 * fine]) / DT
        now = (b[i], bd[i], bdd[i], g[i], gd[i], gdd[i])
        push = free.acceleration(theta[i], (theta[i] - theta[i - 1]) / h, now) - ball.viscous * late
        theta[i + 1] = 2.0 * theta[i] - theta[i - 1] + h * h * push
    return theta, past, fine


def test_the_true_model_with_a_late_rate_stays_on_the_truth():
    fine_theta, past, fine = late_motion(BALL, TILT, 240)
    rows = past + fine * np.arange(3, 240)
    theta = fine_theta[rows]
    rate = (fine_theta[rows + 1] - fine_theta[rows - 1]) * 0.5 * fine / DT
    samples = samples_from(theta, rate, np.zeros(len(theta)), TILT.at(np.arange(3, 240) * DT))
    start = np.arange(5, len(theta) - STEPS, 13)
    done = roll_out_delayed(of(BALL), samples, start, theta[start], rate[start])
    assert done.angle.shape == (len(start), STEPS + 1)
    assert np.array_equal(done.angle[:, 0], theta[start])
    assert np.ptp(theta[start[:, None] + np.arange(STEPS + 1)], axis=1).max() > 0.5
    assert done.after(40) < 1e-3
    assert done.error.max() < 5e-3
    # the model is given the rate that it was trained with, and no other
    assert roll_out(of(BALL), samples, start, theta[start], rate[start]).after(40) > 1e-2


def test_at_first_the_late_rate_is_that_of_the_angles_measured(truth):
    measured = truth.measured + 0.01 * np.arange(len(truth)) ** 2 * DT  # an acceleration that k.theta does not have
    seen = []

    def spy(k):
        seen.append(k.theta_dot)
        return np.zeros_like(k.theta)

    start = np.array([50, 200])
    done = roll_out_delayed(spy, replace(truth, measured=measured), start, np.array([0.1, 0.2]), np.array([1.0, 2.0]))
    for i, here in ((0, start), (1, start + 1)):  # of rows -2 and -3, then -1 and -2
        assert seen[i] == pytest.approx((measured[here - 2] - measured[here - 3]) / DT)
    assert seen[2] == pytest.approx((np.array([0.1, 0.2]) - measured[start - 1]) / DT)
    assert seen[3] == pytest.approx([1.0, 2.0])
    assert done.angle[:, STEPS] == pytest.approx([0.1 + STEPS * DT, 0.2 + 2.0 * STEPS * DT])


# --- windows


def turning(n, rate=0.5, segment=None, good=None):
    """A ball that goes round at a steady rate, rad/s."""
    t, zeros = np.arange(n) * DT, np.zeros(n)
    return samples_from(rate * t, np.full(n, rate), zeros, (zeros,) * 6, segment, good)


def test_windows_stay_within_stretches_and_allowed_rows():
    rng = np.random.default_rng(1)
    for _ in range(20):
        n = 700
        segment = np.cumsum(rng.random(n) < 0.005)
        good, allowed = rng.random(n) > 0.004, np.ones(n, dtype=bool)
        for begin in rng.integers(0, n, 3):
            allowed[begin : begin + 40] = False
        samples = turning(n, segment=segment, good=good)
        openings = None if rng.random() < 0.5 else rng.uniform(-3.0, 3.0, 8)
        windows = choose_windows(samples, allowed, openings)
        every = np.zeros(n, dtype=bool)
        for first in windows.start:
            rows = np.arange(first, first + STEPS + 1)
            assert allowed[rows].all()
            assert good[rows].all()
            assert len(set(segment[rows])) == 1
            every[first] = True
        assert len(windows) == every.sum()
        assert (np.diff(windows.start) >= STEPS // 4).all()
        # nothing is left out: a window that could be is no further than a quarter from one that is
        if windows.chosen == "evenly spaced":
            for first in range(n - STEPS):
                rows = slice(first, first + STEPS + 1)
                if (allowed & good)[rows].all() and segment[first] == segment[first + STEPS]:
                    assert np.abs(windows.start - first).min() < STEPS // 4


@pytest.mark.parametrize("rate", [0.5, -0.5])
def test_windows_end_in_front_of_openings_and_move_towards_them(rate):
    samples = turning(6000, rate)
    openings = np.radians([45.0, 135.0, 225.0, 315.0])
    windows = choose_windows(samples, samples.good, openings)
    assert windows.chosen == "before openings"
    assert len(windows) >= MIN_WINDOWS
    ends = samples.k.theta[windows.start + STEPS]
    to_go = np.sign(rate) * (openings[None, :] - ends[:, None])
    to_go = np.mod(to_go, 2.0 * np.pi).min(axis=1)
    assert (to_go > 0.0).all()
    assert (to_go < MAX_OPENING_ANGLE).all()
    # each passage is met: 100 rad are 63 openings, each with 12 degrees before it
    assert len(windows) >= 60
