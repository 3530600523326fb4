"""One run, tick by tick. This module connects rig, estimator, tree and log:

    Observation -> estimator -> State -> tree -> Command -> Rig, and every tick into the log.

The rig owns the clock. This module reads wall time only to measure how long a tick takes; no decision depends on it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from time import perf_counter
from weakref import WeakMethod

import numpy as np

from mazeplan.behavior.context import BallRoles, LeafOptions, RunContext, Steering
from mazeplan.behavior.follow_policy import check_policy
from mazeplan.behavior.registry import registry_with
from mazeplan.behavior.trees import read_tree
from mazeplan.btree.builder import build
from mazeplan.btree.tree import BehaviorTree
from mazeplan.control.command_chain import CommandChain
from mazeplan.control.estimation.fit_watch import FitWatch
from mazeplan.control.estimation.sample_check import SampleCheck
from mazeplan.control.ilqg import Stopwatch
from mazeplan.core.errors import RigError
from mazeplan.core.events import (
    DoubtRaised,
    GoalChanged,
    MisfitSeen,
    OpeningClosed,
    OpeningReopened,
    RunEvent,
    StopRequested,
)
from mazeplan.core.logs.run_log import RunMessages
from mazeplan.core.progress import Display
from mazeplan.core.records import (
    LEVEL,
    Command,
    Failure,
    FailureKind,
    GoalGiven,
    Misfit,
    NavigationResult,
    Observation,
    Plan,
    Start,
)
from mazeplan.maze.graph import OpeningMemory, RouteGraph
from mazeplan.rigs.interface import Rig
from mazeplan.run.assembly import Balls, compiled_beside, planners_of, plate_of, rollout_of, safety_filter_of
from mazeplan.run.goals import Requests
from mazeplan.run.recorder import RunRecorder, weak_reporter
from mazeplan.run.specification import Job, Setup

HALTED = "HALTED"  # in the log, the status in the ticks that level the plate after the tree was halted


class Run:
    """One run in progress: estimator, planners and a tree with a goal, ticked once for each observation.

    `drive` does a whole navigation. For any other order, place the ball and call `tick` and `aim`.

    segment: number of the uninterrupted stretch, for the log; None leaves it out
    slew: fastest change of the tree's commands, rad/s
    requests: requests from outside; `drive` reads them at each tick
    watch: stopwatch for the planner's deadlines
    """

    def __init__(
        self,
        rig: Rig,
        setup: Setup,
        job: Job,
        log: RunMessages | None,
        display: Display,
        *,
        segment: int | None = None,
        slew: float = math.inf,
        requests: Requests | None = None,
        watch: Stopwatch | None = None,
    ) -> None:
        self._rig = rig
        self._setup = setup
        self._job = job
        self._model = model = setup.driving_model
        self._record = RunRecorder(log or RunMessages(), display, segment)
        self.chain = CommandChain(rig.rate_hz, slew)
        self._sample_check = SampleCheck(rig.rate_hz)
        self._stopwatch = watch or Stopwatch()
        self._slew = slew
        self._leaves = registry_with(setup.behavior_modules)
        self._tree_file = read_tree(setup.behavior)  # read once: the file may change or vanish before the next goal
        with compiled_beside(self._compile_rollout):
            self._balls = Balls(setup, rig.rate_hz)
            self._fit = FitWatch(setup.maze, model, rig.rate_hz)
            self._prepare_control()
            self._balls.warm_up()
        for part in (*self._steering.planners.values(), self._steering.rollout, self._keeper):
            if part is not None:
                part.warm_up()
        self._stopwatch.pop_cuts()
        self._memory = OpeningMemory()
        self._seen_at = 0.0  # rig time when the ball was seen last, s
        self._misfits: list[Misfit] = []
        self._requests = requests
        self._goals = [GoalGiven(ring, 0.0) for ring in (*job.via, job.goal)]
        self.context, self._tree = self._towards(job.goal, job.closed, via=job.via)

    def _prepare_control(self) -> None:
        setup, model = self._setup, self._model
        leaves, late_s = self._leaf_options()
        planners = planners_of(setup.maze, model, leaves, self._stopwatch, late_s=late_s)
        rollout = rollout_of(setup.maze, model, leaves, late_s, self._rig.rate_hz)
        self._steering = Steering(planners, leaves, late_s, rollout)
        self._keeper = safety_filter_of(setup.maze, model)
        self.chain.adopt(model.stage, setup.maze.tilt_limit, self._keeper)

    def _leaf_options(self) -> tuple[LeafOptions, float]:
        """Options of the leaves, and the time until a command acts, s. A limited rate delays the plate, too: on average
        by the time that it needs for half the tilt limit."""
        model = self._model
        late_s = model.late_s + 0.5 * self._setup.maze.tilt_limit / self._slew
        return self._setup.settings.leaves.on_stage(model.true_stage), late_s

    def _compile_rollout(self) -> None:
        rollout = rollout_of(self._setup.maze, self._model, *self._leaf_options(), self._rig.rate_hz)
        if rollout is not None:
            rollout.warm_up()

    def _check_fit(self, observation: Observation) -> None:
        """Look whether the rig behaves as the model says; go on with the stage that it shows, if there is one."""
        seen = self._fit.update(observation)
        if seen is None:
            return
        words, stage = seen
        self._report(MisfitSeen(words, stage is not None))
        self._misfits.append(Misfit(words, observation.t, stage is not None))
        if stage is None:
            self.context.failed(Failure(FailureKind.MISFIT, "run", observation.t, words))
            return
        delay = max(self._model.camera_delay, -stage.dead_time)
        self._model = replace(self._model, stage=stage, camera_delay=delay)
        self._balls.adopt(self._model)
        self._prepare_control()
        run = self.context
        run.steering = self._steering
        run.balls.aheads = self._balls.ahead
        run.ahead = run.balls.aheads[run.balls.led - 1]

    def _towards(
        self, goal: int, closed: Collection[str], t: float = 0.0, via: Sequence[int] = ()
    ) -> tuple[RunContext, BehaviorTree]:
        """A new tree for a goal, with its context: closed openings and failures start afresh. The memory of openings
        and the planners are shared by all trees of the run."""
        setup = self._setup
        graph = RouteGraph(setup.maze, memory=self._memory)
        for name in closed:
            graph.close(name)
        context = RunContext(
            maze=setup.maze,
            graph=graph,
            plate=plate_of(setup.maze, self._model),
            goal=goal,
            steering=self._steering,
            ahead=self._balls.ahead[0],
            report=weak_reporter(WeakMethod(self._report)),
            policy=setup.policy,
            balls=BallRoles(aheads=self._balls.ahead),
        )
        tree = build(self._tree_file, self._leaves, context)
        check_policy(tree, setup.policy)
        tree.blackboard.set_external("goal", goal)
        tree.blackboard.set_external("waypoints", [*via, goal])
        self._record.tree(t, tree)
        if setup.watch is not None:
            setup.watch(tree, context)
        return context, tree

    def aim(self, goal: int, closed: Collection[str] = ()) -> None:
        """Begin a new tree towards another ring, from where the ball is. It does not use the openings `closed`.

        Tree, closed openings and budgets of recoveries start afresh. The estimates of ball and plate, the memory of
        openings and the last command stay: the plate is not levelled."""
        before = self.context
        self._tree.halt()
        self.context, self._tree = self._towards(goal, closed, before.now)
        self.context.carry_on(before)

    def _serve_requests(self, t: float) -> bool:
        """Serve the requests from outside, at the rig time t of this tick. Returns whether the run must stop.

        A sample that is not newer than the last one makes no tick, so requests wait: a replay repeats them by tick."""
        new = math.isfinite(t) and (t > self.context.now or not self._record.began)
        requests = self._requests.take(t) if self._requests is not None and new else ()
        if not requests:
            return False
        run, goal, closed = self.context, None, {}
        run.now = run.graph.now = t
        for request in requests:
            self._report(request)
            match request:
                case StopRequested():
                    return True
                case OpeningClosed(opening):
                    closed[opening] = True
                case OpeningReopened(opening):
                    closed[opening] = False
                case GoalChanged(goal, more):
                    closed |= dict.fromkeys(more, True)
        run.edit(closed)
        if goal is not None:
            shut = run.graph.closed
            self.aim(goal, shut)
            for name in self.context.graph.closed - shut:  # closed in the map, but opened by a request
                self.context.graph.reopen(name)
            self._goals.append(GoalGiven(goal, t))
        return False

    def drive(self) -> NavigationResult:
        """Place the ball and run until the tree succeeds, fails or is skipped, the time is over, or a request stops it.
        The run also ends when the ball is out of the maze or unseen for too long.

        Each goal has the whole time limit, from when it was given. While another goal waits, the run goes on to it."""
        job, rng = self._job, np.random.default_rng(self._job.seed)
        theta = job.start_angle(self._setup.maze, rng)
        self._report(Start(job.start, theta))
        self._rig.reset(ring=job.start, theta=theta, rng=rng)
        began = False
        while True:
            observation = self._admit(self._rig.observe())
            if observation is None:
                continue
            if not began and observation.t >= job.time_limit:
                raise RigError(
                    f"the rig's first sample after reset() is at t = {observation.t:.1f} s, expected about 0"
                )
            began = True
            if self._serve_requests(observation.t):
                return self._end(False, "stopped", observation)
            status = self._answer(observation)
            if self._out_for_long(observation):
                return self._end(False, str(FailureKind.BALL_OUT))
            if self._unseen_for_long(observation):
                return self._end(False, str(FailureKind.BALL_LOST))
            if any(not misfit.adopted for misfit in self._misfits):
                return self._end(False, str(FailureKind.MISFIT))
            late = observation.t - self._goals[-1].t >= job.time_limit
            if (status == "RUNNING" and not late) or not (self._requests is None or self._requests.over()):
                continue
            if status == "SUCCESS":
                return self._succeeded()
            if status == "SKIPPED":  # the tree's preconditions exclude it, and would at the next tick, too
                return self._end(False, "skipped")
            if status == "FAILURE":
                last = self.context.last_failure
                return self._end(False, str(last.kind) if last else "failed")
            detail = f"not in ring {self.context.goal} after {job.time_limit:g} s"
            self.context.failed(Failure(FailureKind.OUT_OF_TIME, "run", observation.t, detail))
            return self._end(False, str(FailureKind.OUT_OF_TIME))

    def _out_for_long(self, observation: Observation) -> bool:
        """Whether the ball has been out of the maze for `out_s`. Reports the failure unless the tree already has."""
        run, limit = self.context, self._setup.out_s
        if run.out is None or limit is None:
            return False
        self._seen_at = observation.t  # a ball that is out does not count as unseen
        over = observation.t - run.out.since >= limit
        if not any(f.kind is FailureKind.BALL_OUT and f.t >= run.out.since for f in run.history.failures):
            run.failed(Failure(FailureKind.BALL_OUT, "run", observation.t, run.out.message))
        return over

    def _unseen_for_long(self, observation: Observation) -> bool:
        if observation.seen and all(other.seen for other in observation.others):
            self._seen_at = observation.t
        limit = self._setup.unseen_s
        if limit is None or observation.t - self._seen_at < limit:
            return False
        detail = f"not seen for {observation.t - self._seen_at:.1f} s"
        self.context.failed(Failure(FailureKind.BALL_LOST, "run", observation.t, detail))
        return True

    def _succeeded(self) -> NavigationResult:
        """End a run whose tree succeeded: it arrived only if each ball was measured in the ring of the newest goal."""
        run = self.context
        seen = [view.measured for view in run.balls.views]
        rings = [None if ball.lost or not math.isfinite(ball.r) else ball.ring for ball in seen]
        if set(rings) == {run.goal} and run.out is None:
            return self._end(True, "arrived")
        ring = next((ring for ring in rings if ring != run.goal), None)
        where = "nobody knows where" if ring is None else f"in ring {ring}"
        where = where if run.out is None else "out of the maze"
        detail = f"the tree succeeded with the ball {where}, the goal is ring {run.goal}"
        run.failed(Failure(FailureKind.ELSEWHERE, "run", run.now, detail))
        return self._end(False, str(FailureKind.ELSEWHERE))

    def _end(self, success: bool, reason: str, observation: Observation | None = None) -> NavigationResult:
        """Halt the tree and level the plate; returns the result of the run.

        observation: a sample that no tick has used; a last tick logs it, with a level plate"""
        result = self.result(success, reason)
        self._tree.halt()
        if observation is not None:
            began = perf_counter()
            self._see(observation)
            self._send(observation, self._limited(LEVEL), HALTED, began)
        self._rig.level()
        return result

    def tick(self, observation: Observation, given: Command | None = None, by: str = "") -> str:
        """Take in an observation, command the rig and write the log. Returns the tree's status: SUCCESS, FAILURE,
        RUNNING or SKIPPED.

        given: a command that goes out in place of the tree's; the tree is not ticked, and the status is RUNNING
        by: name of what gives this command, for the log

        A sample that is not newer than the last one changes nothing. Raises RigError when the samples have been
        unusable for too long (`SampleCheck`)."""
        admitted = self._admit(observation)
        return "RUNNING" if admitted is None else self._answer(admitted, given, by)

    def _admit(self, observation: Observation) -> Observation | None:
        """The usable part of a sample. None if there is none; the last command then goes out again."""
        admitted = self._sample_check.admit(observation)
        if admitted is None:
            self._rig.command(self.chain.sent.u_beta, self.chain.sent.u_gamma)
        return admitted

    def _answer(self, observation: Observation, given: Command | None = None, by: str = "") -> str:
        began = perf_counter()
        run = self.context
        self._see(observation)
        self._check_fit(observation)
        if given is None:
            status = self._tree.tick().name
            command = self._limited(run.command)
        else:
            status, command, run.leg = "RUNNING", given, run.leg.passage()
            run.steer(by, given)
        self._send(observation, command, status, began, lead=given is None)
        return status

    def _see(self, observation: Observation) -> None:
        first, *others = self._balls.update(observation)
        doubts = self._sample_check.judge(self._balls.doubts, observation.t)
        self.context.begin(observation.t, first.state, first.measured, self._balls.out(observation), tuple(others))
        for doubt in doubts:
            self._report(DoubtRaised(doubt.what))
        self._record.in_ring(self.context, observation.t)

    def _send(self, observation: Observation, command: Command, status: str, began: float, lead: bool = False) -> None:
        """Command the rig and log the tick. lead: compensate the backlash of the servos, if the model has any."""
        passed_on = self.chain.send(command, lead=lead)
        command = self.chain.sent
        self._fit.sent(command, observation.t)
        self._rig.command(command.u_beta, command.u_gamma)
        self._balls.sent(passed_on, observation.t)
        self._record.tick(
            self.context,
            observation,
            command,
            status=status,
            ms=1e3 * (perf_counter() - began),
            cut_off=self._stopwatch.pop_cuts(),
            doubts=" ".join(sorted(self._sample_check.found)) or None,
        )
        self._record.statuses(observation.t, self._tree)
        self._record.openings(observation.t, self._memory)
        self._record.set_tick_duration(1e3 * (perf_counter() - began))

    def _limited(self, wanted: Command | None) -> Command:
        """A command of the tree as it may go out: the balls that are kept stay in the centre."""
        run = self.context
        kept = [run.balls.views[ball - 1].state for ball in sorted(run.balls.kept)]
        return self.chain.limited(wanted, kept, run.state)

    def _report(self, event: RunEvent | Plan) -> None:
        self._record.event(self.context.now, event)

    def result(self, success: bool, reason: str) -> NavigationResult:
        """The result of the run until now."""
        return self._record.result(
            self.context, self._job, success, reason,
            rig=self._setup.rig_name, goals=self._goals, doubts=self._sample_check.doubts, misfits=self._misfits,
        )  # fmt: skip
