"""Planner for one ring: iLQG on the ring's dynamics and cost.

A cold start begins with the commands of a simple law, simulated on the effects of the ring's model (`first_guess`).
If the solver started from level commands, it would first have to find the acceleration and then the braking. The law
chooses a speed v from which the ball can still brake, and tilts the plate to accelerate it towards v:

    v = sign(e) min(RATE |e| + |v_g|, sqrt(v_g^2 + 2 a SHARE |e|)),    theta_dd = GAIN (v - theta_dot)

e: remaining angle; v_g: speed at the goal; a: acceleration at the tilt limit. The law looks LEAD ahead because the
plate lags. The roll-out costs a fifth of an iteration and saves more than half of the iterations.

With a Gaussian process, a coarse plan on the effects alone comes next. It costs a tenth of the work and lies near the
final plan, while a direct search on the rough learned dynamics takes many iterations.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numba import njit, typeof

from mazeplan.control import cost as ring_cost
from mazeplan.control.cost import CostParameters
from mazeplan.control.ilqg import Cost, Dynamics, IlqgOptions, Planner, Stopwatch
from mazeplan.core.maths.angles import nearest
from mazeplan.core.maths.compiled import KERNEL, copy_into
from mazeplan.core.records import Array, Plan
from mazeplan.learning import fast_gp
from mazeplan.learning.gaussian_process import GaussianProcess
from mazeplan.physics.dynamics import ring_dynamics
from mazeplan.physics.dynamics.ring_parameters import BETA_0, DRIVE, GAMMA_0, RingParameters

COARSE, COARSE_SUBSTEPS = 3e-3, 1  # tolerance and substeps of the coarse plan
COARSE_SHARE = 0.5  # share of the deadline that the coarse plan may take
RATE, GAIN = 6.0, 14.0  # 1/s
SHARE = 0.8  # share of the deceleration that the tilt limit gives
LEAD = 0.1  # s; about the lag of the stage

RING_COST = Cost(ring_cost.running, ring_cost.running_derivatives, ring_cost.final, ring_cost.final_derivatives)


class RingPlanner:
    """Plans along one ring."""

    def __init__(
        self,
        parameters: RingParameters,
        tilt_limit: float,
        options: IlqgOptions,
        cost: CostParameters | None = None,
        *,
        process: GaussianProcess | None = None,
        watch: Stopwatch | None = None,
    ) -> None:
        """parameters: effects and stage of the ring's model.

        tilt_limit:  largest command, rad per axis
        process:     Gaussian process, added to the effects
        watch:       stopwatch for deadlines"""
        self.parameters, self.tilt_limit, self.cost = parameters, tilt_limit, cost or CostParameters()
        limit, watch = np.full(2, tilt_limit), watch or Stopwatch()
        self.options = options

        def planner(dynamics: Dynamics, options: IlqgOptions) -> Planner:
            return Planner(dynamics, RING_COST, -limit, limit, options, dt=parameters.dt, watch=watch)

        self._effects = parameters.pack()
        effects = Dynamics(ring_dynamics.linearise, parameters.pack(), 6)
        self._coarse = None
        if process is None:
            self._planner = planner(effects, options)
        else:
            packed = fast_gp.pack_with_process(parameters, process)
            self._planner = planner(Dynamics(fast_gp.linearise, packed, 6), options)
            if parameters.physics:  # else there are no effects for a coarse plan
                rough = replace(effects, parameters=parameters.pack(COARSE_SUBSTEPS))
                self._coarse = planner(rough, replace(options, tolerance=max(COARSE, options.tolerance)))

    def plan(
        self,
        state: Array,
        goal_theta: float,
        *,
        lean: float = 0.0,
        goal_theta_dot: float = 0.0,
        warm: Plan | None = None,
        t0: float = 0.0,
        deadline_ms: float | None = None,
    ) -> Plan:
        """A plan from a planner state (6,) to an angle. It does not raise: see `Plan.reason`.

        goal_theta:      goal angle on the turn to be taken, rad; theta is not wrapped
        lean:            wanted outward tilt, rad; negative: against the inner wall
        goal_theta_dot:  rate on arrival, rad/s
        warm:            the last plan, of any turn
        t0:              rig time of the state, s
        deadline_ms:     time limit, ms; None: that of the options
        """
        if warm is not None:
            warm = self._same_turn(warm, float(state[0]), t0)
        target = self.cost.pack(goal_theta, goal_theta_dot, lean)
        if warm is not None:
            early = {"tolerance": self.options.warm_tolerance, "early_stop_after": self.options.warm_iterations}
            return self._planner.solve(state, target, warm, t0=t0, deadline_ms=deadline_ms, **early)
        horizon, limit = self.options.horizon, self.tilt_limit
        guess = first_guess(self._effects, state, horizon, goal_theta, goal_theta_dot, lean, limit)
        if self._coarse is not None:
            return self._from_effects(self._coarse, state, target, guess, t0, deadline_ms)
        return self._planner.solve(state, target, guess, t0=t0, deadline_ms=deadline_ms)

    def _from_effects(
        self, coarse: Planner, state: Array, target: Array, guess: Array, t0: float, deadline_ms: float | None
    ) -> Plan:
        """A cold start: the coarse plan on the effects, refined on the full model. Adds up times and iterations."""
        deadline = self.options.deadline_ms if deadline_ms is None else deadline_ms
        first = coarse.solve(state, target, guess, t0=t0, deadline_ms=COARSE_SHARE * deadline)
        warm = first if first.ok else None
        left = max(0.0, deadline - first.ms)
        plan = self._planner.solve(state, target, warm, t0=t0, deadline_ms=left)
        return replace(plan, ms=first.ms + plan.ms, iterations=first.iterations + plan.iterations)

    def _same_turn(self, warm: Plan, theta: float, t0: float) -> Plan | None:
        """The last plan, moved by whole turns to the ball's angle; None if it cannot be used."""
        if not (warm.ok and math.isfinite(theta) and np.isfinite(warm.controls).all()):
            return None
        k = min(max(0, round((t0 - warm.t0) / warm.dt)), len(warm.controls))
        planned = float(warm.states[k, 0])
        turns = nearest(planned, theta) - planned
        if abs(turns) < 1.0:
            return warm
        states = warm.states.copy()
        states[:, 0] += turns
        return replace(warm, states=states)

    def warm_up(self) -> None:
        """Compile or load everything before the rig moves."""
        self.plan(np.zeros(6), 0.5)


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
        ring_dynamics.step(s, controls[t], p, out)
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
