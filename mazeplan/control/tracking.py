"""Tracking laws: the plan's time-varying gains, and PD without a plan.

    gains:  u = u_k + K_k (s - s_k)
    no plan:      tilt along theta for  kp (goal - theta) - kd theta_dot, and the lean

k is the step of the plan at the time of the state. All commands are clipped to the tilt limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mazeplan.control.tilt import Plate
from mazeplan.core.constants import GRAVITY
from mazeplan.core.field_checks import check_numbers
from mazeplan.core.maths.angles import nearest
from mazeplan.core.records import Array, Command, Plan, State


@dataclass(frozen=True)
class TrackingOptions:
    """Settings of the tracking laws. Raises SettingsError.

    kp, kd:                      gains of the PD law, as angular acceleration, 1/s^2 and 1/s
    replan_theta, replan_speed:  deviations from the plan that call for a new plan, rad and rad/s"""

    kp: float = 60.0
    kd: float = 12.0
    replan_theta: float = 0.05
    replan_speed: float = 0.6
    replan_every: int = 1  # maximum number of ticks between plans

    def __post_init__(self) -> None:
        check_numbers(self, positive=("replan_every",))


def plan_step(plan: Plan, t: float) -> int:
    """The step of the plan at rig time t; after the end of the plan, its last step."""
    return int(min(max(round((t - plan.t0) / plan.dt), 0), len(plan.controls) - 1))


def finished(plan: Plan, t: float) -> bool:
    """Whether the plan has no command left at time t."""
    return t > plan.t0 + (len(plan.controls) - 0.5) * plan.dt


def deviation(plan: Plan, state: State) -> Array:
    """Planner state minus planned state at the time of the state, shape (6,); theta by the shorter way round."""
    planned = plan.states[plan_step(plan, state.t)]
    s = state.planner_vector()
    s[0] = nearest(s[0], planned[0])
    return s - planned


def follow_gains(plan: Plan, state: State, plate: Plate) -> Command:
    """The plan's command, corrected by the time-varying gains of the plan."""
    k = plan_step(plan, state.t)
    u = plan.controls[k] + plan.gains[k] @ deviation(plan, state)
    return plate.clip(float(u[0]), float(u[1]))


def pd_to_angle(
    state: State, turn: float, plate: Plate, options: TrackingOptions, radius: float, lean: float = 0.0
) -> Command:
    """PD on the remaining angle `turn` (rad), with the plate leaning by `lean` (rad, outwards positive)."""
    along = (options.kp * turn - options.kd * state.theta_dot) * radius  # m/s^2
    outwards = GRAVITY * math.sin(lean)
    c, s = math.cos(state.theta), math.sin(state.theta)
    return plate.command(outwards * c - along * s, outwards * s + along * c)


def off_plan(plan: Plan, state: State, options: TrackingOptions) -> bool:
    """Whether the ball is so far from the plan that a new plan is needed."""
    error = deviation(plan, state)
    return bool(abs(error[0]) > options.replan_theta or abs(error[1]) > options.replan_speed)
