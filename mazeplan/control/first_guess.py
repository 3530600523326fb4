"""First guess of a cold plan: the commands of a simple law, simulated on the effects of the ring's model.

If the solver started from level commands, it would first have to find the acceleration and then the braking. The law
knows both. It chooses a speed v from which the ball can still brake, and tilts the plate to accelerate it towards v:

    v = sign(e) min(RATE |e| + |v_g|, sqrt(v_g^2 + 2 a SHARE |e|)),    theta_dd = GAIN (v - theta_dot)

e: remaining angle; v_g: speed at the goal; a: acceleration at the tilt limit. The law looks LEAD ahead because the
plate lags. The roll-out costs a fifth of an iteration and saves more than half of the iterations.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, typeof

from mazeplan.core.maths.compiled import KERNEL, copy_into
from mazeplan.core.records import Array
from mazeplan.physics.dynamics.ring_dynamics import step
from mazeplan.physics.dynamics.ring_parameters import BETA_0, DRIVE, GAMMA_0

RATE, GAIN = 6.0, 14.0  # 1/s
SHARE = 0.8  # share of the deceleration that the tilt limit gives
LEAD = 0.1  # s; about the lag of the stage


@njit(**KERNEL)
def _follow(p, s, goal, goal_speed, lean, limit, out, controls):
    """Simulate the law from s (6,), which is overwritten, on packed effects p. Writes into controls (T, 2)."""
    for t in range(controls.shape[0]):
        theta = s[0] + LEAD * s[1]
        left = goal - theta
        arriving = goal_speed if goal_speed * left > 0.0 else 0.0
        brakes = math.sqrt(arriving * arriving + 2.0 * SHARE * p[DRIVE] * limit * abs(left))
        speed = math.copysign(min(RATE * abs(left) + abs(arriving), brakes), left)
        along = GAIN * (speed - s[1]) / p[DRIVE]
        sin, cos = math.sin(theta), math.cos(theta)
        controls[t, 0] = min(max(lean * cos - along * sin - p[BETA_0], -limit), limit)
        controls[t, 1] = min(max(-lean * sin - along * cos - p[GAMMA_0], -limit), limit)
        step(s, controls[t], p, out)
        copy_into(s, out)


def first_guess(
    packed: Array, state: Array, horizon: int, goal: float, goal_speed: float, lean: float, limit: float
) -> Array:
    """Commands (horizon, 2), rad, inside the tilt limit. They are level if the effects have no gravity.

    packed:      `RingParameters.pack()`
    state:       planner state (6,)
    horizon:     number of commands
    goal:        goal angle on the turn to be taken, rad
    goal_speed:  speed at the goal, rad/s
    lean:        wanted outward tilt, rad
    limit:       tilt limit, rad"""
    controls = np.zeros((horizon, 2))
    if packed[DRIVE] > 0.0:
        _follow(packed, np.array(state, dtype=float), goal, goal_speed, lean, limit, np.empty(6), controls)
    return controls


def compile_guess() -> None:
    """Compile the law and its simulation; runs nothing."""
    v = np.zeros(6)
    _follow.compile(tuple(map(typeof, (v, v, 0.0, 0.0, 0.0, 0.0, v, np.zeros((1, 2))))))
