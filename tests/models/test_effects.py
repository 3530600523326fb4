"""Effects one by one: formula, derivatives, ranges, names."""

from __future__ import annotations

import math

import numpy as np
import pytest
from finite_differences import jacobian

from mazeplan.models.ball import BallModel
from mazeplan.models.effects import (
    EFFECTS,
    ConstantTorque,
    DryFriction,
    GateLoss,
    QuadraticDrag,
    RingKinematics,
    RollingInertia,
    SurfaceBump,
    SurfaceProfile,
    TiltOffset,
    ViscousFriction,
    gravity_jacobian,
    gravity_part,
    kinematic_jacobian,
    kinematic_terms,
    make_effect,
)

RADIUS = 0.0689
STATE = ("theta", "theta_dot", "beta", "beta_dot", "gamma", "gamma_dot")
EXAMPLES = {
    "rolling_inertia": RollingInertia(0.6),
    "tilt_offset": TiltOffset(0.02, -0.01),
    "viscous_friction": ViscousFriction(0.4),
    "dry_friction": DryFriction(0.3, 0.1),
    "quadratic_drag": QuadraticDrag(0.2),
    "constant_torque": ConstantTorque(0.7),
    "surface_profile": SurfaceProfile(0.1, -0.2, 0.3, 0.5, -0.1, 0.2),
    "surface_bump": SurfaceBump(1.0, 0.4, -2.0),
    "gate_loss": GateLoss(0.5, 0.2),
}
PARAMETERS = [(name, parameter) for name, kind in EFFECTS.items() for parameter in kind.parameters]


def motion(seed=0, n=40, **fixed):
    rng = np.random.default_rng(seed)
    drawn = {name: rng.uniform(-1.0, 1.0, n) for name in (*STATE, "beta_ddot", "gamma_ddot")}
    scale = {"theta": 3.1, "theta_dot": 8.0, "beta": 0.3, "gamma": 0.3, "beta_ddot": 20.0, "gamma_ddot": 20.0}
    return RingKinematics(RADIUS, **{name: scale.get(name, 2.0) * v for name, v in drawn.items()} | fixed)


def differences(f, k):
    """Derivatives (N, 6) of f(k) (N,) by differences, sample by sample."""

    def at(i):
        rest = {"beta_ddot": k.beta_ddot[i : i + 1], "gamma_ddot": k.gamma_ddot[i : i + 1]}

        def value(x):
            return f(RingKinematics(k.radius, **dict(zip(STATE, x[:, None], strict=True)), **rest))

        return jacobian(value, [getattr(k, name)[i] for name in STATE], 1e-3)[0]

    return np.array([at(i) for i in range(k.theta.size)])


def test_every_effect_is_tried_here():
    assert {name: type(effect) for name, effect in EXAMPLES.items()} == EFFECTS


def test_formulas():
    k = motion()
    w, base = k.theta_dot, BallModel().acceleration(k)
    a, away = k.theta, np.angle(np.exp(1j * (k.theta - 1.0))) / 0.4
    expected = {
        "viscous_friction": -0.4 * w,
        "dry_friction": np.where(w > 0.0, -0.3, 0.3) - 0.1,
        "quadratic_drag": np.where(w > 0.0, -0.2, 0.2) * w**2,
        "constant_torque": np.full_like(w, 0.7),
        "surface_profile": 0.1 * np.cos(a)
        - 0.2 * np.sin(a)
        + 0.3 * np.cos(2 * a)
        + 0.5 * np.sin(2 * a)
        - 0.1 * np.cos(3 * a)
        + 0.2 * np.sin(3 * a),
        "surface_bump": -2.0 * np.exp(0.5) * away * np.exp(-0.5 * away**2),
        "gate_loss": np.zeros_like(w),
        "rolling_inertia": -0.4 * gravity_part(k),
        "tilt_offset": gravity_part(motion(beta=k.beta + 0.02, gamma=k.gamma - 0.01)) - gravity_part(k),
    }
    for name, effect in EXAMPLES.items():
        added = BallModel((effect,)).acceleration(k) - base
        np.testing.assert_allclose(added, expected[name], rtol=0, atol=1e-11, err_msg=name)
        assert (effect.term(k) == 0.0).all() == (name in ("rolling_inertia", "tilt_offset", "gate_loss")), name


def test_gravity_pulls_to_where_the_plate_is_lowest():
    theta = np.array([0.0, math.pi / 2, math.pi, -math.pi / 2])
    level = np.zeros(4)
    about_y = motion(n=4, theta=theta, beta=level + 0.1, gamma=level)  # lowest at theta = 0
    pull = 9.81 / RADIUS * math.sin(0.1)
    assert gravity_part(about_y) == pytest.approx([0.0, -pull, 0.0, pull])
    about_x = motion(n=4, theta=theta, beta=level, gamma=level + 0.1)  # lowest at theta = -pi / 2
    assert gravity_part(about_x) == pytest.approx([-pull, 0.0, pull, 0.0])


def test_a_plate_that_does_not_turn_adds_nothing_to_gravity():
    still = motion(beta_dot=np.zeros(40), gamma_dot=np.zeros(40), beta_ddot=np.zeros(40), gamma_ddot=np.zeros(40))
    assert (kinematic_terms(still) == 0.0).all()


def test_derivatives_of_gravity_and_of_the_turning_plate():
    k = motion(1)
    np.testing.assert_allclose(kinematic_jacobian(k), differences(kinematic_terms, k), rtol=1e-8, atol=1e-8)
    tilted = differences(lambda m: gravity_part(m, 0.02, -0.03), k)
    np.testing.assert_allclose(gravity_jacobian(k, 0.02, -0.03), tilted, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", EXAMPLES)
def test_derivatives_of_each_effect(name):
    k, effect = motion(2), EXAMPLES[name]
    assert (np.abs(k.theta_dot) > 5e-3).all()  # no difference is taken across the kink at rest
    np.testing.assert_allclose(effect.jacobian(k), differences(effect.term, k), rtol=1e-8, atol=1e-8)
    one = BallModel((effect,))
    np.testing.assert_allclose(one.jacobian(k), differences(one.acceleration, k), rtol=1e-8, atol=1e-7)


def test_derivatives_of_all_effects_together():
    k, model = motion(3), BallModel(tuple(EXAMPLES.values()))
    np.testing.assert_allclose(model.jacobian(k), differences(model.acceleration, k), rtol=1e-8, atol=1e-7)


def test_a_resting_ball_has_no_friction():
    k = motion(theta_dot=np.zeros(40))
    for name in ("viscous_friction", "dry_friction", "quadratic_drag"):
        assert (EXAMPLES[name].term(k) == 0.0).all(), name


@pytest.mark.parametrize("effect", [EXAMPLES["viscous_friction"], EXAMPLES["quadratic_drag"], DryFriction(0.3)])
def test_friction_only_ever_slows(effect):
    k = motion(4)
    assert (effect.term(k) * k.theta_dot < 0.0).all()


@pytest.mark.parametrize(("name", "parameter"), PARAMETERS)
def test_each_parameter_has_a_range(name, parameter):
    allowed = EFFECTS[name].parameters[parameter]
    for value in (allowed.low, allowed.high, allowed.default):
        assert make_effect(name, {parameter: value}).values()[parameter] == value
    beyond = 1e-6 * (allowed.high - allowed.low)
    for value in (allowed.low - beyond, allowed.high + beyond, math.nan, math.inf, -math.inf):
        with pytest.raises(ValueError, match=rf"^{parameter}: got .*, expected {allowed.low} to {allowed.high}"):
            make_effect(name, {parameter: value})


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_without_values_changes_nothing(name):
    effect, k = make_effect(name, {}), motion(5)
    assert effect.values() == {parameter: allowed.default for parameter, allowed in effect.parameters.items()}
    np.testing.assert_array_equal(BallModel((effect,)).acceleration(k), BallModel().acceleration(k))


def test_parameters_are_looked_up_with_a_default():
    model = BallModel((RollingInertia(0.6), TiltOffset(0.01, 0.02)))
    assert model.parameter("rolling_inertia", "factor", 1.0) == 0.6
    assert model.parameter("tilt_offset", "gamma", 0.0) == 0.02
    assert model.parameter("viscous_friction", "coefficient", 0.25) == 0.25


def test_unknown_names_are_told_what_there_is():
    with pytest.raises(ValueError, match="got effect 'magic', expected one of rolling_inertia, tilt_offset, visc"):
        make_effect("magic", {})
    with pytest.raises(ValueError, match="got parameter 'strength' of viscous_friction, expected one of coefficient"):
        make_effect("viscous_friction", {"strength": 1.0})
    with pytest.raises(ValueError, match="expected one of coefficient, asymmetry"):
        make_effect("dry_friction", {"beta": 1.0})
