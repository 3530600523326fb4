"""One job from its beginning to its end: the log opened, the run made and driven, the plate level afterwards, whatever
happens."""

from __future__ import annotations

import gc
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from mazeplan.data.runlog import Feed, RunDocuments, RunLogWriter, Take, told_to
from mazeplan.display import Display, NullDisplay
from mazeplan.errors import RigError
from mazeplan.goals import Goals
from mazeplan.job import Job, Setup, log_header, model_to_keep
from mazeplan.models.packedmodel import ATTACHED, MEDIA_TYPE
from mazeplan.records import NavigationResult
from mazeplan.rigs.interface import Rig
from mazeplan.run import Run


def run_job(
    rig: Rig, setup: Setup, job: Job, *, log: str | Path | None = None, display: Display | None = None,
    goals: Goals | None = None, feed: Take | None = None,
) -> NavigationResult:  # fmt: skip
    """Do one job on a rig. The plate is level and the log complete afterwards, whatever happens. Raises RigError when
    the rig failed.

    goals: where other goals come from meanwhile; feed: gets what goes into a log, too, in the thread of the run, which
    waits for it."""
    result, problem = attempt_job(rig, setup, job, log=log, display=display, goals=goals, feed=feed)
    if problem is not None:
        problem.result = result
        raise problem
    return result


def attempt_job(
    rig: Rig, setup: Setup, job: Job, *, log: str | Path | None = None, display: Display | None = None,
    goals: Goals | None = None, prepare: Callable[[Run], None] | None = None, feed: Take | None = None,
) -> tuple[NavigationResult, RigError | None]:  # fmt: skip
    """As `run_job`, but a rig that fails is a result, too, and what it raised; `prepare` gets the run beforehand."""
    setup = setup.on(rig)
    with ExitStack() as stack:
        if goals is not None:
            goals.begin(setup.maze)
            stack.callback(goals.end)
        writer = _told_to(rig, setup, job, log, feed, stack)
        run = Run(rig, setup, job, writer, display or NullDisplay(), outside=goals)
        # the collector looks at what the run itself makes: at all of the program it takes .1 s, in the midst of a tick
        gc.freeze()
        stack.callback(gc.unfreeze)
        told: list[tuple[NavigationResult, RigError | None]] = []
        stack.callback(_level, rig, told)
        if prepare is not None:
            prepare(run)
        problem, path = None, None if log is None else str(log)
        try:
            result = run.drive(path)
        except RigError as error:
            problem, result = error, run.broken(error, path)
        except KeyboardInterrupt:
            if writer is not None:
                writer.result(run.result(False, "interrupted", str(log)).to_json())
            raise
        except Exception as error:
            if writer is not None:
                writer.result(run.broke_off(error, path).to_json())
            raise
        if writer is not None:
            writer.result(result.to_json())
        told.append((result, problem))
        return result, problem


def _level(rig: Rig, told: list[tuple[NavigationResult, RigError | None]]) -> None:
    """Level the plate; where not even that goes, what had happened until then is not lost with it: the cause is said
    first."""
    try:
        rig.level()
    except RigError as error:
        result, cause = told[-1] if told else (None, None)
        if cause is not None and str(cause) not in str(error):
            error = RigError(f"{cause}; then {error}")
        error.result = result if result is not None and not result.success else None
        raise error from None


def _told_to(
    rig: Rig, setup: Setup, job: Job, log: str | Path | None, feed: Take | None, stack: ExitStack
) -> RunDocuments | None:
    """Who is told of the run."""
    if log is None and feed is None:
        return None
    header = log_header(setup, job, rig.rate_hz)
    writer = None if log is None else stack.enter_context(RunLogWriter(log, header))
    if writer is not None and (model := model_to_keep(setup)) is not None:
        writer.attach(ATTACHED, MEDIA_TYPE, model)
    return told_to(writer, None if feed is None else Feed(feed, header))
