from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from finite_differences import jacobian
from ring_numbers import G, numbers_of, ring_of
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from mazeplan.core.errors import ModelError
from mazeplan.learning.modelfile import RigModel
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.dynamics.ring_dynamics import linearise, step
from mazeplan.physics.dynamics.ring_parameters import (
    FASTEST,
    RingParameters,
)
from mazeplan.physics.effects.ball import rolling_inertia, table_rocking, tilt_offset, viscous_friction
from mazeplan.physics.registry import make_term
from mazeplan.physics.rig.stage import PROMPT, TYPICAL_RAD, StageAxis, StageModel, second_order_transition

PLAIN = RingParameters(0.0689)
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
COUPLED = replace(FULL, beta=replace(FULL.beta, coupling=0.12), gamma=replace(FULL.gamma, coupling=-0.07))
KINDS = pytest.mark.parametrize("p", [PLAIN, FULL, COUPLED], ids=["plain", "full", "coupled"])
SPREAD = np.array([math.pi, 8.0, 0.09, 1.0, 0.09, 1.0])  # of start states: rad, rad/s


def axis_acceleration(axis, angle, rate, u):
    wn = axis.natural_frequency
    return wn * wn * (axis.gain * u + axis.offset - angle) - 2.0 * axis.damping * wn * rate


def right_hand_side(t, s, u, p):
    """The equation term by term; `test_equation` compares the formulas with Lagrange's equation."""
    theta, theta_d, beta, beta_d, gamma, gamma_d = s
    beta_dd = axis_acceleration(p.beta, beta, beta_d, u[0] + p.beta.coupling * u[1])
    gamma_dd = axis_acceleration(p.gamma, gamma, gamma_d, u[1] + p.gamma.coupling * u[0])
    n = numbers_of(p)
    g = n.rolling_factor * G / p.radius
    b, c = beta + n.offset_beta, gamma + n.offset_gamma
    theta_dd = (
        beta_dd * np.sin(gamma)
        - beta_d**2 * np.sin(theta) * np.cos(theta) * np.cos(gamma) ** 2
        - 2.0 * beta_d * gamma_d * np.cos(gamma) * np.cos(theta) ** 2
        + 2.0 * beta_d * gamma_d * np.cos(gamma)
        + 0.5 * gamma_d**2 * np.sin(2.0 * theta)
        - g * np.sin(b) * np.sin(theta)
        - g * np.sin(c) * np.cos(b) * np.cos(theta)
        - n.viscous * theta_d
        - n.dry * np.tanh(theta_d / p.dry_width)
    )
    return [theta_d, theta_dd, beta_d, beta_dd, gamma_d, gamma_dd]


def stepped(s, u, p):
    out = np.empty(6)
    step(s, u, p.pack(), out)
    return out


def integrated(s, u, p):
    return solve_ivp(right_hand_side, (0.0, p.dt), s, args=(u, p), rtol=1e-11, atol=1e-13, method="DOP853").y[:, -1]


@KINDS
def test_a_step_equals_an_adaptive_integrator(p):
    rng = np.random.default_rng(1)
    worst = np.zeros(6)
    for _ in range(60):
        s, u = SPREAD * rng.uniform(-1, 1, 6), 0.09 * rng.uniform(-1, 1, 2)
        worst = np.maximum(worst, np.abs(stepped(s, u, p) - integrated(s, u, p)))
    assert worst[0] < 1e-5
    assert worst[1] < 2e-4
    assert (worst[2:] < 1e-10).all()  # the stage is exact


def test_forty_steps_equal_an_adaptive_integrator():
    rng = np.random.default_rng(2)
    for _ in range(5):
        s = SPREAD * [1.0, 0.2, 0.5, 0.3, 0.5, 0.3] * rng.uniform(-1, 1, 6)
        reference = s
        for _ in range(40):
            u = 0.09 * rng.uniform(-1, 1, 2)
            s, reference = stepped(s, u, FULL), integrated(reference, u, FULL)
        assert s == pytest.approx(reference, abs=2e-3)
        assert abs(s[0] - reference[0]) < 1e-3


@pytest.mark.slow
@KINDS
def test_derivatives_equal_finite_differences(p):
    rng = np.random.default_rng(3)
    A, B = np.full((6, 6), np.nan), np.full((6, 2), np.nan)
    for _ in range(100):
        x = np.concatenate([SPREAD * rng.uniform(-1, 1, 6), 0.09 * rng.uniform(-1, 1, 2)])
        linearise(x[:6], x[6:], p.pack(), np.empty(6), A, B)
        numeric = jacobian(lambda x: stepped(x[:6], x[6:], p), x, 1e-5)
        np.testing.assert_allclose(np.hstack([A, B]), numeric, rtol=1e-6, atol=2e-9)


def test_a_share_of_a_command_reaches_the_other_axis():
    """One command on both axes' way: what the other does of it, is its share of what the own one would."""
    A, B, own_A, own_B = np.empty((6, 6)), np.empty((6, 2)), np.empty((6, 6)), np.empty((6, 2))
    s, u = np.array([0.7, 1.2, 0.03, 0.2, -0.02, -0.3]), np.array([0.05, -0.04])
    linearise(s, u, COUPLED.pack(), np.empty(6), A, B)
    reached = np.array([u[0] + 0.12 * u[1], u[1] - 0.07 * u[0]])
    linearise(s, reached, FULL.pack(), np.empty(6), own_A, own_B)
    assert stepped(s, u, COUPLED) == pytest.approx(stepped(s, reached, FULL), abs=1e-15)
    np.testing.assert_allclose(A, own_A, rtol=0, atol=1e-15)
    np.testing.assert_allclose(B, own_B @ [[1.0, 0.12], [-0.07, 1.0]], rtol=0, atol=1e-15)
    assert B[2, 1] == pytest.approx(0.12 * B[2, 0]) != 0.0
    assert B[4, 0] == pytest.approx(-0.07 * B[4, 1]) != 0.0
    assert own_B[2, 1] == own_B[4, 0] == 0.0


@pytest.mark.parametrize("zeta", [0.05, 0.9, 1.0, 1.0 + 1e-12, 1.7, 40.0])
def test_the_transition_matrix_is_the_matrix_exponential(zeta):
    wn, t = 26.0, 1.0 / 30.0
    M = np.array([[0.0, 1.0], [-wn * wn, -2.0 * zeta * wn]])
    np.testing.assert_allclose(second_order_transition(wn, zeta, t), expm(M * t), rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radius": 0.0}, "radius: got 0.0, expected a number > 0"),
        ({"radius": math.nan}, "radius"),
        ({"dry_width": -1.0}, "dry_width"),
        ({"dt": 0.0}, "dt"),
        ({"ball_radius": math.inf}, "ball_radius"),
        ({"effects": (rolling_inertia(0.6), table_rocking())}, "table_rocking: cannot be planned with: its phase"),
    ],
)
def test_values_out_of_range_are_refused(change, message):
    with pytest.raises(ModelError, match=message):
        replace(PLAIN, **change)


def test_parameters_come_from_a_fitted_model():
    balls = {
        2: BallModel(
            (
                rolling_inertia(0.6),
                viscous_friction(0.2),
                make_term("dry_friction", {"coefficient": 0.4}),
                tilt_offset(0.01, -0.02),
            )
        )
    }
    stage = StageModel(
        beta=StageAxis(gain=0.9, natural_frequency=20.0, coupling=0.03), gamma=StageAxis(damping=1.2, offset=0.003)
    )
    p = RigModel(stage, balls).ring_parameters(2, 0.0689)
    assert p == ring_of(
        0.0689,
        rolling_factor=0.6,
        viscous=0.2,
        dry=0.4,
        offset_beta=0.01,
        offset_gamma=-0.02,
        beta=stage.beta,
        gamma=stage.gamma,
    )


@pytest.mark.slow
@pytest.mark.parametrize(("natural_frequency", "damping"), [(240.0, 4.76), (500.0, 10.0), (180.0, 3.6)])
def test_a_plate_that_answers_like_a_lag_of_first_order(natural_frequency, damping):
    """What `learn` finds then has a pole faster than any sample shows; it must not push the ball."""
    axis = StageAxis(natural_frequency=natural_frequency, damping=damping)
    model = RigModel(StageModel(axis, axis), {1: BallModel((rolling_inertia(0.6),))})
    p = model.ring_parameters(1, 0.0689)
    as_found = replace(p, beta=axis, gamma=axis)
    rng = np.random.default_rng(2)
    true, kept, stiff = (np.array([0.4, 0.0, 0.0, 0.0, 0.0, 0.0]) for _ in range(3))
    off = []
    for _ in range(20):
        u = rng.uniform(-0.087, 0.087, 2)
        with_all = solve_ivp(right_hand_side, (0, p.dt), true, "Radau", args=(u, as_found), rtol=1e-8, atol=1e-10)
        true = with_all.y[:, -1]
        for s, numbers in ((kept, p.pack()), (stiff, as_found.pack())):
            out = np.empty(6)
            step(s, u, numbers, out)
            s[:] = out
        off.append([abs(s[0] - true[0]) for s in (kept, stiff)])
    worst = np.max(off, axis=0)
    assert worst[0] < 0.05
    assert worst[1] > 4.0 * worst[0]


def test_a_stage_that_can_be_resolved_is_as_it_is():
    for numbers in ((26.0, 0.9), (26.0, 1.2), (61.0, 1.43), (150.0, 0.5)):
        assert StageAxis(1.0, *numbers).careful(FASTEST) == numbers
    w, z = StageAxis(1.0, 240.0, 4.76).careful(FASTEST)
    poles = sorted(-np.roots([1.0, 2.0 * z * w, w * w]).real)
    assert poles == pytest.approx([240.0 * (4.76 - math.sqrt(4.76**2 - 1.0)), FASTEST])
    assert StageAxis(1.0, 300.0, 0.7).careful(FASTEST) == (FASTEST, 0.7)
    assert StageAxis.prompt().careful(FASTEST) == (PROMPT, 1.0)  # no faster than what the record shows
    slow = StageAxis(1.0, 100.0, 0.9, rate_limit=0.5).careful(FASTEST)
    assert slow[0] * TYPICAL_RAD / math.e == pytest.approx(0.5)  # the largest rate of a critically damped axis
    assert slow[1] >= 1.0


def test_without_a_rolling_effect_the_ball_slides():
    p = RigModel(StageModel(), {1: BallModel(())}).ring_parameters(1, 0.08)
    assert p == RingParameters(0.08, ())
    s, u = np.array([math.pi / 2, 0, 0.05, 0, 0, 0]), np.array([0.05, 0.0])
    tilted = stepped(s, u, p)
    assert tilted == pytest.approx(stepped(s, u, ring_of(0.08, rolling_factor=1.0)), abs=1e-15)
    assert tilted[1] == pytest.approx(-G / 0.08 * math.sin(0.05) / 30.0, rel=1e-3)
