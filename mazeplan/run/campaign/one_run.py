"""One run of a campaign. It builds everything anew: maze, model, rig, tree."""

from __future__ import annotations

import gc
import math
import os
import platform
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import count
from time import perf_counter, process_time
from typing import TypeVar

from mazeplan.control.policy_file import load_policy
from mazeplan.core.errors import RigError
from mazeplan.core.logs.run_log import Sink
from mazeplan.core.maths.spread import spread
from mazeplan.core.records import Failure, FailureKind, NavigationResult
from mazeplan.learning.modelfile import RigModel, model_stamp
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.registry import own_effects
from mazeplan.rigs.interface import Rig
from mazeplan.rigs.registry import make_rig, rig_label
from mazeplan.rigs.watchdog import watched
from mazeplan.run.balls import check_balls, tree_of, with_balls
from mazeplan.run.execution import attempt_job
from mazeplan.run.resolve import model_from, model_source, ring_number
from mazeplan.run.settings import load_settings
from mazeplan.run.specification import TIME_LIMIT, Job, Setup

FIXED_STARTS = 16
START_ORDER = [int(f"{k:04b}"[::-1], 2) for k in range(FIXED_STARTS)]  # of van der Corput: 0, 8, 4, 12, 2, 10, ...
GC_INTERVAL = 16  # runs between two garbage collections
NO_DEADLINE = {"travel": {"deadline_ms": 1e6}}
_runs = count(1)
Result = TypeVar("Result")


@dataclass(frozen=True)
class Campaign:
    """What to evaluate. All fields are plain names and numbers: a worker process can build everything from them."""

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
    own_process: bool = False  # whether the watchdog may end the process
    deadline: bool = True  # whether a deadline on the wall clock limits the planner
    effects: str | None = None  # module:function of the user's effects that the model has
    policy: str | None = None  # folder of a learned policy
    balls: int | None = None  # number of balls; None: as the map says

    def maze(self) -> Maze:
        """The map with the balls of the campaign. Raises InputError."""
        return with_balls(load_map(self.map), self.balls)


@dataclass(frozen=True)
class Ran:
    """A run that has ended. host: computer:process that did it."""

    result: NavigationResult
    wall_s: float = 0.0
    cpu_s: float = 0.0
    host: str = ""


def start_angle(index: int) -> float | None:
    """Start angle of run `index`, rad; None: drawn by the run's seed.

    The first FIXED_STARTS are spread evenly over the circle, and so are the first 2, 4 and 8 of them."""
    return math.pi * START_ORDER[index] / 8.0 + math.pi / 16.0 if index < FIXED_STARTS else None


def job_of(campaign: Campaign, index: int, maze: Maze) -> Job:
    """The job of run number `index`."""
    return Job(
        ring_number(campaign.start, maze),
        len(maze.rings) if campaign.goal is None else ring_number(campaign.goal, maze),
        start_angle(index),
        campaign.seed + index,
        campaign.time_limit,
    )


def setup_of(campaign: Campaign, maze: Maze) -> Setup:
    """The setup of all runs of a campaign."""
    own_effects(campaign.effects)
    source = model_source(campaign.model, campaign.rig)
    model = RigModel.nominal(maze) if source is None else _model(source, maze, model_stamp(source))
    how, modules = load_settings(campaign.settings), campaign.behavior_modules
    if not campaign.deadline:
        how = how.with_values(NO_DEADLINE)
    return Setup(
        maze,
        model,
        tree_of(maze, campaign.behavior),
        rig_label(campaign.rig),
        settings=how,
        behavior_modules=modules,
        effects=campaign.effects,
        policy=None if campaign.policy is None else load_policy(campaign.policy),
    )


@lru_cache(maxsize=4)
def _model(source: str, maze: Maze, stamp: object) -> RigModel:
    """The model, read once for all runs of a process. stamp: changes when the model's files change."""
    return model_from(source, maze)


def run_one(
    campaign: Campaign, index: int, model: RigModel | None = None, feed: Sink | None = None
) -> NavigationResult:
    """Do run number `index` of a campaign. It builds everything anew, so its result is the same in every process.
    If the rig fails, the result says so.

    model: replaces the model of the campaign
    feed: gets the messages that a log would get
    """
    maze = campaign.maze()
    job, setup = job_of(campaign, index, maze), setup_of(campaign, maze)
    setup = setup if model is None else replace(setup, model=model)
    rig = watched(rig_of_run(campaign, index, maze), own_process=campaign.own_process)
    try:
        return attempt_job(rig, setup, job, feed=feed)[0]
    except RigError as problem:  # the plate could not even be levelled
        return rig_failed(problem, job, setup.rig_name)
    finally:
        with suppress(RigError):  # the first error matters
            rig.close()
        collect_garbage()


def measured(do: Callable[[], Result]) -> tuple[Result, float, float, str]:
    """The result of `do`, the wall time and processor time that it took, s, and computer:process."""
    began, used = perf_counter(), process_time()
    result = do()
    return result, perf_counter() - began, process_time() - used, f"{platform.node()}:{os.getpid()}"


def collect_garbage() -> None:
    """Collect all garbage, once every COLLECT runs of this process. The parts of a run refer to one another; without
    this call they would be freed only after they fill about 1 GB."""
    if next(_runs) % GC_INTERVAL == 0:
        gc.collect()


def rig_of_run(campaign: Campaign, index: int, maze: Maze) -> Rig:
    """The rig for run `index`."""
    rig = make_rig(campaign.rig, maze)
    check_balls(maze, rig, job_of(campaign, index, maze), campaign.policy is not None)
    return rig


def rig_failed(problem: RigError, job: Job, rig_name: str) -> NavigationResult:
    """The result of a run of which only the rig's failure is known."""
    failure = Failure(FailureKind.RIG_FAILED, "rig", 0.0, str(problem))
    reason, none = str(FailureKind.RIG_FAILED), spread([])
    return NavigationResult(False, reason, 0.0, job.seed, rig_name, (), (failure,), 0, none, None, none)
