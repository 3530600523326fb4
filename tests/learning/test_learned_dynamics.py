"""A step with a learned part: against plain integration with the process held over the step, and its derivatives."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from finite_differences import jacobian
from gaussian_processes import plain
from ring_numbers import G, numbers_of, ring_of
from scipy.integrate import solve_ivp

from mazeplan.learning import fast_gp
from mazeplan.learning.features import inputs
from mazeplan.learning.gaussian_process import GaussianProcess
from mazeplan.learning.modelfile import RigModel
from mazeplan.physics.ball_model import BallModel, RingKinematics
from mazeplan.physics.dynamics import ring_dynamics
from mazeplan.physics.dynamics.ring_parameters import PROCESS
from mazeplan.physics.effects.ball import dry_friction, rolling_inertia, tilt_offset, viscous_friction
from mazeplan.physics.rig.stage import StageAxis, StageModel

SPREAD = np.array([math.pi, 4.0, 0.09, 0.8, 0.09, 0.8])  # of start states: rad, rad/s
FULL = ring_of(
    0.0487,
    rolling_factor=0.61,
    viscous=0.4,
    dry=0.5,
    dry_width=0.2,
    offset_beta=0.004,
    offset_gamma=-0.006,
    beta=StageAxis(0.95, 24.0, 0.8, offset=0.002),
    gamma=StageAxis(1.1, 28.0, 1.4, offset=-0.003),
)
ALONE = replace(FULL, physics=False)
SCALES = np.array([3.0, 0.8, 0.8, 0.7, 0.7, 0.1, 0.02, 0.1, 0.02])


def seen(states):
    zero = np.zeros(len(states))
    theta, theta_dot, beta, beta_dot, gamma, gamma_dot = states.T
    return inputs(RingKinematics(0.0487, theta, theta_dot, beta, beta_dot, zero, gamma, gamma_dot, zero))


def process(n=200, seed=0, amplitude=3.0):
    rng = np.random.default_rng(seed)
    states = SPREAD * rng.uniform(-1, 1, (n, 6))
    y = amplitude * np.sin(2.0 * states[:, 0]) - 0.5 * states[:, 1] + 20.0 * states[:, 2]
    hyper = plain(SCALES, amplitude, 0.1)
    return GaussianProcess.condition(hyper, seen(states), np.zeros((n, 0)), y)


GP = process()


def axis_acceleration(axis, angle, rate, u):
    wn = axis.natural_frequency
    return wn * wn * (axis.gain * u + axis.offset - angle) - 2.0 * axis.damping * wn * rate


def right_hand_side(t, s, u, p, held):
    """The equation term by term, and the learned part as a number that is held."""
    theta, theta_d, beta, beta_d, gamma, gamma_d = s
    beta_dd = axis_acceleration(p.beta, beta, beta_d, u[0])
    gamma_dd = axis_acceleration(p.gamma, gamma, gamma_d, u[1])
    turning = (
        beta_dd * math.sin(gamma)
        - beta_d**2 * math.sin(theta) * math.cos(theta) * math.cos(gamma) ** 2
        + 2.0 * beta_d * gamma_d * math.cos(gamma) * math.sin(theta) ** 2
        + 0.5 * gamma_d**2 * math.sin(2.0 * theta)
    )
    n = numbers_of(p)
    g = n.rolling_factor * G / p.radius
    b, c = beta + n.offset_beta, gamma + n.offset_gamma
    gravity = -g * (math.sin(b) * math.sin(theta) + math.sin(c) * math.cos(b) * math.cos(theta))
    friction = n.viscous * theta_d + n.dry * math.tanh(theta_d / p.dry_width)
    effects = gravity - friction if p.physics else 0.0
    return [theta_d, turning + effects + held, beta_d, beta_dd, gamma_d, gamma_dd]


def integrated(s, u, p, held):
    solved = solve_ivp(right_hand_side, (0.0, p.dt), s, args=(u, p, held), rtol=1e-11, atol=1e-13, method="DOP853")
    return solved.y[:, -1]


def stepped(s, u, packed):
    out = np.empty(6)
    fast_gp.linearise(s, u, packed, out, np.empty((6, 6)), np.empty((6, 2)))
    return out


def drawn(rng):
    return SPREAD * rng.uniform(-1, 1, 6), 0.09 * rng.uniform(-1, 1, 2)


@pytest.mark.parametrize("p", [FULL, ALONE], ids=["sp", "np"])
def test_a_step_is_the_equation_with_the_process_held(p):
    rng, packed = np.random.default_rng(1), fast_gp.pack_with_process(p, GP)
    worst, largest = np.zeros(6), 0.0
    for _ in range(40):
        s, u = drawn(rng)
        held = float(GP.mean(seen(s[None]))[0])
        largest = max(largest, abs(held))
        worst = np.maximum(worst, np.abs(stepped(s, u, packed) - integrated(s, u, p, held)))
    assert largest > 2.0  # rad/s^2: the process takes part
    assert worst[0] < 1e-5
    assert worst[1] < 2e-4
    assert (worst[2:] < 1e-10).all()


@pytest.mark.parametrize("p", [FULL, ALONE], ids=["sp", "np"])
def test_derivatives_equal_finite_differences(p):
    rng, packed = np.random.default_rng(2), fast_gp.pack_with_process(p, GP)
    A, B = np.full((6, 6), np.nan), np.full((6, 2), np.nan)
    plain_A, plain_B = A.copy(), B.copy()
    apart = 0.0
    for _ in range(50):
        s, u = drawn(rng)
        fast_gp.linearise(s, u, packed, np.empty(6), A, B)
        numeric = jacobian(lambda x: stepped(x[:6], x[6:], packed), np.concatenate([s, u]), 1e-4)
        np.testing.assert_allclose(np.hstack([A, B]), numeric, rtol=1e-5, atol=1e-7)
        ring_dynamics.linearise(s, u, packed[: int(packed[PROCESS])].copy(), np.empty(6), plain_A, plain_B)
        apart = max(apart, float(np.abs(A - plain_A).max()))
    assert apart > 0.1  # the process takes part in the derivatives


def test_a_process_of_nothing_is_the_ring_alone():
    rng = np.random.default_rng(4)
    packed = fast_gp.pack_with_process(FULL, replace(GP, alpha=np.zeros(len(GP))))
    A, B, plain_A, plain_B = np.empty((6, 6)), np.empty((6, 2)), np.empty((6, 6)), np.empty((6, 2))
    for _ in range(20):
        s, u = drawn(rng)
        plain = np.empty(6)
        ring_dynamics.step(s, u, FULL.pack(), plain)
        np.testing.assert_array_equal(stepped(s, u, packed), plain)
        fast_gp.linearise(s, u, packed, np.empty(6), A, B)
        ring_dynamics.linearise(s, u, FULL.pack(), np.empty(6), plain_A, plain_B)
        np.testing.assert_array_equal(A, plain_A)
        np.testing.assert_array_equal(B, plain_B)


def test_which_models_have_no_physics():
    ball = BallModel((rolling_inertia(0.6), viscous_friction(0.2), dry_friction(0.4), tilt_offset(0.01, -0.02)))
    model = RigModel(StageModel(), {1: ball, 2: ball}, processes={1: GP})
    for kind, ring, physics in (("np", 1, False), ("np", 2, True), ("sp", 1, True), ("sp", 2, True)):
        p = replace(model, kind=kind).ring_parameters(ring, 0.0689)
        assert p.physics is physics
        n = numbers_of(p)
        assert (n.rolling_factor, n.viscous, n.dry) == (0.6, 0.2, 0.4)
