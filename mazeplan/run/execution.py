"""Executes a request, or one job on a rig: opens the log, makes and drives the run, and levels the plate afterwards,
whatever happens. `navigate` is for Python."""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path

from mazeplan.behavior.context import RunContext
from mazeplan.btree.blame import blames_a_node, exception_line
from mazeplan.btree.tree import BehaviorTree
from mazeplan.control.policy import Policy
from mazeplan.core.constants import TIME_LIMIT
from mazeplan.core.errors import LogError, RigError
from mazeplan.core.logs.run_log import RunLogWriter, RunMessages, Sink
from mazeplan.core.progress import Display
from mazeplan.core.records import Failure, FailureKind, NavigationResult
from mazeplan.learning.modelfile import ATTACHED, MEDIA_TYPE, RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.interface import Rig
from mazeplan.run.goals import Goals
from mazeplan.run.loop import Run
from mazeplan.run.request import Company, NavigationRequest
from mazeplan.run.settings import Settings
from mazeplan.run.specification import CRASHED, Job, Setup, log_header, model_to_keep


def navigate(
    start: int | str = 1,
    goal: int | str | None = None,
    *,
    map: str | Path | Maze = "cme",  # the contract's option names
    rig: str | Path | Rig | type = "toy",
    model: str | Path | RigModel | None = None,
    policy: str | Path | Policy | None = None,
    behavior: str = "navigate",
    behavior_modules: Sequence[str] = (),
    effects: str | None = None,
    settings: str | Path | Settings | None = None,
    start_angle_deg: float | None = None,
    closed: Sequence[str] = (),
    via: Sequence[int | str] = (),
    balls: int | None = None,
    seed: int = 0,
    time_limit: float = TIME_LIMIT,
    log: str | Path | None = None,
    display: Display | None = None,
    goals: Goals | None = None,
    own_process: bool = False,
    feed: Sink | None = None,
    around: Callable[[Rig], Rig] | None = None,
    watch: Callable[[BehaviorTree, RunContext], None] | None = None,
) -> NavigationResult:
    """Bring the ball from one ring to another and return what happened.

    start, goal: ring numbers, or "ring1"; goal None: the centre
    rig: a packaged name, a YAML file, "module:Class", a rig, or its class
    model: packaged name, folder or RigModel; None: the rig's own, else one of the rig's name, else nominal physics
    policy: a learned policy, or its folder; the default tree is then `policy`
    behavior: packaged tree or XML file
    behavior_modules: modules with leaves beside the packaged ones
    effects: "module:function" with effects of your own that the model has
    settings: YAML file of costs, gains and windows, or Settings; None: the packaged ones
    start_angle_deg: where the ball is placed in the start ring; None: drawn by the seed
    closed: names of openings that the run does not use
    via: rings to visit before the goal, in this order; the default tree is then `waypoints`
    balls: number of balls, 1 or 2; None: as the map says; with 2 the default tree is `two_balls`
    seed: of start angle and simulated noise
    time_limit: rig time for each goal, from when it was given, s
    display: shows the progress of the run
    goals: gives further goals during the run
    own_process: whether the watchdog may end the process when a leaf hangs and nothing else ends it
    feed: called with topic, rig time and document of each message of a log
    around: wraps the rig, for example to pace it by the wall clock
    watch: called with each tree and its context before it begins

    The tree is checked before anything moves, as `behavior check` does.

    Raises InputError for an argument that cannot be used, RigError when the rig fails.
    """
    request = NavigationRequest(
        start, goal, map, str(rig) if isinstance(rig, Path) else rig, model, policy, behavior, tuple(behavior_modules),
        effects, settings, start_angle_deg, tuple(closed), tuple(via), balls, seed, time_limit, log,
    )  # fmt: skip
    company = Company(display, goals, own_process, feed, around, watch)
    return execute(request, company)


def execute(request: NavigationRequest, company: Company | None = None, job: Job | None = None) -> NavigationResult:
    """Do what a request asks for. job: in place of the request's own

    Raises InputError for a request that cannot be used, RigError when the rig fails."""
    company = company or Company()
    ready = request.resolve(company, job)
    try:
        with company.guard(ready.rig):
            result = run_job(
                ready.rig, ready.setup, ready.job, log=request.log, display=company.display, goals=company.goals,
                feed=company.feed,
            )  # fmt: skip
    except BaseException:
        with suppress(RigError):  # the first error matters
            ready.rig.close()
        raise
    try:
        ready.rig.close()
    except RigError as error:  # the run itself has a result
        error.result = result
        raise
    return result


def run_job(
    rig: Rig, setup: Setup, job: Job, *, log: str | Path | None = None, display: Display | None = None,
    goals: Goals | None = None, feed: Sink | None = None,
) -> NavigationResult:  # fmt: skip
    """Do one job on a rig. Afterwards the plate is level and the log complete, whatever happens.

    goals: requests from other threads
    feed: gets every message of the log, in the thread of the run; the run waits meanwhile

    Raises RigError, with the result, when the rig failed."""
    setup = setup.on(rig)
    ended: list[tuple[NavigationResult, RigError | None]] = []
    with ExitStack() as stack:
        if goals is not None:
            goals.begin(setup.maze)
            stack.callback(goals.end)
        messages = _messages(rig, setup, job, log, feed, stack)
        run = Run(rig, setup, job, messages, display or Display(), requests=goals)
        # a garbage collection of the whole program takes 0.1 s in the middle of a tick: collect only new objects
        gc.freeze()
        stack.callback(gc.unfreeze)
        stack.callback(_level, rig, ended)
        try:
            ended.append((run.drive(), None))
        except RigError as error:
            run.context.failed(Failure(FailureKind.RIG_FAILED, "rig", run.context.now, str(error)))
            ended.append((run.result(False, str(FailureKind.RIG_FAILED)), error))
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                messages.result(run.result(False, "interrupted").json())
            elif isinstance(error, Exception):
                messages.result(_result_after(run, error).json())
            raise
        messages.result(ended[0][0].json())
    result, problem = ended.pop()
    if problem is None:
        return result
    problem.result = result
    try:
        raise problem
    finally:
        del problem  # its traceback refers to this frame: the frame must not refer to it, or both would stay


def _result_after(run: Run, error: Exception) -> NavigationResult:
    if blames_a_node(error):
        failure = Failure(FailureKind.LEAF_FAILED, "tree", run.context.now, exception_line(error))
    elif isinstance(error, LogError):
        failure = Failure(FailureKind.LOG_FAILED, "log", run.context.now, str(error))
    else:
        return run.result(False, CRASHED)
    run.context.failed(failure)
    return run.result(False, str(failure.kind))


def _level(rig: Rig, ended: list[tuple[NavigationResult, RigError | None]]) -> None:
    """Level the plate. If that fails after the run failed, the error names the first cause and holds the result."""
    try:
        rig.level()
    except RigError as error:
        result, cause = ended[-1] if ended else (None, None)
        if cause is not None and str(cause) not in str(error):
            error = RigError(f"{cause}; then {error}")
        error.result = result if result is not None and not result.success else None
        raise error from None


def _messages(
    rig: Rig, setup: Setup, job: Job, log: str | Path | None, feed: Sink | None, stack: ExitStack
) -> RunMessages:
    if log is None and feed is None:
        return RunMessages()
    header = log_header(setup, job, rig.rate_hz)
    sinks: list[Sink] = []
    if log is not None:
        writer = stack.enter_context(RunLogWriter(log, header))
        sinks.append(writer.write)
        if (model := model_to_keep(setup)) is not None:
            writer.attach(ATTACHED, MEDIA_TYPE, model)
    if feed is not None:
        feed("/header", 0.0, header)
        sinks.append(feed)
    return RunMessages(*sinks, path=None if log is None else str(log))
