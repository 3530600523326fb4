"""One run of a campaign. It builds everything anew: maze, model, rig, tree."""

from __future__ import annotations

import gc
import math
import os
import platform
from dataclasses import dataclass, replace
from itertools import count
from time import perf_counter, process_time
from typing import Any

from mazeplan.core.errors import RigError
from mazeplan.core.records import Failure, FailureKind, NavigationResult, spread
from mazeplan.rigs.faults.schedule import FaultTrial
from mazeplan.rigs.registry import rig_label
from mazeplan.run.campaign.faults import Noticed, Trial
from mazeplan.run.execution import execute
from mazeplan.run.request import Company, NavigationRequest
from mazeplan.run.specification import Job

FIXED_STARTS = 16
START_ORDER = [int(f"{k:04b}"[::-1], 2) for k in range(FIXED_STARTS)]  # of van der Corput: 0, 8, 4, 12, 2, 10, ...
GC_INTERVAL = 16  # runs between two garbage collections
_runs = count(1)


@dataclass(frozen=True)
class Campaign(NavigationRequest):
    """Many runs of one request. All fields are plain names and numbers: a worker process can build everything from
    them. seed: of the first run

    runs: their number
    own_process: whether the watchdog may end the process
    fault: what goes wrong in each run; None: nothing"""

    runs: int = FIXED_STARTS
    own_process: bool = False
    fault: FaultTrial | None = None

    def job_of(self, index: int) -> Job:
        """The job of run number `index`."""
        return replace(self.job, theta=start_angle(index), seed=self.seed + index)


@dataclass(frozen=True)
class Ran:
    """A run that has ended."""

    result: NavigationResult
    noticed: Noticed | None = None  # what came of its fault; None without a fault
    wall_s: float = 0.0
    cpu_s: float = 0.0
    host: str = ""  # computer:process that did it

    def document(self) -> dict[str, Any]:
        """The result as `navigate --json` prints it, with additional keys about the fault."""
        return self.result.json() | ({} if self.noticed is None else self.noticed.document())


def start_angle(index: int) -> float | None:
    """Start angle of run `index`, rad; None: drawn by the run's seed.

    The first FIXED_STARTS are spread evenly over the circle, and so are the first 2, 4 and 8 of them."""
    return math.pi * START_ORDER[index] / 8.0 + math.pi / 16.0 if index < FIXED_STARTS else None


def do_run(campaign: Campaign, index: int) -> Ran:
    """Run number `index` of a campaign, with its times and what came of its fault."""
    began, used, noticed = perf_counter(), process_time(), None
    if campaign.fault is None:
        result = run_one(campaign, index)
    else:
        trial = Trial(campaign.fault, campaign.maze, campaign.seed + index)
        result = run_one(campaign, index, trial.company())
        noticed = trial.noticed(result)
    host = f"{platform.node()}:{os.getpid()}"
    return Ran(result, noticed, perf_counter() - began, process_time() - used, host)


def run_one(campaign: Campaign, index: int, company: Company | None = None, job: Job | None = None) -> NavigationResult:
    """Do run number `index` of a campaign. It builds everything anew, so its result is the same in every process.
    If the rig fails, the result says so. job: in place of the campaign's"""
    job = job or campaign.job_of(index)
    try:
        return execute(campaign, replace(company or Company(), own_process=campaign.own_process), job)
    except RigError as problem:
        failure = Failure(FailureKind.RIG_FAILED, "rig", 0.0, str(problem))
        reason, none, name = str(FailureKind.RIG_FAILED), spread([]), rig_label(str(campaign.rig))
        failed = NavigationResult(False, reason, 0.0, job.seed, name, (), (failure,), 0, none, None, none)
        return problem.result or failed
    finally:
        if next(_runs) % GC_INTERVAL == 0:  # the parts of a run refer to one another; else they would fill about 1 GB
            gc.collect()
