"""A run with injected faults: whether the run noticed them, and whether it recovered.

A fault counts as noticed when the run reports its first failure or doubt, or ends, at or after the fault's beginning.
Only reports of the program count, not the schedule of faults. Each run is also checked for what must never happen: a
command that is NaN or beyond the tilt limit, an end without a known reason, a long time without a call of the rig, and
a plate that is not level afterwards.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from time import monotonic
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.behavior.context import RunContext
from mazeplan.btree.tree import BehaviorTree
from mazeplan.core.errors import RigError
from mazeplan.core.records import FailureKind, NavigationResult
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.faults.faulty import DriverHooks, FaultyRig
from mazeplan.rigs.faults.schedule import FaultTrial
from mazeplan.rigs.interface import Rig
from mazeplan.rigs.watchdog import WatchedRig
from mazeplan.run.goals import Goals
from mazeplan.run.request import Company

if TYPE_CHECKING:
    from mazeplan.run.campaign.one_run import Ran

AT_ONCE = ("doubt clock", "rig_failed")
NAMED = {"arrived", *map(str, FailureKind)}
BUSY_S = 10.0  # s, limit of a tick in trials of `observe_hangs`: long, because a busy computer is not the fault tried
IDLE_S = 5.0  # s of wall time within which the program must call the rig again
SETTLE_S = 1.0  # s that the plate has to become level
ROUNDED = 1e-4  # s; times of faults have four digits
LEVEL_TOLERANCE = 5e-3  # rad, 0.3 deg: a plate counts as level within this, because of noise and backlash


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
        self._trial, self._maze, self._seed = trial, maze, seed
        self._goals = Goals(maze)
        self._orders = DriverHooks(close=self._goals.close)
        self._faulty: FaultyRig | None = None

    def company(self) -> Company:
        """What lets the faults act on a run."""
        return Company(goals=self._goals, around=self._around, watch=self._watch)

    def _around(self, rig: Rig) -> Rig:
        self._faulty = _Inspected(rig, self._maze, self._trial.draw(self._seed), self._orders)
        hangs = any(kind.name == "observe_hangs" for kind in self._trial.kinds)
        return WatchedRig(self._faulty, BUSY_S) if hangs else self._faulty

    def _watch(self, tree: BehaviorTree, context: RunContext) -> None:
        self._orders.aimed_at = lambda: None if context.leg.opening is None else context.leg.opening.name

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


def report(trial: FaultTrial, runs: Sequence[Ran]) -> dict[str, Any]:
    """The results of a trial: its row of the table, as `evaluate --faults --json` prints it.

    faulted: number of runs in which a fault began before the end
    noticed: number of these runs that noticed the fault
    time_s: mean time of the runs that arrived, s
    as_expected: number of runs that arrived; if the fault cannot be survived, also those that ended for its reasons
    """
    because = "; ".join(dict.fromkeys(kind.because for kind in trial.kinds if kind.because))
    ends = {end for kind in trial.kinds for end in kind.ends if kind.because or not because}
    faulted = [(run.result, run.noticed) for run in runs if run.noticed is not None and run.noticed.faults]
    noticed = [found.noticed_s for _, found in faulted if found.noticed_s is not None]
    times = [run.result.time_s for run in runs if run.result.success]
    stopped = Counter(run.result.reason for run in runs if not run.result.success)
    expected = len(times) + sum(count for end, count in stopped.items() if because and end in ends)
    recoveries = {
        failure.recovery
        for result, found in faulted
        for failure in result.failures
        if failure.recovery is not None and failure.t >= min(fault["at_s"] for fault in found.faults) - ROUNDED
    }
    return {
        "fault": trial.name,
        "kinds": [kind.name for kind in trial.kinds],
        "survivable": not because,
        "because": because or None,
        "runs": len(runs),
        "faulted": len(faulted),
        "noticed": len(noticed),
        "noticed_s": {"p50": _rounded(np.median(noticed)), "worst": _rounded(max(noticed))} if noticed else None,
        "noticed_as": dict(Counter(found.noticed_as for _, found in faulted if found.noticed_as).most_common()),
        "recoveries": sorted(recoveries),
        "arrived": len(times),
        "time_s": _rounded(np.mean(times)) if times else None,
        "stopped": dict(stopped.most_common()),
        "as_expected": expected,
        "wrong": [f"seed {r.result.seed}: {what}" for r in runs if r.noticed is not None for what in r.noticed.wrong],
    }


def _rounded(value: Any) -> float:
    return round(float(value), 3)


def good(rows: Sequence[dict[str, Any]]) -> bool:
    """Whether every run ended as expected and nothing happened that must never happen."""
    return all(row["as_expected"] == row["runs"] and not row["wrong"] for row in rows)
