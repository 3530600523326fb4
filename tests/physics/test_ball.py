"""Effects on the ball one by one: formula, derivatives, ranges, names."""

from __future__ import annotations

import math

import numpy as np
import pytest
from finite_differences import jacobian

from mazeplan.physics import ball_model
from mazeplan.physics.ball_model import (
    NO_GRAVITY,
    BallModel,
    RingKinematics,
    acceleration,
    gravity_factor,
    gravity_jacobian,
    gravity_part,
    kinematic_terms,
    level_tilt,
    packed,
)
from mazeplan.physics.effect import GRAVITY, OPENING, Term
from mazeplan.physics.effects.ball import (
    ball_imbalance,
    constant_force,
    constant_torque,
    dry_friction,
    friction_drift,
    local_friction,
    quadratic_drag,
    rolling_inertia,
    surface_bump,
    surface_profile,
    surface_ripple,
    table_rocking,
    tilt_offset,
    viscous_friction,
    wall_friction,
)
from mazeplan.physics.effects.openings import gate_loss
from mazeplan.physics.formulas.compiled import ring_functions
from mazeplan.physics.registry import EFFECTS, make_term, ring_effects

RADIUS, G = 0.0689, 9.81
STATE = ("theta", "theta_dot", "beta", "beta_dot", "gamma", "gamma_dot")
RIPPLE = {"cos4": 0.1, "sin4": -0.2, "cos6": 0.3, "sin7": 0.2, "cos9": -0.4, "sin9": 0.1}
EXAMPLES = {
    "rolling_inertia": rolling_inertia(0.6),
    "tilt_offset": tilt_offset(0.02, -0.01),
    "constant_force": constant_force(0.3, -0.2),
    "table_rocking": table_rocking(1.7, 0.02, -0.03, 0.4),
    "viscous_friction": viscous_friction(0.4),
    "dry_friction": dry_friction(0.3, 0.1),
    "local_friction": local_friction(2.0, 0.5, 1.7, 0.4),
    "wall_friction": wall_friction(0.15),
    "quadratic_drag": quadratic_drag(0.2),
    "friction_drift": friction_drift(0.01, 0.3),
    "constant_torque": constant_torque(0.7),
    "surface_profile": surface_profile(0.1, -0.2, 0.3, 0.5, -0.1, 0.2),
    "surface_ripple": surface_ripple(**RIPPLE),
    "surface_bump": surface_bump(1.0, 0.4, -2.0),
    "ball_imbalance": ball_imbalance(0.5, 0.8),
    "gate_loss": gate_loss(0.5, 0.2),
}
RUBS = ("viscous_friction", "dry_friction", "local_friction", "wall_friction", "quadratic_drag", "friction_drift")
INSIDE = [name for name, term in EXAMPLES.items() if term.effect.acts in (GRAVITY, OPENING)]  # no term of their own
STEPS = {"local_friction": 1e-4}  # of differences, where 1e-3 is too long: a sector begins over 0.01 rad
PARAMETERS = [(name, parameter) for name, effect in EFFECTS.items() for parameter in effect.parameters]
WEIGHTLESS = Term(rolling_inertia, (0.0,))


def motion(seed=0, n=40, **fixed):
    rng = np.random.default_rng(seed)
    drawn = {name: rng.uniform(-1.0, 1.0, n) for name in (*STATE, "beta_ddot", "gamma_ddot")}
    scale = {"theta": 3.1, "theta_dot": 8.0, "beta": 0.3, "gamma": 0.3, "beta_ddot": 20.0, "gamma_ddot": 20.0}
    return RingKinematics(RADIUS, **{name: scale.get(name, 2.0) * v for name, v in drawn.items()} | fixed)


def differences(f, k, step=1e-3):
    """Derivatives (N, 6) of f(k) (N,) by differences, sample by sample."""

    def at(i):
        rest = {"beta_ddot": k.beta_ddot[i : i + 1], "gamma_ddot": k.gamma_ddot[i : i + 1]}

        def value(x):
            return f(RingKinematics(k.radius, **dict(zip(STATE, x[:, None], strict=True)), **rest))

        return jacobian(value, [getattr(k, name)[i] for name in STATE], step)[0]

    return np.array([at(i) for i in range(k.theta.size)])


def added(term, k):
    """What an effect adds to the acceleration of a ball, (N,)."""
    return acceleration((term,), k) - acceleration((), k)


def pull(k, x, y, factor=1.0):
    """Acceleration along the ring of horizontal ones x, y (m/s^2) in the plate."""
    return factor / k.radius * (y * np.cos(k.theta) - x * np.sin(k.theta))


def tilted(k, beta=0.0, gamma=0.0):
    """Gravity's pull along the ring on a table that is tilted besides, written out."""
    b, c = k.beta + beta, k.gamma + gamma
    return pull(k, G * np.sin(b), -G * np.sin(c) * np.cos(b))


def near(angle):
    """An angle as it is from -pi to pi."""
    return np.angle(np.exp(1j * angle))


def outwards(k):
    """What presses the ball against the outer wall, over its radius: turning, and 5/9 of gravity across."""
    across = np.sin(k.beta) * np.cos(k.theta) - np.sin(k.gamma) * np.sin(k.theta)
    return k.theta_dot**2 + 5.0 / 9.0 * G / k.radius * across


def formulas(k):
    """What each of EXAMPLES adds, written out."""
    w, a, forwards = k.theta_dot, k.theta, np.sign(k.theta_dot)
    away = near(a - 1.0) / 0.4
    into = 0.6 - np.abs(near(a - 1.1))  # rad into the sector from 0.5 to 1.7
    return {
        "viscous_friction": -0.4 * w,
        "dry_friction": np.where(w > 0.0, -0.3, 0.3) - 0.1,
        "local_friction": -forwards * 0.4 * 0.5 * (1.0 + np.tanh(0.5 * into / 0.01)),
        "wall_friction": -forwards * 0.15 * np.abs(outwards(k)),
        "quadratic_drag": np.where(w > 0.0, -0.2, 0.2) * w**2,
        "friction_drift": -0.3 * w,
        "constant_torque": np.full_like(w, 0.7),
        "surface_profile": 0.1 * np.cos(a)
        - 0.2 * np.sin(a)
        + 0.3 * np.cos(2 * a)
        + 0.5 * np.sin(2 * a)
        - 0.1 * np.cos(3 * a)
        + 0.2 * np.sin(3 * a),
        "surface_ripple": 0.1 * np.cos(4 * a)
        - 0.2 * np.sin(4 * a)
        + 0.3 * np.cos(6 * a)
        + 0.2 * np.sin(7 * a)
        - 0.4 * np.cos(9 * a)
        + 0.1 * np.sin(9 * a),
        "surface_bump": -2.0 * np.exp(0.5) * away * np.exp(-0.5 * away**2),
        "ball_imbalance": 0.5 * np.sin(a * k.radius / 6.35e-3 + 0.8),
        "gate_loss": np.zeros_like(w),
        "rolling_inertia": -0.4 * tilted(k),
        "tilt_offset": tilted(k, 0.02, -0.01) - tilted(k),
        "constant_force": pull(k, 0.3, -0.2),
        "table_rocking": tilted(k, 0.02 * math.sin(0.4), -0.03 * math.sin(0.4)) - tilted(k),
    }


def test_every_effect_is_tried_here():
    mine = {name for name in ring_effects() if not name.endswith(("_gates", "_edges"))}  # those: test_openings
    assert set(EXAMPLES) == mine
    assert all(term.effect is EFFECTS[name] for name, term in EXAMPLES.items())
    assert set(formulas(motion())) == mine


@pytest.mark.slow
def test_formulas():
    k = motion(n=200)
    expected = formulas(k)
    inside = np.abs(near(k.theta - 1.1)) < 0.6
    assert 10 < inside.sum() < 100
    for name, term in EXAMPLES.items():
        np.testing.assert_allclose(added(term, k), expected[name], rtol=0, atol=1e-11, err_msg=name)
        assert (np.abs(expected[name]) > 1e-3).any() != (name == "gate_loss"), name
        if name != "rolling_inertia":
            without_gravity = acceleration((WEIGHTLESS, term), k) - kinematic_terms(k)
            assert (np.abs(without_gravity) < 1e-12).all() == (name in INSIDE), name


@pytest.mark.slow
def test_effects_of_gravity_are_scaled_and_the_others_are_not():
    k = motion(6)
    half = rolling_inertia(0.5)
    for name, term in EXAMPLES.items():
        if name != "rolling_inertia":
            share = 0.5 if term.effect.acts == GRAVITY else 1.0
            beside = acceleration((half, term), k) - acceleration((half,), k)
            np.testing.assert_allclose(beside, share * formulas(k)[name], rtol=0, atol=1e-11, err_msg=name)


@pytest.mark.slow
def test_all_effects_add_up():
    k, every = motion(7), tuple(EXAMPLES.values())
    rock = 0.02 * math.sin(0.4), -0.03 * math.sin(0.4)
    own = sum(part for name, part in formulas(k).items() if EXAMPLES[name].effect.acts != GRAVITY)
    gravity = 0.6 * (tilted(k, 0.02 + rock[0], -0.01 + rock[1]) + pull(k, 0.3, -0.2))
    np.testing.assert_allclose(acceleration(every, k), kinematic_terms(k) + gravity + own, rtol=0, atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("term", [EXAMPLES["friction_drift"], EXAMPLES["table_rocking"]], ids=lambda term: term.name)
def test_what_changes_with_time(term):
    k, t = motion(8), np.linspace(0.0, 30.0, 40)
    rock = np.sin(2.0 * math.pi * 1.7 * t + 0.4)
    rocked = tilted(k, 0.02 * rock, -0.03 * rock) - tilted(k)
    expected = {"friction_drift": -(0.3 + 0.01 * t) * k.theta_dot, "table_rocking": rocked}
    functions, p = ring_functions([term.effect]).vectorised(np), packed([term])
    plate = functions["plate"](t, k.plate, p)
    late = functions["value"](k.theta, k.theta_dot, np.sin(k.theta), np.cos(k.theta), plate, p)
    np.testing.assert_allclose(late - acceleration((), k), expected[term.name], rtol=0, atol=1e-10)


def test_the_tilt_that_a_command_has_to_take_off_and_the_share_of_gravity():
    terms = tilt_offset(0.02, -0.01), constant_force(0.3, -0.2), rolling_inertia(0.6), dry_friction(0.3)
    beta, gamma = level_tilt(terms)
    assert G * math.sin(beta) == pytest.approx(G * math.sin(0.02) + 0.3, rel=1e-12)
    assert -G * math.sin(gamma) * math.cos(beta) == pytest.approx(G * math.sin(0.01) * math.cos(0.02) - 0.2, rel=1e-12)
    assert gravity_factor(terms) == 0.6
    k = motion(9, beta=np.full(40, -0.02), gamma=np.full(40, 0.01))
    np.testing.assert_allclose(acceleration(terms[:1], k), kinematic_terms(k), rtol=0, atol=1e-12)
    assert level_tilt(()) == (0.0, 0.0)
    assert gravity_factor(()) == 1.0


def test_derivatives_of_gravity_and_of_the_turning_plate():
    k = motion(1)
    np.testing.assert_allclose(
        ball_model.jacobian([NO_GRAVITY], k), differences(kinematic_terms, k), rtol=1e-8, atol=1e-8
    )
    shifted = differences(lambda m: gravity_part(m, 0.02, -0.03), k)
    np.testing.assert_allclose(gravity_jacobian(k, 0.02, -0.03), shifted, rtol=1e-8, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_derivatives_of_each_effect(name):
    k, term, step = motion(2), EXAMPLES[name], STEPS.get(name, 1e-3)
    assert (np.abs(k.theta_dot) > 5e-3).all()  # no difference is taken across the kink at rest
    assert (np.abs(outwards(k)) > 0.5).all()  # ... nor where the ball changes walls
    one, alone = ball_model.jacobian([term], k), differences(lambda m: added(term, m), k, step)
    np.testing.assert_allclose(one - ball_model.jacobian([], k), alone, rtol=1e-8, atol=1e-8)
    whole = differences(lambda m: acceleration([term], m), k, step)
    np.testing.assert_allclose(one, whole, rtol=1e-8, atol=1e-7)


@pytest.mark.parametrize("name", ["dry_friction", "local_friction", "wall_friction"])
def test_dry_friction_changes_its_sign_over_a_width_for_a_planner(name):
    k, term = motion(10, theta_dot=np.linspace(-0.3, 0.3, 40)), EXAMPLES[name]
    turned = np.tanh(k.theta_dot / 0.1)
    size = {
        "dry_friction": 0.3 + 0.1 * turned,
        "local_friction": 0.2 * (1.0 + np.tanh(50.0 * (0.6 - np.abs(near(k.theta - 1.1))))),
        "wall_friction": 0.15 * np.abs(outwards(k)),
    }[name]
    found = acceleration((term,), k, 0.1) - acceleration((), k, 0.1)
    np.testing.assert_allclose(found, -turned * size, rtol=0, atol=1e-11)


def test_a_resting_ball_has_no_friction():
    k = motion(theta_dot=np.zeros(40))
    for name in RUBS:
        np.testing.assert_array_equal(acceleration((EXAMPLES[name],), k), acceleration((), k), err_msg=name)


def test_a_sector_goes_counter_clockwise_from_start_to_end():
    """Also across the seam at pi; the middle of its beginning has half of the friction."""
    term = local_friction(1.0, 3.0, -3.0, 0.4)  # 0.283 rad that hold 180 degrees
    theta = np.array([3.0, 3.1, math.pi, -3.1, -3.0, -2.8, 2.8, 0.0, 3.1 - 2.0 * math.pi])
    k = motion(n=9, theta=theta, theta_dot=np.full(9, 2.0))
    assert -added(term, k) == pytest.approx([0.2, 0.4, 0.4, 0.4, 0.2, 0.0, 0.0, 0.0, 0.4], abs=1e-4)


@pytest.mark.parametrize(("name", "parameter"), PARAMETERS)
def test_each_parameter_has_a_range(name, parameter):
    allowed = EFFECTS[name].parameters[parameter]
    for value in (allowed.low, allowed.high, allowed.default):
        assert make_term(name, {parameter: value}).values()[parameter] == value
    beyond = 1e-6 * (allowed.high - allowed.low)
    for value in (allowed.low - beyond, allowed.high + beyond, math.nan, math.inf, -math.inf):
        with pytest.raises(ValueError, match=rf"^{parameter}: got .*, expected {allowed.low} to {allowed.high}"):
            make_term(name, {parameter: value})


@pytest.mark.parametrize("name", ring_effects())
def test_an_effect_without_values_changes_nothing(name):
    term, k = make_term(name, {}), motion(5)
    assert term.values() == {parameter: allowed.default for parameter, allowed in term.effect.parameters.items()}
    none = BallModel().acceleration(k)
    np.testing.assert_allclose(BallModel((term,)).acceleration(k), none, rtol=0, atol=2e-14)  # but for rounding


def test_values_in_order_or_by_name():
    assert tilt_offset(0.01, 0.02) == tilt_offset(gamma=0.02, beta=0.01) == tilt_offset(0.01, gamma=0.02)
    assert tilt_offset(0.01).values() == {"beta": 0.01, "gamma": 0.0}
    assert dry_friction(0.3) != dry_friction(0.3, 0.1)
    assert dry_friction(0.3) != viscous_friction(0.3)
    with pytest.raises(ValueError, match="got 3 values of tilt_offset, expected 2 at most"):
        tilt_offset(0.01, 0.02, 0.03)


def test_parameters_are_looked_up_with_a_default():
    model = BallModel((rolling_inertia(0.6), tilt_offset(0.01, 0.02)))
    assert model.parameter("rolling_inertia", "factor", 1.0) == 0.6
    assert model.parameter("tilt_offset", "gamma", 0.0) == 0.02
    assert model.parameter("viscous_friction", "coefficient", 0.25) == 0.25


def test_unknown_names_are_told_what_there_is():
    expected = (
        "got effect 'magic', expected one of rolling_inertia, viscous_friction, dry_f.*; an effect of your own needs"
    )
    with pytest.raises(ValueError, match=expected):
        make_term("magic", {})
    with pytest.raises(ValueError, match="got parameter 'strength' of viscous_friction, expected one of coefficient"):
        make_term("viscous_friction", {"strength": 1.0})
    with pytest.raises(ValueError, match="expected one of coefficient, asymmetry"):
        make_term("dry_friction", {"beta": 1.0})
