"""Tilt commands inside the limits: for a wanted acceleration of the ball, along a plan, and without a plan.

An acceleration becomes a tilt by the inverse of the gravity part of the ball's equation at small angles, without its
rolling factor:

    a_x = g (beta + beta_0),   a_y = -g (gamma + gamma_0)

where (beta_0, gamma_0) is the tilt of the table. Acceleration here means tilt times g; the ball gets at most 5/7 of it.
The tracking laws, with the step k of the plan at the time of the state, are:

    plan:     u = u_k + K_k (s - s_k)
    no plan:  tilt along theta for  kp (goal - theta) - kd theta_dot, and the lean
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mazeplan.core.constants import GRAVITY
from mazeplan.core.field_checks import check_numbers
from mazeplan.core.maths.angles import nearest
from mazeplan.core.records import Array, Command, Plan, State


@dataclass(frozen=True, slots=True)
class Plate:
    """Tilt limit per axis and tilt of the table, rad."""

    limit: float
    offset_beta: float = 0.0
    offset_gamma: float = 0.0

    def clip(self, u_beta: float, u_gamma: float) -> Command:
        """The command inside the limits."""
        limit = self.limit
        return Command(min(max(u_beta, -limit), limit), min(max(u_gamma, -limit), limit))

    def acceleration(self, command: Command) -> tuple[float, float]:
        """Tilt times g along x and y under a command, m/s^2."""
        return GRAVITY * (command.u_beta + self.offset_beta), -GRAVITY * (command.u_gamma + self.offset_gamma)

    def command(self, ax: float, ay: float) -> Command:
        """The command for a wanted acceleration, m/s^2, clipped per axis."""
        return self.clip(ax / GRAVITY - self.offset_beta, -ay / GRAVITY - self.offset_gamma)

    def command_along(self, first: tuple[float, float], then: tuple[float, float]) -> Command:
        """The command for the acceleration `first`, plus the share of `then` that the limits allow, m/s^2.

        `then` never changes the direction of `first`: braking comes before pushing.
        """
        base = self.command(*first)
        full = (first[0] + then[0]) / GRAVITY - self.offset_beta, -(first[1] + then[1]) / GRAVITY - self.offset_gamma
        share = min(room(base.u_beta, full[0], self.limit), room(base.u_gamma, full[1], self.limit))
        return self.clip(base.u_beta + share * (full[0] - base.u_beta), base.u_gamma + share * (full[1] - base.u_gamma))


def room(start, end, limit):
    """Share, 0 to 1, of the way from start to end that stays within +-limit. start must be within the limit."""
    step = end - start
    if step > 0.0:
        return min(1.0, max(0.0, (limit - start) / step))
    if step < 0.0:
        return min(1.0, max(0.0, (-limit - start) / step))
    return 1.0


@dataclass(frozen=True)
class TrackingOptions:
    """Settings of the tracking laws. Raises SettingsError.

    kp, kd:                      gains of the PD law, as angular acceleration, 1/s^2 and 1/s
    replan_theta, replan_speed:  deviations from the plan that call for a new plan, rad and rad/s"""

    kp: float
    kd: float
    replan_theta: float
    replan_speed: float
    replan_every: int  # maximum number of ticks between plans

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
