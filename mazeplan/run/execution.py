"""Executes a request, or one job on a rig: opens the log, makes and drives the run, and levels the plate afterwards,
whatever happens."""

from __future__ import annotations

import gc
from contextlib import ExitStack, suppress
from pathlib import Path

from mazeplan.btree.blame import blames_a_node, exception_line
from mazeplan.core.errors import LogError, RigError
from mazeplan.core.logs.run_log import RunLogWriter, RunMessages, Sink
from mazeplan.core.progress import Display
from mazeplan.core.records import Failure, FailureKind, NavigationResult
from mazeplan.learning.modelfile import ATTACHED, MEDIA_TYPE
from mazeplan.rigs.interface import Rig
from mazeplan.run.goals import Goals
from mazeplan.run.loop import Run
from mazeplan.run.request import Company, NavigationRequest
from mazeplan.run.specification import CRASHED, Job, Setup, log_header, model_to_keep


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
    """The result of a run that an error of the log, of a leaf, or of the program itself ended."""
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
    """Messages of the run, to log and feed."""
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
