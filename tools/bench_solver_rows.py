"""The table that sets the planner beside other solvers: rows of the same problems, timed side by side.

Solvers in C++ have the stopwatch inside and are called three times a problem, the planner just before them; those with
a model in Python once, Python included. Used by tools/bench_solver.py.
"""

from __future__ import annotations

import textwrap
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from bench_solver_crocoddyl import box_fddp_library
from bench_solver_native import NativeSolver
from bench_solver_others import ITERATIONS, SOLVERS, Answer, Problem, ipopt_from
from bench_solver_sqp import hpipm_target, sqp_library
from bench_solver_starts import EFFECTS, GUESS, LEVEL, WARM, Task, guess_of, start_of, tasks_of

from mazeplan.control.ring_planner import RingPlanner
from mazeplan.core.records import Array, StopReason

SAME_COMMANDS = np.radians(0.5)  # plans whose commands differ by less belong to the same minimum
OTHER_COST = 1e-2  # relative: so far apart is another local minimum for certain
ASKED_COST, ASKED_FASTER = 1e-4, 10.0  # relative; times BoxFDDP
CALLS = 3  # of a compiled solver, for the median of its time
FDDP, SQP, RTI = "BoxFDDP (crocoddyl)", "SQP (HPIPM)", "one RTI step (HPIPM)"


@dataclass(frozen=True)
class Rival:
    """A solver with a start. model: what its dynamics are called through; solve: None where the start does not
    exist."""

    name: str
    model: str
    start: str
    solve: Callable[[Task], Answer | None]


@dataclass
class Score:
    """One rival on all problems; `off` is (its cost - the planner's) / the planner's."""

    ms: list[float] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    iterations: list[int] = field(default_factory=list)
    off: list[float] = field(default_factory=list)
    same: list[bool] = field(default_factory=list)  # whether it found the planner's minimum
    converged: list[bool] = field(default_factory=list)
    qp_ms: list[float] = field(default_factory=list)

    def add(self, problem: Problem, answer: Answer, task: Task, ms: float) -> None:
        self.ms.append(ms)
        self.times.append(ms / task.plan.ms)
        if answer.iterations is not None:
            self.iterations.append(answer.iterations)
        self.off.append(problem.roll_out(answer.controls)[0] / task.plan.cost - 1.0)
        self.same.append(float(np.max(np.abs(answer.controls - task.plan.controls))) < SAME_COMMANDS)
        self.converged.append(answer.converged)
        self.qp_ms.append(answer.qp_ms)

    def row(self, rival: Rival) -> str:
        off, n = np.array(self.off), len(self.off)
        same, ms = np.abs(off[np.array(self.same)]), np.percentile(self.ms, (50, 95))
        judged = rival.name != RTI  # a single step does not say whether it was enough
        cells = [
            *(rival.name, rival.model, rival.start),
            f"{ms[0]:.2f} / {ms[1]:.2f}",
            f"{np.median(self.times):.1f}",
            f"{np.median(self.iterations):.0f}" if self.iterations else "-",
            f"{sum(self.converged)}/{n}" if judged else "-",
            f"{np.median(off):+.1e}",
            f"{off[np.argmax(np.abs(off))]:+.1e}",
            f"{np.sum(off > OTHER_COST)} / {np.sum(off < -OTHER_COST)}",
            f"{len(same)}/{n}" + (f", {same.max():.0e}" if len(same) else ""),
        ]
        return f"| {' | '.join(cells)} |"


HEAD = [
    "| solver | model | starts from | ms, median / p95 | times iLQG's | iterations | says it converged "
    f"| cost to iLQG's: median | worst | {OTHER_COST:.0%} dearer / cheaper "
    "| same minimum, and worst difference there |",
    "|---" * 11 + "|",
]


def how_compared(count: int, ring: int) -> list[str]:
    """What the table is about, in front of it."""
    text = (
        f"{count} of these problems on ring {ring} cold, then warm ones after each as above; every solver is given "
        "iLQG's former plan there, and ends by iLQG's rules (IPOPT, SLSQP and L-BFGS-B have their own). One thread, "
        "the same compiled dynamics and cost, side by side. Model: compiled, the solver calls them from C++, and "
        "its stopwatch is inside; Python, from a Python class, which is counted. Starts: level commands; commands of "
        "iLQG's first guess; iLQG's plan on the effects alone, the time of which is counted; warm, the former plan "
        "shifted, followed with its gains but for RTI. Second derivatives: as iLQG's (Gauss-Newton) for BoxFDDP, SQP "
        "and RTI, true ones for IPOPT; SLSQP and L-BFGS-B shoot with exact gradients. Costs are those of the commands "
        "rolled out by the planner. Same minimum: all commands within "
        f"{np.degrees(SAME_COMMANDS):g} deg of iLQG's."
    )
    return [*textwrap.wrap(text, 118), ""]


def problem_of(planner: RingPlanner, s0: Array, goal: float) -> Problem:
    """For other solvers."""
    return Problem(planner.dynamics, planner.options.horizon, s0, planner.cost.pack(goal), planner.tilt_limit)


def compiled_rivals(planner: RingPlanner, missing: list[str]) -> list[Rival]:
    """Those in C++ that can be compiled and loaded here, on the planner's dynamics; why others cannot, to missing."""
    rivals = []
    for name, library in ((FDDP, box_fddp_library), (SQP, sqp_library)):
        try:
            solver = NativeSolver(library(), planner.dynamics, planner.tilt_limit, planner.options, ITERATIONS)
        except ImportError as problem:
            missing.append(f"{name}, compiled ({_why(problem)})")
            continue
        starts = (LEVEL, GUESS, EFFECTS, WARM)
        rivals += [Rival(name, "compiled", start, _solve(planner, solver, start)) for start in starts]
        if name == SQP:
            once = _solve(planner, solver, WARM, feasible=False, entry="step_once")
            rivals.append(Rival(RTI, "compiled", WARM, once))
    return rivals


def _solve(
    planner: RingPlanner, solver: NativeSolver, name: str, *, feasible: bool = True, entry: str = "solve"
) -> Callable[[Task], Answer | None]:
    tolerance = planner.options.warm_tolerance if name == WARM else None

    def solve(task: Task) -> Answer | None:
        if (task.former is None) == (name == WARM):
            return None
        start = start_of(planner, task, name, feasible=feasible)
        if start is None:
            return None
        q = planner.cost.pack(task.goal)
        answers = [solver.solve(task.s0, q, start, tolerance=tolerance, entry=entry) for _ in range(CALLS)]
        return sorted(answers, key=lambda answer: answer.ms or 0.0)[CALLS // 2]

    return solve


def own_rivals(planner: RingPlanner) -> list[Rival]:
    """The planner's solver without what the planner does before: from level commands, and from the first guess."""

    def solve(task: Task, start: str) -> Answer | None:
        if task.former is not None:
            return None
        guess = guess_of(planner, task.s0, task.goal) if start == GUESS else None
        q = planner.cost.pack(task.goal)
        plans = [planner._planner.solve(task.s0, q, guess) for _ in range(CALLS)]
        plan = sorted(plans, key=lambda plan: plan.ms)[CALLS // 2]
        return Answer(plan.controls, plan.reason is StopReason.CONVERGED, plan.ms, plan.iterations)

    return [Rival("iLQG", "compiled", start, partial(solve, start=start)) for start in (LEVEL, GUESS)]


def _why(problem: ImportError) -> str:
    return f"{problem.name} is not installed" if isinstance(problem, ModuleNotFoundError) else str(problem)


def compiled_scores(planner: RingPlanner, tasks: Iterable[Task], rivals: list[Rival]) -> tuple[list[Task], list[Score]]:
    """The tasks as they were solved, and a score for each rival."""
    done, scores, warmed = [], [Score() for _ in rivals], False
    for task in tasks:
        problem = problem_of(planner, task.s0, task.goal)
        for rival, score in zip(rivals, scores, strict=True):
            if not warmed:
                rival.solve(task)
            answer = rival.solve(task)
            if answer is not None and answer.ms is not None:
                score.add(problem, answer, task, answer.ms)
        done.append(task)
        warmed = True
    return done, scores


def python_score(solve: Callable[[Problem, Task], Answer], planner: RingPlanner, tasks: list[Task]) -> Score:
    """One solver with a model in Python on all problems; what it must load is loaded before. Raises ImportError where
    it is missing."""
    solve(problem_of(planner, tasks[0].s0, tasks[0].goal), tasks[0])
    score = Score()
    for task in tasks:
        problem = problem_of(planner, task.s0, task.goal)
        began = time.perf_counter()
        answer = solve(problem, task)
        score.add(problem, answer, task, 1e3 * (time.perf_counter() - began))
    return score


def _own_row(tasks: list[Task], start: str) -> str:
    plans = [task.plan for task in tasks]
    ms, n = np.percentile([plan.ms for plan in plans], (50, 95)), len(plans)
    done = sum(plan.reason is StopReason.CONVERGED for plan in plans)
    steps = np.median([plan.iterations for plan in plans])
    head = f"| iLQG | compiled | {start} | {ms[0]:.2f} / {ms[1]:.2f} | 1 | {steps:.0f} | {done}/{n} "
    return head + "| - " * 4 + "|"


def other_rows(planner: RingPlanner, cases: list[tuple[Array, float]], disturbances: Array) -> list[str]:
    """The table and what follows from it. cases: cold problems, planner state (6,) and goal, rad; disturbances (cases,
    steps, 6): of the states that the warm ones after each begin at."""
    planner.warm_up()
    missing: list[str] = []
    rivals = own_rivals(planner) + compiled_rivals(planner, missing)
    tasks, scores = compiled_scores(planner, tasks_of(planner, cases, disturbances), rivals)
    cold, warm = ([task for task in tasks if (task.former is not None) == later] for later in (False, True))
    rows = {rival: score for rival, score in zip(rivals, scores, strict=True) if score.ms}
    for name, solve in SOLVERS.items():
        rival = Rival(FDDP if name == "BoxFDDP" else name, "Python", LEVEL, lambda task: None)
        try:
            rows[rival] = python_score(lambda problem, _, solve=solve: solve(problem), planner, cold)
        except ImportError as problem:
            missing.append(f"{name} ({_why(problem)})")
            continue
        if name == "IPOPT":
            near = python_score(lambda problem, task: ipopt_from(problem, task.plan.controls), planner, cold)
            rows[Rival(name, "Python", "iLQG's plan", rival.solve)] = near
    return [
        *HEAD,
        _own_row(cold, f"{GUESS}, {EFFECTS}" if planner._coarse else GUESS),
        *(score.row(rival) for rival, score in rows.items() if rival.start != WARM),
        _own_row(warm, WARM),
        *(score.row(rival) for rival, score in rows.items() if rival.start == WARM),
        "",
        f"Asked: cost within {ASKED_COST:.0e} of IPOPT's where both found the same minimum.",
        *_conclusions(rows),
        *(f"Left out: {one}." for one in missing),
    ]


def _conclusions(rows: dict[Rival, Score]) -> list[str]:
    lines = []
    fddp = [
        f"{np.median(score.times):.1f} ({rival.model} model, from {rival.start})"
        for rival, score in rows.items()
        if rival.name == FDDP
    ]
    if fddp:
        lines.append(f"Times iLQG's that BoxFDDP takes (median; {ASKED_FASTER:g} was asked): {', '.join(fddp)}.")
    for rival, score in rows.items():
        if rival.name == RTI:
            lines.append(
                f"Of an RTI step {np.median(score.qp_ms):.2f} ms are the quadratic problem; the rest can be done before"
                f" the state is known. HPIPM counts with a BLASFEO compiled for {hpipm_target()}."
            )
    return lines
