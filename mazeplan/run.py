"""One run, tick by tick, with everything wired together.

    Observation -> estimator -> State -> tree -> Command -> Rig, and every tick into the log.

The rig owns the clock; the only wall time read here is the stopwatch around a tick, which decides nothing.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from contextlib import ExitStack
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from mazeplan.behavior.context import RunContext
from mazeplan.behavior.ownleaves import registry_with
from mazeplan.behavior.tree import BehaviorTree
from mazeplan.behavior.treefile import load_tree
from mazeplan.control.cost import CostParameters
from mazeplan.control.gate_rollout import GateRollout
from mazeplan.control.play import Gears
from mazeplan.control.ring_planner import RingPlanner
from mazeplan.control.tilt import Plate
from mazeplan.control.tracking import plan_step
from mazeplan.data.runlog import RunLogWriter
from mazeplan.display import Display, NullDisplay
from mazeplan.errors import RigError
from mazeplan.estimation.delay_bank import estimator_for
from mazeplan.job import Job, Setup, log_header
from mazeplan.maze.geometry import Maze
from mazeplan.maze.graph import RouteGraph
from mazeplan.maze.memory import OpeningMemory
from mazeplan.models.modelfile import RigModel
from mazeplan.models.planar import PlanarModel
from mazeplan.models.ring_parameters import RingParameters
from mazeplan.records import (
    LEVEL,
    Command,
    Failure,
    FailureKind,
    NavigationResult,
    Observation,
    RingPassage,
)
from mazeplan.rigs.interface import Rig


def run_job(
    rig: Rig, setup: Setup, job: Job, *, log: str | Path | None = None, display: Display | None = None
) -> NavigationResult:
    """Do one job on a rig. The plate is level and the log complete afterwards, whatever happens."""
    with ExitStack() as stack:
        writer = stack.enter_context(RunLogWriter(log, log_header(setup, job))) if log is not None else None
        run = Run(rig, setup, job, writer, display or NullDisplay())
        stack.callback(rig.level)
        try:
            result = run.drive(None if log is None else str(log))
        except KeyboardInterrupt:
            if writer is not None:
                writer.result(run.result(False, "interrupted", str(log)).to_json())
            raise
        if writer is not None:
            writer.result(result.to_json())
        return result


def plate_of(maze: Maze, model: RigModel) -> Plate:
    """Limits of the maze and the table's tilt by the model."""
    ball = model.ball(1)
    return Plate(
        maze.tilt_limit,
        ball.parameter("tilt_offset", "beta", 0.0),
        ball.parameter("tilt_offset", "gamma", 0.0),
    )


def planners_of(maze: Maze, model: RigModel, cost: CostParameters, late_s: float) -> dict[int, RingPlanner]:
    """A planner for each channel, for a rig on which a command acts late_s after what was seen."""
    cost = cost.seen_late(late_s)
    return {
        ring.number: RingPlanner(
            RingParameters.from_model(model, ring.number, ring.track_radius),
            maze.tilt_limit,
            cost=cost,
            process=model.processes.get(ring.number),
        )
        for ring in maze.rings
        if not ring.is_disc
    }


def rollout_of(setup: Setup, late_s: float) -> GateRollout | None:
    """What tries commands before openings; None where too much is late for it."""
    leaves = setup.settings.leaves
    if late_s > leaves.rollout.late_s:
        return None
    plate, planar = plate_of(setup.maze, setup.model), PlanarModel.build(setup.maze, setup.model)
    return GateRollout(setup.maze, planar, plate, leaves.gate, leaves.rollout)


class Run:
    """One run in progress: estimator, planners and a tree with a goal, ticked once for each observation.

    `drive` does a whole navigation; who wants another order of things places the ball and calls `tick` and `aim`.
    segment: number of the uninterrupted stretch, for the log; None leaves it out. slew: rad/s, the fastest change of
    the tree's commands."""

    def __init__(
        self,
        rig: Rig,
        setup: Setup,
        job: Job,
        log: RunLogWriter | None,
        display: Display,
        *,
        segment: int | None = None,
        slew: float = math.inf,
    ) -> None:
        self._rig, self._setup, self._job, self._log, self._display = rig, setup, job, log, display
        self._segment, self._most, self.sent = segment, slew / rig.rate_hz, LEVEL
        self._gears = Gears(setup.model.stage, setup.maze.tilt_limit)
        self._estimator = estimator_for(setup.maze, setup.model, setup.settings.estimator, rig.rate_hz)
        # a plate that is kept from moving fast answers later, by half its range on average
        self._late_s = setup.model.late_s + 0.5 * setup.maze.tilt_limit / slew
        self._planners = planners_of(setup.maze, setup.model, setup.settings.leaves.cost, self._late_s)
        self._rollout = rollout_of(setup, self._late_s)
        self._memory = OpeningMemory() if setup.memory is None else setup.memory
        self._tick_ms: list[float] = []
        self._passages: list[RingPassage] = []
        self._ring: int | None = None
        self._ring_since = 0.0
        self.context, self._tree = self._towards(job.goal, job.closed)
        self._warm_up()

    def _towards(self, goal: int, closed: Collection[str]) -> tuple[RunContext, BehaviorTree]:
        """A tree that has not begun, with openings closed and failures of its own; what openings did is kept."""
        setup = self._setup
        graph = RouteGraph(setup.maze, memory=self._memory)
        for name in closed:
            graph.close(name)
        context = RunContext(
            maze=setup.maze,
            graph=graph,
            plate=plate_of(setup.maze, setup.model),
            goal=goal,
            planners=self._planners,
            ahead=self._estimator.ahead,
            on_event=self._on_event,
            options=setup.settings.leaves,
            late_s=self._late_s,
            rollout=self._rollout,
        )
        tree = load_tree(setup.behavior, registry_with(setup.behavior_modules), context)
        tree.blackboard.set("goal", goal)
        if setup.watch is not None:
            setup.watch(tree, context)
        return context, tree

    def _warm_up(self) -> None:
        """Compile and load everything before the rig moves."""
        self._estimator.warm_up()
        for planner in self._planners.values():
            planner.warm_up()
        if self._rollout is not None:
            self._rollout.warm_up()

    def aim(self, goal: int, closed: Collection[str] = ()) -> None:
        """Begin anew towards a ring from where the ball is, not using the openings `closed`.

        Tree, closed openings and failures start afresh; what is known of ball, plate and openings stays."""
        self._tree.halt()
        now = self.context.now
        self.context, self._tree = self._towards(goal, closed)
        self.context.now = self.context.graph.now = now

    def drive(self, log: str | None) -> NavigationResult:
        """Place the ball and run until the tree has succeeded, the time is over, or the tree gave up."""
        job, rng = self._job, np.random.default_rng(self._job.seed)
        theta = float(rng.uniform(-math.pi, math.pi)) if job.theta is None else job.theta
        self._on_event("start", {"ring": job.start, "theta": theta})
        self._rig.reset(ring=job.start, theta=theta, rng=rng)
        while True:
            observation = self._rig.observe()
            status = self.tick(observation)
            if status == "SUCCESS":
                return self._end(True, "arrived", log)
            if status == "SKIPPED":  # its preconditions let it do nothing: it would not do better at the next tick
                return self._end(False, "skipped", log)
            if status == "FAILURE":
                last = self.context.last_failure
                return self._end(False, str(last.kind) if last else "failed", log)
            if observation.t >= job.time_limit:
                detail = f"not in ring {job.goal} after {job.time_limit:g} s"
                self.context.failed(Failure(FailureKind.OUT_OF_TIME, "run", observation.t, detail))
                return self._end(False, str(FailureKind.OUT_OF_TIME), log)

    def _end(self, success: bool, reason: str, log: str | None) -> NavigationResult:
        self._tree.halt()
        self._rig.level()
        return self.result(success, reason, log)

    def tick(self, observation: Observation, given: Command | None = None, by: str = "") -> str:
        """Take in an observation, command the rig, write the log; the tree's status: SUCCESS, FAILURE, RUNNING or
        SKIPPED.

        A command `given` by something else, named in `by`, goes out instead while the tree rests: RUNNING. Raises
        RigError when the rig measured no number."""
        began = perf_counter()
        run = self.context
        if not all(math.isfinite(v) for v in (observation.t, observation.beta, observation.gamma)):
            raise RigError(f"the rig measured no number: {observation}")
        state = self._estimator.update(observation)
        measured = self._estimator.filtered or state
        run.begin(observation.t, state, measured)
        self._note_ring(observation.t, state.ring)
        if given is None:
            status, command = self._tree.tick().name, self._slewed(run.command or LEVEL)
        else:
            status, command, run.plan, run.opening, run.goal_theta = "RUNNING", given, None, None, None
            run.steer(by, given)
        self.sent = command
        passed_on = command
        if self._gears.loose:
            command = self._gears.lead(command) if given is None else command
            passed_on = self._gears.sent(command)
        self._rig.command(command.u_beta, command.u_gamma)
        self._estimator.sent(passed_on, observation.t)
        self._tick_ms.append(1e3 * (perf_counter() - began))
        self._write(observation, command)
        self._tick_ms[-1] = 1e3 * (perf_counter() - began)
        return status

    def _slewed(self, wanted: Command) -> Command:
        """As far towards the command wanted as one sample allows."""
        last, most = self.sent, self._most
        return Command(
            min(max(wanted.u_beta, last.u_beta - most), last.u_beta + most),
            min(max(wanted.u_gamma, last.u_gamma - most), last.u_gamma + most),
        )

    def _write(self, observation: Observation, command: Command) -> None:
        run = self.context
        leaf = run.commanded_by
        self._display.tick(observation.t, run.here.ring, leaf)
        if self._log is not None:
            self._log.tick(
                observation,
                command,
                state=run.here,
                leaf=leaf,
                opening=None if run.opening is None else run.opening.name,
                goal_theta=run.goal_theta,
                planned_theta=self._planned_theta(),
                planner_ms=run.planner_ms[-1] if run.planner_ms else None,
                tick_ms=self._tick_ms[-1],
                segment=self._segment,
            )

    def _planned_theta(self) -> float | None:
        """Where the plan wants the ball at the state's own time, while a plan is followed."""
        run = self.context
        if run.plan is None or run.commanded_by != "Track":
            return None
        return float(run.plan.states[plan_step(run.plan, run.here.t), 0])

    def _note_ring(self, t: float, ring: int) -> None:
        if ring == self._ring:
            return
        if self._ring is not None:
            name = self._passed(self._ring, ring)
            self._passages.append(RingPassage(self._ring, t - self._ring_since, name))
            self._display.passed(self._ring, name or "another opening", t)
        self._ring, self._ring_since = ring, t
        self._display.ring_entered(ring, t)
        self._on_event("ring", {"ring": ring})

    def _passed(self, before: int, ring: int) -> str | None:
        """Name of the opening by which the ball changed its ring: the nearest that joins the two, if any does."""
        joining = [o for o in self._setup.maze.openings if {o.outer, o.inner} == {before, ring}]
        nearest = min(joining, key=lambda o: abs(self.context.turn_to(o)), default=None)
        return None if nearest is None else nearest.name

    def _on_event(self, kind: str, detail: dict[str, Any]) -> None:
        t = self.context.now
        if kind == "plan":
            if self._log is not None:
                self._log.plan(detail["plan"])
            return
        if self._log is not None:
            self._log.event(t, kind, detail)
        if kind in ("failure", "recovery"):
            self._display.event(t, ", ".join(str(value) for value in detail.values() if value))

    def result(self, success: bool, reason: str, log: str | None) -> NavigationResult:
        """What has happened until now."""
        run = self.context
        passages = list(self._passages)
        if self._ring is not None:
            passages.append(RingPassage(self._ring, run.now - self._ring_since, None))
        return NavigationResult(
            success=success,
            reason=reason,
            time_s=round(run.now, 6),
            seed=self._job.seed,
            rig=self._setup.rig_name,
            rings=tuple(passages),
            failures=tuple(run.failures),
            replans=run.replans,
            planner_ms=spread(run.planner_ms),
            log=log,
            tick_ms=spread(self._tick_ms),
        )


def spread(values: Sequence[float]) -> dict[str, float]:
    """p50, p99 and max; 0 when there are none."""
    if not values:
        return {"p50": 0.0, "p99": 0.0, "max": 0.0}
    p50, p99 = np.percentile(values, [50.0, 99.0])
    return {"p50": round(float(p50), 4), "p99": round(float(p99), 4), "max": round(float(max(values)), 4)}
