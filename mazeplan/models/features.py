"""What the learned ball models see of a state: inputs of the kernel, and physical features that enter linearly.

inputs (9)      theta_d, beta_d, gamma_d, sin and cos of theta, beta, gamma
paper (7)       the terms of the ball's equation (see `effects`), each with a weight of its own, and -theta_d:
                    beta_dd sin(gamma), -beta_d^2 sin(theta) cos(theta) cos(gamma)^2, 2 beta_d gamma_d cos(gamma)
                    sin(theta)^2, gamma_d^2 sin(theta) cos(theta), -sin(beta) sin(theta), -sin(gamma) cos(beta)
                    cos(theta), -theta_d
local (11)      the same state as an opening sees it, see `local_inputs`
wall (6)        gravity, and friction at floor and wall, see `wall_features`
effects (5)     what effects with a name can become: gravity part, -theta_d, -tanh(theta_d / w), and the change of the
                gravity part with a tilt of the table about either axis

Sources: the nine inputs and the seven terms are those of Romeres et al., "Semiparametrical Gaussian Processes Learning
of Forward Dynamical Models for Navigating in a Circular Maze", ICRA 2019, with the terms derived anew.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mazeplan.constants import GRAVITY, WALL_ROLLING
from mazeplan.physics.arrays import RingKinematics, gravity_jacobian, gravity_part
from mazeplan.records import Array

INPUTS = (
    "theta_dot", "beta_dot", "gamma_dot", "sin_theta", "cos_theta", "sin_beta", "cos_beta", "sin_gamma", "cos_gamma",
)  # fmt: skip
PAPER = {  # name: unit of its weight
    "turning": "1", "centripetal_beta": "1", "coriolis": "1", "centripetal_gamma": "1",
    "gravity_beta": "1/s^2", "gravity_gamma": "1/s^2", "viscous": "1/s",
}  # fmt: skip
EFFECTS = {
    "rolling_inertia.factor": "1", "viscous_friction.coefficient": "1/s", "dry_friction.coefficient": "rad/s^2",
    "tilt_offset.beta": "rad", "tilt_offset.gamma": "rad",
}  # fmt: skip
LOCAL = (
    "theta_dot", "sin_theta", "cos_theta", "along", "across", "along_dot", "across_dot", "outward", "across_past",
    "sin_4theta", "cos_4theta",
)  # fmt: skip
WALL = ("gravity_beta", "gravity_gamma", "viscous", "dry", "quadratic", "wall")
# the local kernel: one term on the first nine inputs, and one for what all openings of a wall have in common: four of
# them, the same seen from either side. Seen in a mirror a force along the ring changes its sign, hence the odd term
LOCAL_TERMS: tuple[tuple[tuple[int, ...], tuple[float, ...]], ...] = (
    (tuple(range(9)), ()),
    ((0, 3, 4, 9, 10, 7, 8), (-1.0, -1.0, 1.0, -1.0, 1.0, 1.0, 1.0)),
)
STATE_TERMS: tuple[tuple[tuple[int, ...], tuple[float, ...]], ...] = ((tuple(range(9)), ()),)
TERMS = {"state": STATE_TERMS, "local": LOCAL_TERMS}  # by the name of the inputs
# for planning: without the cosines of the tilt, which differ from one by .4 % and tell nothing but when it was measured
PLANNED_TERMS: tuple[tuple[tuple[int, ...], tuple[float, ...]], ...] = (((0, 1, 2, 3, 4, 5, 7), ()),)
DRY_WIDTH = 0.1  # rad/s over which dry friction changes sign, as the planner has it


def inputs(k: RingKinematics) -> Array:
    """The inputs of the kernel, (N, 9), in the order of `INPUTS`; rad/s and 1."""
    columns = [k.theta_dot, k.beta_dot, k.gamma_dot]
    for angle in (k.theta, k.beta, k.gamma):
        columns += [np.sin(angle), np.cos(angle)]
    return np.stack(columns, axis=1)


def local_inputs(k: RingKinematics) -> Array:
    """The state as an opening sees it, (N, 11), in the order of `LOCAL`: tilt and its rates along and across the ring,
    what presses the ball outwards (m/s^2), the tilt across the ring a while ago, which tells on which wall the ball has
    come to lie, and place within a quarter turn. Without a past the tilt of the moment stands for it."""
    s, c = np.sin(k.theta), np.cos(k.theta)
    sb, cb, sg = np.sin(k.beta), np.cos(k.beta), np.sin(k.gamma)
    across = sb * c - sg * s
    past = [getattr(k, f"{axis}_past", getattr(k, axis)) for axis in ("beta", "gamma")]
    columns = [
        k.theta_dot, s, c, -(sb * s + sg * cb * c), across, -(k.beta_dot * s + k.gamma_dot * c),
        k.beta_dot * c - k.gamma_dot * s, outward(k, across), past[0] * c - past[1] * s,
        np.sin(4.0 * k.theta), np.cos(4.0 * k.theta),
    ]  # fmt: skip
    return np.stack(columns, axis=1)


def outward(k: RingKinematics, across: Array) -> Array:
    """What presses the ball outwards, m/s^2: its turning, and gravity as far as a rolling ball feels it."""
    return k.radius * k.theta_dot**2 + GRAVITY * WALL_ROLLING * across


def paper_features(k: RingKinematics) -> Array:
    """The seven terms, (N, 7), in the order of `PAPER`."""
    s, c, cg = np.sin(k.theta), np.cos(k.theta), np.cos(k.gamma)
    return np.stack(
        [
            k.beta_ddot * np.sin(k.gamma),
            -(k.beta_dot**2) * s * c * cg**2,
            2.0 * k.beta_dot * k.gamma_dot * cg * s**2,
            k.gamma_dot**2 * s * c,
            -np.sin(k.beta) * s,
            -np.sin(k.gamma) * np.cos(k.beta) * c,
            -k.theta_dot,
        ],
        axis=1,
    )


def effect_features(k: RingKinematics) -> Array:
    """What multiplies the parameters of effects, (N, 5), in the order of `EFFECTS`; rad/s^2 per unit.

    The tilt of the table comes out times the rolling factor. Analytic in the state, so that complex steps pass."""
    by_tilt = gravity_jacobian(k)[:, [2, 4]]
    friction = [-k.theta_dot, -np.tanh(k.theta_dot / DRY_WIDTH)]
    return np.column_stack([gravity_part(k), *friction, by_tilt])


def wall_features(k: RingKinematics) -> Array:
    """Gravity along either axis, viscous, dry and quadratic friction, dry friction at the wall the ball presses
    on: (N, 6), in the order of `WALL`."""
    s, c = np.sin(k.theta), np.cos(k.theta)
    pressing = outward(k, np.sin(k.beta) * c - np.sin(k.gamma) * s)
    speed, sign = k.theta_dot, np.tanh(k.theta_dot / DRY_WIDTH)
    absolute = np.sqrt(pressing**2 + 1e-6), np.sqrt(speed**2 + 1e-6)  # smooth, for complex steps
    columns = [
        -np.sin(k.beta) * s, -np.sin(k.gamma) * np.cos(k.beta) * c, -speed, -sign, -absolute[1] * speed,
        -absolute[0] * sign,
    ]  # fmt: skip
    return np.stack(columns, axis=1)


FEATURES = {"paper": paper_features, "effects": effect_features, "wall": wall_features}
INPUT_SETS = {"state": inputs, "local": local_inputs}
STATE = ("theta", "theta_dot", "beta", "beta_dot", "gamma", "gamma_dot")
STEP = 1e-30  # of a complex step: exact to rounding, since nothing is subtracted


def feature_jacobian(features: str, k: RingKinematics, weights: Array) -> Array:
    """Derivatives (N, 6) of a weighted sum of features by `STATE`, by complex steps."""
    return np.stack([moved @ weights for moved in _tangents(FEATURES[features], k)], axis=1)


def through_inputs(input_set: str, k: RingKinematics, gradient: Array) -> Array:
    """From derivatives by inputs (N, D) to those by `STATE`, (N, 6)."""
    return np.stack([np.sum(moved * gradient, axis=1) for moved in _tangents(INPUT_SETS[input_set], k)], axis=1)


def _tangents(function: Callable[[RingKinematics], Array], k: RingKinematics) -> list[Array]:
    """Derivatives of columns (N, C) by each of `STATE`."""
    moved = (replace(k, **{name: getattr(k, name) + 1j * STEP}) for name in STATE)
    return [np.asarray(function(other).imag / STEP, dtype=np.float64) for other in moved]
