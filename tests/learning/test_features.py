"""Features and inputs against the equation they come from, and against the symmetry of the ring."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mazeplan.core.constants import GRAVITY
from mazeplan.learning.features import (
    EFFECTS,
    INPUTS,
    LOCAL,
    LOCAL_TERMS,
    WALL,
    effect_features,
    inputs,
    local_inputs,
    paper_features,
    wall_features,
)
from mazeplan.learning.samples import MatchedKinematics
from mazeplan.physics.ball_model import (
    RingKinematics,
    gravity_jacobian,
    gravity_part,
    kinematic_terms,
)

RADIUS = 0.0689
ODD = {"theta_dot", "sin_theta", "along", "along_dot", "sin_4theta"}  # of the local inputs, in a mirror


def motion(seed=0, n=50, tilt=0.3, past=True):
    """A ball anywhere in the ring, tilts up to `tilt` rad, with what they were before."""
    rng = np.random.default_rng(seed)

    def drawn(size):
        return size * rng.uniform(-1.0, 1.0, n)

    place = [drawn(np.pi), drawn(8.0)]
    tilts = [drawn(tilt), drawn(10.0 * tilt), drawn(100.0 * tilt), drawn(tilt), drawn(10.0 * tilt), drawn(100.0 * tilt)]
    if not past:
        return RingKinematics(RADIUS, *place, *tilts)
    return MatchedKinematics(RADIUS, *place, *tilts, beta_past=drawn(tilt), gamma_past=drawn(tilt))


def test_the_terms_of_the_equation_add_up_to_it():
    k = motion()
    weights = np.array([1.0, 1.0, 1.0, 1.0, GRAVITY / RADIUS, GRAVITY / RADIUS, 0.0])
    np.testing.assert_allclose(paper_features(k) @ weights, kinematic_terms(k) + gravity_part(k), rtol=1e-12)
    np.testing.assert_array_equal(paper_features(k)[:, 6], -k.theta_dot)


def test_effects_are_gravity_its_changes_with_tilt_and_friction():
    k = motion()
    columns = dict(zip(EFFECTS, effect_features(k).T, strict=True))
    slopes = gravity_jacobian(k)
    np.testing.assert_allclose(columns["rolling_inertia.factor"], gravity_part(k), rtol=1e-12)
    np.testing.assert_allclose(columns["tilt_offset.beta"], slopes[:, 2], rtol=1e-12)
    np.testing.assert_allclose(columns["tilt_offset.gamma"], slopes[:, 4], rtol=1e-12)
    np.testing.assert_array_equal(columns["viscous_friction.coefficient"], -k.theta_dot)
    fast = np.abs(k.theta_dot) > 1.0
    np.testing.assert_allclose(columns["dry_friction.coefficient"][fast], -np.sign(k.theta_dot[fast]), atol=1e-8)
    tilted = gravity_part(k, 1e-5, -2e-5) - gravity_part(k)
    np.testing.assert_allclose(
        1e-5 * columns["tilt_offset.beta"] - 2e-5 * columns["tilt_offset.gamma"], tilted, atol=1e-7
    )


def test_the_wall_holds_back_by_what_presses_on_it():
    k = motion()
    columns = dict(zip(WALL, wall_features(k).T, strict=True))
    np.testing.assert_array_equal(columns["gravity_beta"], paper_features(k)[:, 4])
    np.testing.assert_array_equal(columns["gravity_gamma"], paper_features(k)[:, 5])
    np.testing.assert_array_equal(columns["viscous"], -k.theta_dot)
    np.testing.assert_array_equal(columns["dry"], effect_features(k)[:, 2])
    np.testing.assert_allclose(columns["quadratic"], -np.abs(k.theta_dot) * k.theta_dot, atol=1e-4)
    at = replace(k, theta=0.0 * k.theta)  # here the plate's slope outwards is beta alone
    pressing = RADIUS * k.theta_dot**2 + 5.0 / 9.0 * GRAVITY * np.sin(k.beta)
    np.testing.assert_allclose(wall_features(at)[:, 5], -np.abs(pressing) * np.tanh(k.theta_dot / 0.1), atol=1e-3)
    for column in ("viscous", "dry", "quadratic", "wall"):
        assert (columns[column] * k.theta_dot <= 0.0).all(), f"{column} friction drives the ball"


def test_inputs_are_rates_and_sines():
    k = motion()
    expected = {"theta_dot": k.theta_dot, "beta_dot": k.beta_dot, "gamma_dot": k.gamma_dot}
    for name, angle in (("theta", k.theta), ("beta", k.beta), ("gamma", k.gamma)):
        expected |= {f"sin_{name}": np.sin(angle), f"cos_{name}": np.cos(angle)}
    np.testing.assert_array_equal(inputs(k), np.stack([expected[name] for name in INPUTS], axis=1))
    round_again = replace(k, theta=k.theta + 2.0 * np.pi)
    np.testing.assert_allclose(inputs(round_again), inputs(k), atol=1e-12)
    np.testing.assert_allclose(local_inputs(round_again), local_inputs(k), atol=1e-11)


def test_the_odd_term_flips_what_a_mirror_flips_and_sees_no_place_but_that_in_a_quarter():
    odd = [(columns, flip) for columns, flip in LOCAL_TERMS if flip]
    assert len(odd) == 1
    columns = [LOCAL[column] for column in odd[0][0]]
    assert sorted(columns) == sorted(set(LOCAL) - {"sin_theta", "cos_theta", "along_dot", "across_dot"})
    for column, sign in zip(*odd[0], strict=True):
        assert sign == (-1.0 if LOCAL[column] in ODD else 1.0), LOCAL[column]
        assert LOCAL[column] not in ("sin_theta", "cos_theta")
