"""The planner measured alone, on a learned model: time cold and warm, what culling changes, and against other solvers.

Usage: python tools/bench_solver.py [MODEL] [--quick]. MODEL: folder of a learned model; the packaged one of the toy
when it is left out. Problems are drawn with a seed: a quarter turn of pi/4 from anywhere on the
ring, goal to either side. Used by tools/bench.py.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from bench_solver_rows import how_compared, other_rows, problem_of

from mazeplan.control.ilqg import IlqgOptions
from mazeplan.control.ring_planner import RingPlanner
from mazeplan.core.records import Array, Plan, StopReason
from mazeplan.learning import fast_gp
from mazeplan.learning.features import inputs
from mazeplan.learning.gaussian_process import GaussianProcess
from mazeplan.learning.modelfile import RigModel, load_model
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.dynamics.ring_parameters import RingParameters
from mazeplan.physics.formulas.arrays import RingKinematics

RINGS, MEASURED = (1, 2, 3, 4), 1  # the ring on which solvers are compared
HORIZON, WARM_STEPS, MOVE = 40, 8, math.pi / 4
SPREAD = np.array([0.3, 0.01, 0.05, 0.01, 0.05])  # of start rates and tilts: rad/s, then rad, rad/s for either axis
DISTURBANCE = np.array([0.002, 0.02, 0.0005, 0.005, 0.0005, 0.005])  # per warm step, as SPREAD with the angle first
NEAR = 0.02  # how far random states near a row are off it, of the spread of all states
ASKED = {"cold": (3.0, 10.0), "warm": (0.5, 2.0)}  # ms, p50 and p99
ASKED_MEAN = 1e-6  # rad/s^2


class Case(NamedTuple):
    """A problem: planner state (6,), and the angle to go to, rad."""

    s0: Array
    goal: float


@dataclass
class Times:
    """ms and iterations of every solve."""

    ms: list[float] = field(default_factory=list)
    iterations: list[int] = field(default_factory=list)
    reasons: Counter[StopReason] = field(default_factory=Counter)

    def add(self, plan: Plan) -> None:
        self.ms.append(plan.ms)
        self.iterations.append(plan.iterations)
        self.reasons[plan.reason] += 1

    def join(self, other: Times) -> None:
        """Take in the solves of another."""
        self.ms += other.ms
        self.iterations += other.iterations
        self.reasons += other.reasons

    def cells(self) -> list[str]:
        """ms and iterations, p50 / p99 each."""
        ms, n = np.percentile(self.ms, (50, 99)), np.percentile(self.iterations, (50, 99))
        return [f"{ms[0]:.2f} / {ms[1]:.2f}", f"{n[0]:.0f} / {n[1]:.0f}"]


def parameters_of(maze: Maze, model: RigModel, ring: int) -> RingParameters:
    return RingParameters.from_model(model, ring, maze.ring(ring).track_radius)


def planner_of(maze: Maze, model: RigModel, ring: int, *, culled: bool = True) -> RingPlanner:
    """Without a deadline; culled: False asks the process for all of its rows."""
    tolerance = fast_gp.TOLERANCE
    fast_gp.TOLERANCE = tolerance if culled else -1.0  # below zero nothing is small enough to be left out
    try:
        return RingPlanner(
            parameters_of(maze, model, ring),
            maze.tilt_limit,
            IlqgOptions(horizon=HORIZON),
            process=model.processes.get(ring),
        )
    finally:
        fast_gp.TOLERANCE = tolerance


def cases(count: int, seed: int) -> list[Case]:
    """Moves from anywhere, at rest but for a little."""
    rng, out = np.random.default_rng(seed), []
    for _ in range(count):
        theta = rng.uniform(-math.pi, math.pi)
        s0 = np.array([theta, *(SPREAD * rng.standard_normal(5))])
        out.append(Case(s0, theta + MOVE * float(rng.choice((-1.0, 1.0)))))
    return out


def measure(planner: RingPlanner, problems: list[Case], seed: int) -> tuple[Times, Times]:
    """Cold solves, and after each the warm ones of the next steps: its first command applied, the state disturbed."""
    rng, cold, warm = np.random.default_rng(seed), Times(), Times()
    planner.warm_up()
    p = np.array(planner.dynamics.parameters, dtype=float)
    for s0, goal in problems:
        plan = planner.plan(s0, goal)
        cold.add(plan)
        state = s0
        for k in range(1, WARM_STEPS + 1):
            reached = np.empty(6)
            planner.dynamics.step(state, plan.controls[0], p, reached)
            state = reached + DISTURBANCE * rng.standard_normal(6)
            plan = planner.plan(state, goal, warm=plan, t0=k * planner.parameters.dt)
            warm.add(plan)
    return cold, warm


def passes(planner: RingPlanner, case: Case) -> tuple[float, float]:
    """Least ms of one roll-out and of one linearisation of all steps: what an iteration takes at the very least."""
    problem = problem_of(planner, *case)
    zeros = np.zeros((HORIZON, 2))
    states = problem.roll_out(zeros)[1].copy()

    def least(call: Callable[[], object]) -> float:
        times = []
        for _ in range(50):
            began = time.perf_counter()
            call()
            times.append(time.perf_counter() - began)
        return 1e3 * min(times)

    return least(lambda: problem.roll_out(zeros)), least(lambda: problem.along(states, zeros))


def ilqg_rows(maze: Maze, model: RigModel, count: int) -> list[str]:
    rows = [
        "| ring | rows of the process | cold p50 / p99, ms | iterations | warm p50 / p99, ms | iterations "
        "| roll-out, linearising, ms | cold ones that did not converge | warm ones that go on next tick |",
        "|---" * 9 + "|",
    ]
    runs = [(ring, True, count) for ring in RINGS]
    if MEASURED in model.processes:
        runs.insert(1, (MEASURED, False, max(1, count // 4)))
    all_cold, all_warm = Times(), Times()
    for ring, culled, n in runs:
        planner, problems = planner_of(maze, model, ring, culled=culled), cases(n, ring)
        cold, warm = measure(planner, problems, ring)
        if culled:
            all_cold.join(cold)
            all_warm.join(warm)
        process = model.processes.get(ring)
        name = f"ring{ring}" + ("" if culled else f", culling off, {n} problems")
        lost = {str(reason): k for reason, k in cold.reasons.items() if reason is not StopReason.CONVERGED}
        cells = [
            name,
            f"{len(process)}" if process is not None else "none",
            *cold.cells(),
            *warm.cells(),
            ", ".join(f"{ms:.2f}" for ms in passes(planner, problems[0])),
            ", ".join(f"{reason} {k}" for reason, k in lost.items()) or "none",
            f"{warm.reasons[StopReason.MAX_ITERATIONS]} of {len(warm.ms)}",
        ]
        rows.append(f"| {' | '.join(cells)} |")
    rows.append(f"| {' | '.join(['all rings', '', *all_cold.cells(), *all_warm.cells(), '', '', ''])} |")
    return rows


def culling_error(process: GaussianProcess, radius: float, limit: float, count: int, seed: int) -> float:
    """Largest difference of the compiled, culled mean from the plain one over random states, rad/s^2.

    Half of them from anywhere, half near rows of the process: where there are none, every mean is about zero."""
    rng = np.random.default_rng(seed)
    spread = np.array([math.pi, 8.0, limit, 0.8, limit, 0.8])  # rad, rad/s
    x = process.inputs[rng.integers(len(process), size=count - count // 2)]
    angles = [np.arctan2(x[:, i], x[:, i + 1]) for i in (3, 5, 7)]
    rows = np.column_stack([angles[0], x[:, 0], angles[1], x[:, 1], angles[2], x[:, 2]])
    near = rows + NEAR * spread * rng.standard_normal(rows.shape)
    states = np.vstack([spread * rng.uniform(-1.0, 1.0, (count // 2, 6)), near])
    theta, theta_dot, beta, beta_dot, gamma, gamma_dot = states.T
    none = np.zeros(len(states))
    k = RingKinematics(radius, theta, theta_dot, beta, beta_dot, none, gamma, gamma_dot, none)
    got, _ = fast_gp.evaluate(fast_gp.pack(process), states)
    return float(np.max(np.abs(got - process.mean(inputs(k)))))


def culling_rows(maze: Maze, model: RigModel, count: int) -> list[str]:
    if not model.processes:
        return ["This model has no process, so that there is nothing to cull."]
    errors = []
    for ring, process in sorted(model.processes.items()):
        place = maze.ring(ring)
        if not isinstance(process, GaussianProcess):
            return ["The model has networks in place of processes, so that there is nothing to cull."]
        errors.append(f"ring{ring} {culling_error(process, place.track_radius, maze.tilt_limit, count, ring):.1e}")
    return [
        f"Largest difference of the culled, compiled mean from the plain one over {count} random states, rad/s^2: "
        + ", ".join(errors)
        + f" (asked: {ASKED_MEAN:.0e})."
    ]


def solver_section(model: Path | None, quick: bool) -> list[str]:
    """Everything, as lines of Markdown."""
    maze, name = load_map("cme"), "toy" if model is None else str(model)
    learned, count, few = load_model(name), 10 if quick else 100, 3 if quick else 10
    rng = np.random.default_rng(100)
    problems = [(case.s0, case.goal) for case in cases(few, 100)]
    disturbances = DISTURBANCE * rng.standard_normal((few, WARM_STEPS, 6))
    asked = "; ".join(f"{kind} p50 {p50:g}, p99 {p99:g}" for kind, (p50, p99) in ASKED.items())
    return [
        "## The solver alone",
        "",
        f"`python tools/bench_solver.py {'' if model is None else 'MODEL'}`: {count} moves of pi/4 a ring, from drawn "
        "angles at small rates and tilts,",
        f"{HORIZON} steps of 1/30 s, commands to {math.degrees(maze.tilt_limit):g} deg, one thread, no deadline. Warm: "
        f"after each cold solve {WARM_STEPS} times its first command",
        "is applied, the state reached disturbed, the plan shifted and improved from there. Iterations p50 / p99.",
        "",
        f"Asked, ms: {asked}.",
        "",
        *ilqg_rows(maze, learned, count),
        "",
        *culling_rows(maze, learned, 300 if quick else 3000),
        "",
        "### Against other solvers",
        "",
        *how_compared(few, MEASURED),
        *other_rows(planner_of(maze, learned, MEASURED), problems, disturbances),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("model", type=Path, nargs="?", help="folder of a learned model")
    parser.add_argument("--quick", action="store_true", help="few problems, to try the script itself")
    options = parser.parse_args()
    print("\n".join(solver_section(options.model, options.quick)))


if __name__ == "__main__":
    main()
