"""Many navigations: success, times, failures by kind.

Start angles: the first 16 are theta = pi k / 8 + pi / 16 (facts of the published evaluation), further ones are
drawn by the run's
seed. Each run has a seed of its own, so that the results are the same for any number of workers.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing import get_context
from typing import Any, TypeVar

import numpy as np

from mazeplan.attempt import attempt_job
from mazeplan.choices import resolve_model, ring_number
from mazeplan.errors import RigError
from mazeplan.job import TIME_LIMIT, Job, Setup, log_header
from mazeplan.maths.spread import spread
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map
from mazeplan.records import Failure, FailureKind, NavigationResult
from mazeplan.rigs.registry import make_rig, rig_label
from mazeplan.rigs.watchdog import watched
from mazeplan.settings import load_settings

FIXED_STARTS = 16
Result = TypeVar("Result")


@dataclass(frozen=True)
class Campaign:
    """What to evaluate; plain names, so that a worker process can build everything itself."""

    runs: int
    rig: str = "toy"
    map: str = "cme"
    model: str | None = None
    behavior: str = "navigate"
    start: int | str = 1
    goal: int | str | None = None  # None: the centre
    seed: int = 0
    time_limit: float = TIME_LIMIT
    settings: str | None = None
    behavior_modules: tuple[str, ...] = ()
    own_process: bool = False  # whether the watchdog may end it
    sense: str | None = None  # how a simulated rig sees the ball


def start_angle(index: int) -> float | None:
    """Start angle of run `index`, rad; None: drawn by the run's seed."""
    return math.pi * index / 8.0 + math.pi / 16.0 if index < FIXED_STARTS else None


def job_of(campaign: Campaign, index: int, maze: Maze) -> Job:
    """Run number `index` of a campaign."""
    return Job(
        ring_number(campaign.start, maze),
        len(maze.rings) if campaign.goal is None else ring_number(campaign.goal, maze),
        start_angle(index),
        campaign.seed + index,
        campaign.time_limit,
    )


def setup_of(campaign: Campaign, maze: Maze) -> Setup:
    """With what its runs are done."""
    model = resolve_model(campaign.model, campaign.rig, maze)
    how, modules = load_settings(campaign.settings), campaign.behavior_modules
    return Setup(maze, model, campaign.behavior, rig_label(campaign.rig), settings=how, behavior_modules=modules)


def run_one(campaign: Campaign, index: int) -> NavigationResult:
    """Run number `index` of a campaign, from nothing: the same wherever it is done. A rig that fails is a result."""
    maze = load_map(campaign.map)
    job, setup = job_of(campaign, index, maze), setup_of(campaign, maze)
    rig = watched(make_rig(campaign.rig, maze, campaign.sense), own_process=campaign.own_process)
    try:
        return attempt_job(rig, setup, job)[0]
    except RigError as problem:  # it did not even become level
        return rig_failed(problem, job, setup.rig_name)
    finally:
        with suppress(RigError):  # what matters has been said
            rig.close()


def rig_failed(problem: RigError, job: Job, rig_name: str) -> NavigationResult:
    """The result of a run of which the rig let nothing be known but that it failed."""
    failure = Failure(FailureKind.RIG_FAILED, "rig", 0.0, str(problem))
    reason, none = str(FailureKind.RIG_FAILED), spread([])
    return NavigationResult(False, reason, 0.0, job.seed, rig_name, (), (failure,), 0, none, None, none)


def results(campaign: Campaign, workers: int = 1) -> Iterator[tuple[int, NavigationResult]]:
    """(index, result) of all runs as they end, in this process or in `workers` processes."""
    if workers > 1:
        campaign = replace(campaign, own_process=True)
    yield from each(run_one, [(campaign, index) for index in range(campaign.runs)], workers)


def each(work: Callable[..., Result], tasks: Sequence[tuple[Any, ...]], workers: int) -> Iterator[tuple[int, Result]]:
    """(index, work(*task)) of all tasks as they end, in this process or in `workers` processes."""
    if workers <= 1:
        for index, task in enumerate(tasks):
            yield index, work(*task)
        return
    # spawn: a forked child would inherit locks of threads that do not exist in it
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        futures = {pool.submit(work, *task): index for index, task in enumerate(tasks)}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BrokenProcessPool:
            raise RigError("a worker process ended in the middle of a run; what it said is above") from None
        finally:
            for future in futures:
                future.cancel()


def evaluate(
    campaign: Campaign, *, workers: int = 1, progress: Callable[[int], None] | None = None
) -> list[NavigationResult]:
    """All results of a campaign in the order of their runs; `progress(finished)` is called after each."""
    done: dict[int, NavigationResult] = {}
    for index, result in results(campaign, workers):
        done[index] = result
        if progress is not None:
            progress(len(done))
    return [done[index] for index in range(campaign.runs)]


def summary(outcomes: list[NavigationResult]) -> dict[str, Any]:
    """The document that `evaluate --json` prints. Times are of the runs that arrived; null when none did."""
    times = np.array([outcome.time_s for outcome in outcomes if outcome.success])
    failures = Counter(str(failure.kind) for outcome in outcomes for failure in outcome.failures)
    if times.size:
        p50, p95 = np.percentile(times, [50.0, 95.0])
        figures = {"mean": times.mean(), "best": times.min(), "p50": p50, "p95": p95, "worst": times.max()}
        time_s: dict[str, float | None] = {key: round(float(value), 4) for key, value in figures.items()}
    else:
        time_s = dict.fromkeys(("mean", "best", "p50", "p95", "worst"))
    return {
        "runs": len(outcomes),
        "success": sum(outcome.success for outcome in outcomes),
        "time_s": time_s,
        "failures": dict(sorted(failures.items())),
        "planner_ms": worst(outcomes, "planner_ms"),
        "tick_ms": worst(outcomes, "tick_ms"),
        "results": [outcome.to_json() for outcome in outcomes],
    }


def setup_document(campaign: Campaign) -> dict[str, Any]:
    """With what a campaign is done, for who reads its document: program, rig, map (its text) and the rest by name."""
    maze = load_map(campaign.map)
    job, setup = job_of(campaign, 0, maze), setup_of(campaign, maze)
    header = log_header(setup, job, 0.0)
    names = ("program", "version", "rig", "map", "map_name", "model", "behavior", "start_ring", "goal_ring", "seed")
    return {name: header[name] for name in (*names, "time_limit_s")}


def worst(outcomes: list[NavigationResult], which: str) -> dict[str, float]:
    """Median of the runs' medians; worst p99 and worst maximum over the runs."""
    spreads = [getattr(outcome, which) for outcome in outcomes]
    if not spreads:
        return spread([])
    return {
        "p50": round(float(np.median([s["p50"] for s in spreads])), 4),
        "p99": max(s["p99"] for s in spreads),
        "max": max(s["max"] for s in spreads),
    }
