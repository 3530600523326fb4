"""Each kind of ball model: fitted to samples whose equation is known, and its derivatives by differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mazeplan.learning.features import PAPER, paper_features
from mazeplan.learning.fitting import FitOptions, fit_kind, fit_linear
from mazeplan.learning.gp_training import TrainingOptions
from mazeplan.learning.policy_training import require_torch
from mazeplan.learning.samples import MatchedKinematics, RingSamples
from mazeplan.physics.ball_model import RingKinematics, gravity_part, kinematic_terms

RADIUS = 0.0892
ROLLING, VISCOUS, DRY, NOISE = 0.58, 0.4, 0.5, 0.5
QUICK = FitOptions(
    training=TrainingOptions(first=60, rows=100, starts=1, iterations=6, refinement=4),
)


@pytest.fixture(autouse=True)
def one_thread():
    require_torch()
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def states(n, seed=0, past=True):
    rng = np.random.default_rng(seed)
    place = [rng.uniform(-np.pi, np.pi, n), rng.normal(0.0, 3.0, n)]
    tilts = [rng.uniform(-0.09, 0.09, n), rng.normal(0.0, 0.5, n), rng.normal(0.0, 5.0, n)]
    tilts += [rng.uniform(-0.09, 0.09, n), rng.normal(0.0, 0.5, n), rng.normal(0.0, 5.0, n)]
    if not past:
        return RingKinematics(RADIUS, *place, *tilts)
    before = {"beta_past": rng.uniform(-0.09, 0.09, n), "gamma_past": rng.uniform(-0.09, 0.09, n)}
    return MatchedKinematics(RADIUS, *place, *tilts, **before)


def truth(k, ripple=0.0, dry=DRY, waves=4):
    """A rolling ball with friction, and a force of the place that no feature has, rad/s^2, so often round the ring."""
    friction = VISCOUS * k.theta_dot + dry * np.tanh(k.theta_dot / 0.1)
    return kinematic_terms(k) + ROLLING * gravity_part(k) - friction + ripple * np.sin(waves * k.theta)


def samples(n=150, seed=0, ripple=0.0, past=True, dry=DRY, waves=4, noise=NOISE):
    k = states(n, seed, past)
    target = truth(k, ripple, dry, waves) + np.random.default_rng(seed + 1).normal(0.0, noise, n)
    rows = np.arange(n)
    return RingSamples(1, 1 / 30, k, target, k.theta, np.zeros(n, dtype=np.int64), rows, np.ones(n, dtype=bool))


def fitted(kind, part=None, options=QUICK):
    part = part or samples(ripple=1.0)
    return fit_kind(kind, part, np.arange(len(part)), options)


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def test_p_is_the_equation_of_a_sliding_point():
    model, k = fitted("p"), states(30, 3)
    np.testing.assert_allclose(model.mean(k), kinematic_terms(k) + gravity_part(k), rtol=1e-12)


def test_pi_finds_the_weights():
    part = samples(800, dry=0.0)
    model, phi = fitted("pi", part), paper_features(part.k)
    weights, covariance = fit_linear(phi, part.theta_ddot), NOISE**2 * np.linalg.inv(phi.T @ phi)
    pull = ROLLING * 9.81 / RADIUS
    known = np.array([1.0, 1.0, 1.0, 1.0, pull, pull, VISCOUS])
    names, off = list(PAPER), np.abs(weights - known) / np.sqrt(np.diag(covariance))
    for name in ("gravity_beta", "gravity_gamma", "viscous", "turning"):
        assert off[names.index(name)] < 4.0, name
    assert weights[4] == pytest.approx(pull, rel=0.02)
    k = states(40, 5)
    assert rms(model.mean(k) - truth(k, dry=0.0)) < 0.1
    phi = paper_features(k)
    variance = np.diag(phi @ covariance @ phi.T)
    assert (np.abs(model.mean(k) - truth(k, dry=0.0)) < 4.5 * np.sqrt(variance)).all()


@pytest.mark.parametrize("kind", ["np", "sp"])
def test_with_heavy_tails_what_is_typical_is_fitted_too(kind):
    """Every thirtieth row is struck, always in the same direction."""
    part, at = samples(300, ripple=1.5), states(100, 5)
    struck = replace(part, theta_ddot=part.theta_ddot + 40.0 * (np.arange(300) % 30 == 0))
    training = TrainingOptions(first=150, rows=150, starts=1, iterations=8, refinement=4)
    options = FitOptions(most=200, training=training)
    found = fit_kind(kind, struck, np.arange(300), options)
    right = truth(at, 1.5)
    assert np.mean(np.abs(found.typical(at) - right)) < 0.8 * np.mean(np.abs(found.mean(at) - right))


def test_rf_learns_in_steps_the_same_each_time():
    part, at = samples(400), states(100, 5)
    model = fitted("rf", part)
    assert rms(model.mean(part.k) - part.theta_ddot) < 0.6 * np.std(part.theta_ddot)
    assert rms(model.mean(at) - truth(at)) < 0.8 * np.std(truth(at))
    assert not np.array_equal(fitted("rf", part, replace(QUICK, seed=1)).mean(at), model.mean(at))
    np.testing.assert_array_equal(fitted("rf", part).mean(at), model.mean(at))


@pytest.mark.parametrize("kind", ["np", "sp"])
def test_processes_learn_what_the_turning_plate_leaves(kind):
    world = {"ripple": 1.5, "dry": 0.0, "waves": 4}
    part, at = samples(250, **world), states(100, 5)
    training = TrainingOptions(first=250, rows=250, starts=1, iterations=12, refinement=6)
    model, right = fit_kind(kind, part, np.arange(250), FitOptions(training=training)), truth(at, **world)
    error, linear = model.mean(at) - right, fit_kind("pi", part, np.arange(250)).mean(at) - right
    assert rms(error) < 0.5 * rms(linear)
