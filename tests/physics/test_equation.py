"""The ball's equation against a derivation that shares nothing with it: Lagrange's equation of a point on a circle
in a tilting plate."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from mazeplan.physics.ball_model import BallModel, RingKinematics
from mazeplan.physics.effects.ball import rolling_inertia, tilt_offset

GRAVITY = 9.81
NAMES = ("theta", "theta_dot", "beta", "beta_dot", "beta_ddot", "gamma", "gamma_dot", "gamma_ddot")


@pytest.fixture(scope="module")
def lagrange():
    """theta_dd as a function of (r, theta, theta_d, beta, beta_d, beta_dd, gamma, gamma_d, gamma_dd)."""
    t, r, g = sp.symbols("t r g")
    theta, beta, gamma = (sp.Function(name)(t) for name in ("theta", "beta", "gamma"))
    pitch = sp.Matrix([[sp.cos(beta), 0, sp.sin(beta)], [0, 1, 0], [-sp.sin(beta), 0, sp.cos(beta)]])
    roll = sp.Matrix([[1, 0, 0], [0, sp.cos(gamma), -sp.sin(gamma)], [0, sp.sin(gamma), sp.cos(gamma)]])
    place = pitch * roll * sp.Matrix([r * sp.cos(theta), r * sp.sin(theta), 0])
    speed = place.diff(t)
    lagrangian = (speed.T * speed)[0] / 2 - g * place[2]
    rate, angle = sp.symbols("rate angle")
    momentum = lagrangian.subs(theta.diff(t), rate).diff(rate).subs(rate, theta.diff(t))
    force = lagrangian.subs(theta.diff(t), rate).subs(theta, angle).diff(angle).subs(angle, theta)
    force = force.subs(rate, theta.diff(t))
    unknown = sp.Symbol("theta_dd")
    equation = (momentum.diff(t) - force).subs(theta.diff(t, 2), unknown)
    solution = -equation.subs(unknown, 0) / equation.diff(unknown)  # linear in it; sp.solve takes seconds
    symbols = sp.symbols("th thd b bd bdd c cd cdd")
    values = {}
    for function, (x, xd, xdd) in ((beta, symbols[2:5]), (gamma, symbols[5:8])):
        values.update({function.diff(t, 2): xdd, function.diff(t): xd, function: x})
    solution = solution.subs({k: v for k, v in values.items() if k.is_Derivative and k.derivative_count == 2})
    solution = solution.subs({k: v for k, v in values.items() if k.is_Derivative and k.derivative_count == 1})
    solution = solution.subs(theta.diff(t), symbols[1]).subs({beta: symbols[2], gamma: symbols[5], theta: symbols[0]})
    return sp.lambdify((r, g, *symbols), solution)


def random_motion(n=50, seed=0, radius=0.07):
    rng = np.random.default_rng(seed)
    scale = {"theta": 3.0, "theta_dot": 4.0, "beta": 0.3, "beta_dot": 2.0, "beta_ddot": 20.0}
    scale |= {"gamma": 0.3, "gamma_dot": 2.0, "gamma_ddot": 20.0}
    return RingKinematics(radius, **{name: scale[name] * rng.uniform(-1, 1, n) for name in NAMES})


@pytest.mark.slow
def test_sliding_point_is_lagranges_equation(lagrange):
    k = random_motion()
    expected = lagrange(k.radius, GRAVITY, *(getattr(k, name) for name in NAMES))
    assert np.allclose(BallModel().acceleration(k), expected, rtol=1e-12, atol=1e-10)


def test_gravity_part_is_scaled_and_offset(lagrange):
    k = random_motion(seed=1)
    tilted = RingKinematics(**{**k.__dict__, "beta": k.beta + 0.02, "gamma": k.gamma - 0.01})
    zero = np.zeros_like(k.theta)

    def gravity(motion):
        still = [motion.theta, zero, motion.beta, zero, zero, motion.gamma, zero, zero]
        return lagrange(k.radius, GRAVITY, *still)

    model = BallModel((rolling_inertia(0.6), tilt_offset(0.02, -0.01)))
    without = lagrange(k.radius, GRAVITY, *(getattr(k, name) for name in NAMES)) - gravity(k)
    assert np.allclose(model.acceleration(k), without + 0.6 * gravity(tilted), atol=1e-10)


def test_equation_holds_in_every_ring_and_at_large_tilts(lagrange):
    for seed, radius in enumerate((0.0285, 0.0487, 0.0891)):
        k = random_motion(seed=10 + seed, radius=radius)
        steep = RingKinematics(**{**k.__dict__, "beta": 4.0 * k.beta, "gamma": 4.0 * k.gamma})
        expected = lagrange(radius, GRAVITY, *(getattr(steep, name) for name in NAMES))
        assert np.allclose(BallModel().acceleration(steep), expected, rtol=1e-12, atol=1e-9)


def test_each_kinematic_term_counts(lagrange):
    """With all but one rate at zero, so that no term can hide behind another."""
    k = random_motion(seed=20)
    zero = np.zeros_like(k.theta)
    for kept in (("beta_ddot",), ("beta_dot",), ("gamma_dot",), ("beta_dot", "gamma_dot"), ("gamma_ddot",)):
        rates = ("beta_dot", "beta_ddot", "gamma_dot", "gamma_ddot")
        one = RingKinematics(**{**k.__dict__, **{name: zero for name in rates if name not in kept}})
        expected = lagrange(k.radius, GRAVITY, *(getattr(one, name) for name in NAMES))
        assert np.allclose(BallModel().acceleration(one), expected, rtol=1e-12, atol=1e-10), kept
