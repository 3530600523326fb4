"""One run of a campaign. It builds everything anew: maze, model, rig, tree.

If faults are injected, the run also says whether it noticed them. A fault counts as noticed when the run reports its
first failure or doubt, or ends, at or after the fault's beginning. Only reports of the program count, not the schedule
of faults. Each such run is also checked for what must never happen: a command that is NaN or beyond the tilt limit, an
end without a known reason, a long time without a call of the rig, and a plate that is not level afterwards.
"""

from __future__ import annotations

import gc
import math
import os
import platform
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from itertools import count
from time import monotonic, perf_counter, process_time
from typing import Any

import numpy as np

from mazeplan.behavior.context import RunContext
from mazeplan.btree.tree import BehaviorTree
from mazeplan.core.errors import RigError
from mazeplan.core.field_checks import check_numbers
from mazeplan.core.records import Failure, FailureKind, NavigationResult, spread
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.faults.faulty import FaultyRig
from mazeplan.rigs.faults.schedule import FaultTrial
from mazeplan.rigs.interface import Rig
from mazeplan.rigs.registry import rig_label
from mazeplan.rigs.watchdog import WatchedRig
from mazeplan.run.execution import execute
from mazeplan.run.goals import Goals
from mazeplan.run.request import Company, NavigationRequest
from mazeplan.run.specification import Job

FIXED_STARTS = 16
START_ORDER = [int(f"{k:04b}"[::-1], 2) for k in range(FIXED_STARTS)]  # of van der Corput: 0, 8, 4, 12, 2, 10, ...
GC_INTERVAL = 16  # runs between two garbage collections
AT_ONCE = ("doubt clock", "rig_failed")
NAMED = {"arrived", *map(str, FailureKind)}
BUSY_S = 10.0  # s, limit of a tick in trials of `observe_hangs`: long, because a busy computer is not the fault tried
IDLE_S = 5.0  # s of wall time within which the program must call the rig again
SETTLE_S = 1.0  # s that the plate has to become level
LEVEL_TOLERANCE = 5e-3  # rad, 0.3 deg: a plate counts as level within this, because of noise and backlash
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

    def __post_init__(self) -> None:
        check_numbers(self, positive=("time_limit", "runs"), most={"seed": math.inf, "runs": math.inf})

    def job_of(self, index: int) -> Job:
        """The job of run number `index`."""
        return replace(self.job, theta=start_angle(index), seed=self.seed + index)


@dataclass(frozen=True)
class Noticed:
    """What came of the faults in one run."""

    faults: tuple[dict[str, Any], ...]  # documents of the faults that began
    noticed_s: float | None  # time from the beginning of the first fault until the run noticed it, s; None: never
    noticed_as: str  # name of the report that noticed it; empty: none
    wrong: tuple[str, ...]  # what happened that must never happen, in words

    def document(self) -> dict[str, Any]:
        """The keys that the document of the run has beside those of `navigate`."""
        return {**asdict(self), "faults": list(self.faults), "wrong": list(self.wrong)}

    @classmethod
    def of_document(cls, document: Mapping[str, Any]) -> Noticed | None:
        """Inverse of `document`; None for a run without a fault."""
        if "noticed_as" not in document:
            return None
        faults, wrong = tuple(document["faults"]), tuple(document["wrong"])
        return cls(faults, document["noticed_s"], document["noticed_as"], wrong)


class Trial:
    """The faults of one run. They go between program and rig with `company`."""

    def __init__(self, trial: FaultTrial, maze: Maze, seed: int) -> None:
        self._trial = trial
        self._maze = maze
        self._seed = seed
        self._goals = Goals(maze)
        self._faulty: FaultyRig | None = None

    def company(self) -> Company:
        """What lets the faults act on a run."""
        return Company(goals=self._goals, around=self._around, watch=self._watch)

    def _around(self, rig: Rig) -> Rig:
        self._faulty = _Inspected(rig, self._maze, self._trial.draw(self._seed), self._goals.close)
        hangs = any(kind.name == "observe_hangs" for kind in self._trial.kinds)
        return WatchedRig(self._faulty, BUSY_S) if hangs else self._faulty

    def _watch(self, tree: BehaviorTree, context: RunContext) -> None:
        if self._faulty is not None:
            self._faulty.aimed_at = lambda: None if context.leg.opening is None else context.leg.opening.name

    def noticed(self, result: NavigationResult) -> Noticed:
        """What came of the faults. result: of the run"""
        faulty = self._faulty
        if faulty is None:
            return Noticed((), None, "", ())
        wrong = [f"ended with {result.reason!r}"] if result.reason not in NAMED else []
        wrong += _left_wrong(faulty)
        noticed_s, noticed_as = _noticed(result, faulty)
        return Noticed(tuple(fault.to_json() for fault in faulty.begun), noticed_s, noticed_as, tuple(wrong))


class _Inspected(FaultyRig):
    """A faulty rig that stays open until somebody has looked at its plate."""

    def close(self) -> None:
        self._closed.set()


def _left_wrong(faulty: FaultyRig) -> list[str]:
    wrong = [f"command ({u_beta:.4f}, {u_gamma:.4f}) rad" for u_beta, u_gamma in faulty.beyond[:1]]
    if faulty.idle_s > IDLE_S:
        wrong.append(f"no call of the rig for {faulty.idle_s:.1f} s")
    if not faulty.levelled:
        wrong.append("the plate was not levelled")
    elif (tilt := faulty.tilt_after(SETTLE_S)) > LEVEL_TOLERANCE:
        wrong.append(f"the plate was left at {np.degrees(tilt):.2f} deg")
    with suppress(RigError):
        faulty.inside.close()
    return wrong


def _noticed(result: NavigationResult, faulty: FaultyRig) -> tuple[float | None, str]:
    """Delay, s, and name of the first report after the first fault began; (None, "") if there is none.

    Times are those of the rig inside the faulty one, or of the wall clock if a call hung."""
    if not faulty.begun:
        return None, ""
    began = min(fault.at_s for fault in faulty.begun)
    if faulty.hangs_since is not None:
        return round(monotonic() - faulty.hangs_since, 4), result.reason
    reports = [(faulty.true_time(failure.t), str(failure.kind)) for failure in result.failures]
    reports += [(faulty.true_time(doubt.t), f"doubt {doubt.what}") for doubt in result.doubts]
    # a report about a sample that was not used has the time of the sample before it
    before = began - 1.5 / faulty.rate_hz
    late = [(max(0.0, t - began), what) for t, what in reports if t >= (before if what in AT_ONCE else began - 1e-6)]
    return min(late, default=(None, ""))


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
        reason, none, name = str(FailureKind.RIG_FAILED), spread([]), rig_label(campaign.rig)
        failed = NavigationResult(False, reason, 0.0, job.seed, name, (), (failure,), 0, none, None, none)
        return problem.result or failed
    finally:
        if next(_runs) % GC_INTERVAL == 0:  # the parts of a run refer to one another; else they would fill about 1 GB
            gc.collect()
