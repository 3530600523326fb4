"""What the solvers are given to start from: level commands, the planner's first guess, its next one, or a plan.

A cold plan of the planner begins with the commands of a simple law; where there is a process, a plan on the effects
alone is made of them first, and followed with its gains on the whole model. A warm one follows the plan of a step
before. Each of these can be handed to another solver, and the time of what the planner did before counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from bench_solver_native import FOLLOW, ROLL_OUT, TAKE, Start

from mazeplan.control.first_guess import first_guess
from mazeplan.control.ring_planner import RingPlanner
from mazeplan.core.records import Array, Plan

LEVEL, GUESS, EFFECTS, WARM = "level", "first guess", "plan on effects", "warm"


@dataclass(frozen=True)
class Task:
    """A problem and the planner's answer. s0 (6,); goal: rad; plan: the planner's; former: the plan of a step before
    that a warm one follows, with t0, s, the time of s0."""

    s0: Array
    goal: float
    plan: Plan
    former: Plan | None = None
    t0: float = 0.0


def guess_of(planner: RingPlanner, s0: Array, goal: float) -> Array:
    """Commands (T, 2) that a cold plan of the planner begins with."""
    packed = planner.parameters.pack()
    return first_guess(packed, s0, planner.options.horizon, goal, 0.0, 0.0, planner.tilt_limit)


def start_of(planner: RingPlanner, task: Task, name: str, *, feasible: bool = True) -> Start | None:
    """One of the starts above; None where there is none. feasible: a former plan is followed with its gains, as the
    planner does, else states and commands are taken as they are."""
    T = planner.options.horizon
    if name == LEVEL:
        return Start(ROLL_OUT, np.zeros((T, 2)))
    if name == WARM:
        if task.former is None:
            return None
        return _shifted(task.former, task.t0, FOLLOW if feasible else TAKE, T)
    guess = guess_of(planner, task.s0, task.goal)
    if name == GUESS:
        return Start(ROLL_OUT, guess)
    coarse = planner._coarse
    if coarse is None:
        return None
    first = coarse.solve(task.s0, planner.cost.pack(task.goal), guess)
    return Start(FOLLOW if feasible else TAKE, first.controls, first.states, first.gains, first.ms)


def _shifted(plan: Plan, t0: float, kind: int, T: int) -> Start:
    """A former plan from t0 on, its last command and state repeated."""
    had, shift = len(plan.controls), max(0, round((t0 - plan.t0) / plan.dt))
    index, states = np.minimum(np.arange(T) + shift, had - 1), np.minimum(np.arange(T + 1) + shift, had)
    gains = np.where((np.arange(T) + shift < had)[:, None, None], plan.gains[index], 0.0)
    return Start(kind, plan.controls[index], plan.states[states], gains)


def tasks_of(planner: RingPlanner, cases: list[tuple[Array, float]], disturbances: Array) -> list[Task]:
    """Cold problems, and after each as many warm ones as there are rows of disturbances (steps, 6) of the state, as in
    the planner's own table; every plan is the one of median time of three."""
    p, tasks = np.array(planner.dynamics.parameters, dtype=float), []
    for k, (s0, goal) in enumerate(cases):
        plan = _median(planner, s0, goal)
        tasks.append(Task(s0, goal, plan))
        state = s0
        for n, row in enumerate(disturbances[k], 1):
            reached = np.empty(6)
            planner.dynamics.step(state, plan.controls[0], p, reached)
            state, former, t0 = reached + row, plan, n * planner.parameters.dt
            plan = _median(planner, state, goal, former, t0)
            tasks.append(Task(state, goal, plan, former, t0))
    return tasks


def _median(planner: RingPlanner, s0: Array, goal: float, warm: Plan | None = None, t0: float = 0.0) -> Plan:
    plans = [planner.plan(s0, goal, warm=warm, t0=t0) for _ in range(3)]
    return sorted(plans, key=lambda plan: plan.ms)[1]
