"""Inputs of the kernel, and physical features that enter a ball model linearly.

| name | columns | what |
|---|---|---|
| state inputs | 9 | theta_d, beta_d, gamma_d, sin and cos of theta, beta, gamma |
| local inputs | 11 | the state relative to the ring at the ball, see `local_inputs` |
| paper features | 7 | the terms of the ball's equation, see `paper_features` |
| effects features | 5 | derivatives by the parameters of effects, see `effect_features` |
| wall features | 6 | gravity, and friction at floor and wall, see `wall_features` |

Source of the nine inputs and the seven terms: Romeres et al., "Semiparametrical Gaussian Processes Learning of Forward
Dynamical Models for Navigating in a Circular Maze", ICRA 2019; the terms are derived anew.
"""

from __future__ import annotations

import numpy as np

from mazeplan.core.constants import GRAVITY, WALL_ROLLING
from mazeplan.core.records import Array
from mazeplan.physics.ball_model import RingKinematics, gravity_jacobian, gravity_part

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
KernelColumns = tuple[tuple[tuple[int, ...], tuple[float, ...]], ...]  # columns and flip of each term of a kernel
# One term on the first nine inputs; one for the four openings of a wall, which are alike. Seen in a mirror, a force
# along the ring changes its sign: the second term is odd.
LOCAL_TERMS: KernelColumns = (
    (tuple(range(9)), ()),
    ((0, 3, 4, 9, 10, 7, 8), (-1.0, -1.0, 1.0, -1.0, 1.0, 1.0, 1.0)),
)
STATE_TERMS: KernelColumns = ((tuple(range(9)), ()),)
# for planning: without the cosines of the tilt, which differ from one by .4 % and only reveal the time of a sample
PLANNED_TERMS: KernelColumns = (((0, 1, 2, 3, 4, 5, 7), ()),)
DRY_WIDTH = 0.1  # rad/s over which dry friction changes sign in the planner


def inputs(k: RingKinematics) -> Array:
    """State inputs of the kernel, (N, 9), in the order of `INPUTS`; rad/s and 1."""
    columns = [k.theta_dot, k.beta_dot, k.gamma_dot]
    for angle in (k.theta, k.beta, k.gamma):
        columns += [np.sin(angle), np.cos(angle)]
    return np.stack(columns, -1)


def local_inputs(k: RingKinematics) -> Array:
    """Local inputs of the kernel, (N, 11), in the order of `LOCAL`.

    They are the tilt and its rates along and across the ring, the outward acceleration (m/s^2), the place within a
    quarter turn, and the earlier tilt across the ring, which decides at which wall the ball is. If there is no earlier
    tilt, the present tilt takes its place."""
    s, c = np.sin(k.theta), np.cos(k.theta)
    sb, cb, sg = np.sin(k.beta), np.cos(k.beta), np.sin(k.gamma)
    across = sb * c - sg * s
    past = [getattr(k, f"{axis}_past", getattr(k, axis)) for axis in ("beta", "gamma")]
    columns = [
        k.theta_dot, s, c, -(sb * s + sg * cb * c), across, -(k.beta_dot * s + k.gamma_dot * c),
        k.beta_dot * c - k.gamma_dot * s, outward(k, across), past[0] * c - past[1] * s,
        np.sin(4.0 * k.theta), np.cos(4.0 * k.theta),
    ]  # fmt: skip
    return np.stack(columns, -1)


def outward(k: RingKinematics, across: Array) -> Array:
    """Outward acceleration of the ball (N,), m/s^2: centrifugal, and gravity times the rolling factor."""
    return k.radius * k.theta_dot**2 + GRAVITY * WALL_ROLLING * across


def paper_features(k: RingKinematics) -> Array:
    """The seven terms of the ball's equation, (N, 7), in the order of `PAPER`."""
    s, c, cg = np.sin(k.theta), np.cos(k.theta), np.cos(k.gamma)
    columns = [
        k.beta_ddot * np.sin(k.gamma), -(k.beta_dot**2) * s * c * cg**2, 2.0 * k.beta_dot * k.gamma_dot * cg * s**2,
        k.gamma_dot**2 * s * c, -np.sin(k.beta) * s, -np.sin(k.gamma) * np.cos(k.beta) * c, -k.theta_dot,
    ]  # fmt: skip
    return np.stack(columns, axis=1)


def effect_features(k: RingKinematics) -> Array:
    """Derivatives of theta_dd by the parameters of effects, (N, 5), in the order of `EFFECTS`; rad/s^2 per unit.

    The weight of a tilt feature is the tilt of the table times the rolling factor."""
    by_tilt = gravity_jacobian(k)[:, [2, 4]]
    friction = [-k.theta_dot, -np.tanh(k.theta_dot / DRY_WIDTH)]
    return np.column_stack([gravity_part(k), *friction, by_tilt])


def wall_features(k: RingKinematics) -> Array:
    """Gravity by axis; viscous, dry, quadratic friction; dry friction at the wall: (N, 6), in the order of `WALL`."""
    s, c = np.sin(k.theta), np.cos(k.theta)
    pressing = outward(k, np.sin(k.beta) * c - np.sin(k.gamma) * s)
    speed, sign = k.theta_dot, np.tanh(k.theta_dot / DRY_WIDTH)
    absolute = np.sqrt(pressing**2 + 1e-6), np.sqrt(speed**2 + 1e-6)  # smooth
    columns = [
        -np.sin(k.beta) * s, -np.sin(k.gamma) * np.cos(k.beta) * c, -speed, -sign, -absolute[1] * speed,
        -absolute[0] * sign,
    ]  # fmt: skip
    return np.stack(columns, axis=1)
