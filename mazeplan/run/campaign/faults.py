"""Many navigations with injected faults: for each fault, whether the run noticed it and recovered.

A fault counts as noticed when the run reports its first failure or doubt, or ends, at or after the fault's beginning.
Only reports of the program count, not the schedule of faults. Each run is also checked for what must never happen: a
command that is NaN or beyond the tilt limit, an end without a known reason, a long time without a call of the rig, and
a plate that is not level afterwards.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from time import monotonic
from typing import Any

import numpy as np

from mazeplan.core.errors import RigError
from mazeplan.core.records import FailureKind, NavigationResult
from mazeplan.rigs.faults.faulty import DriverHooks, FaultyRig
from mazeplan.rigs.faults.schedule import Drawn, FaultTrial
from mazeplan.rigs.interface import Rig
from mazeplan.rigs.watchdog import WatchedRig, watched
from mazeplan.run.campaign.evaluate import Campaign, check, job_of, rig_failed, setup_of
from mazeplan.run.campaign.executor import Executor, open_executor
from mazeplan.run.campaign.one_run import Ran, collect_garbage, measured, rig_of_run
from mazeplan.run.campaign.store import Store
from mazeplan.run.execution import attempt_job
from mazeplan.run.goals import Goals
from mazeplan.run.loop import Run

AT_ONCE = ("doubt clock", "rig_failed")
NAMED = {"arrived", *map(str, FailureKind)}
BUSY_S = 10.0  # s, limit of a tick in trials of `observe_hangs`: long, because a busy computer is not the fault tried
IDLE_S = 5.0  # s of wall time within which the program must call the rig again
SETTLE_S = 1.0  # s that the plate has to become level
LEVEL_TOLERANCE = 5e-3  # rad, 0.3 deg: a plate counts as level within this, because of noise and backlash


@dataclass(frozen=True)
class Outcome:
    """One run with faults.

    faults: the faults that began
    noticed_s: time from the beginning of the first fault until the run noticed it, s; None: never
    noticed_as: name of the report that noticed it; empty: none
    wrong: what happened that must never happen, in words
    """

    result: NavigationResult
    faults: tuple[Drawn, ...]
    noticed_s: float | None
    noticed_as: str
    wrong: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """The document of `navigate` with additional keys about the faults."""
        return {
            **self.result.json(),
            "faults": [fault.to_json() for fault in self.faults],
            "noticed_s": self.noticed_s,
            "noticed_as": self.noticed_as,
            "wrong": list(self.wrong),
        }

    @classmethod
    def from_json(cls, document: Mapping[str, Any], trial: FaultTrial) -> Outcome:
        """Inverse of `to_json`, for a run of this trial."""
        plain = dict(document)
        begun, noticed_s, noticed_as, wrong = (plain.pop(key) for key in ("faults", "noticed_s", "noticed_as", "wrong"))
        result = NavigationResult.from_json(plain)
        faults = tuple(drawn for drawn in trial.draw(result.seed) if drawn.to_json() in begun)
        return cls(result, faults, noticed_s, noticed_as, tuple(wrong))


@dataclass(frozen=True)
class Tried:
    """An outcome, and the run with its times."""

    outcome: Outcome
    ran: Ran


def run_trial(campaign: Campaign, trial: FaultTrial, index: int) -> Outcome:
    """Run number `index` of a trial. It builds everything anew, so the outcome is the same in every process."""
    maze = campaign.maze()
    job, setup = job_of(campaign, index, maze), setup_of(campaign, maze)
    goals = Goals(maze)
    orders = DriverHooks(close=goals.close)
    faulty = FaultyRig(rig_of_run(campaign, index, maze), maze, trial.draw(job.seed), orders)
    if any(kind.name == "observe_hangs" for kind in trial.kinds):
        rig: Rig = WatchedRig(faulty, BUSY_S)
    else:
        rig = watched(faulty, own_process=campaign.own_process)

    def prepare(run: Run) -> None:
        orders.aimed_at = lambda: None if run.context.leg.opening is None else run.context.leg.opening.name

    try:
        try:
            result = attempt_job(rig, setup, job, goals=goals, prepare=prepare)[0]
        except RigError as problem:
            result = rig_failed(problem, job, setup.rig_name)
        noticed_s, noticed_as = _noticed(result, faulty)
        return Outcome(result, tuple(faulty.begun), noticed_s, noticed_as, _wrong(result, faulty))
    finally:
        with suppress(RigError):
            rig.close()
        collect_garbage()


def do_trial(campaign: Campaign, trial: FaultTrial, index: int) -> Tried:
    """As `run_trial`, with the times of the run."""
    outcome, wall_s, cpu_s, host = measured(lambda: run_trial(campaign, trial, index))
    return Tried(outcome, Ran(outcome.result, wall_s, cpu_s, host))


def _wrong(result: NavigationResult, faulty: FaultyRig) -> tuple[str, ...]:
    wrong = [f"command ({u_beta:.4f}, {u_gamma:.4f}) rad" for u_beta, u_gamma in faulty.beyond[:1]]
    if result.reason not in NAMED:
        wrong.append(f"ended with {result.reason!r}")
    if faulty.idle_s > IDLE_S:
        wrong.append(f"no call of the rig for {faulty.idle_s:.1f} s")
    if not faulty.levelled:
        wrong.append("the plate was not levelled")
    elif (tilt := faulty.tilt_after(SETTLE_S)) > LEVEL_TOLERANCE:
        wrong.append(f"the plate was left at {np.degrees(tilt):.2f} deg")
    return tuple(wrong)


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


def evaluate_faults(
    campaign: Campaign,
    trials: Sequence[FaultTrial],
    *,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
    executor: Executor | None = None,
    stores: Sequence[Store] = (),
) -> list[list[Outcome]]:
    """All outcomes of `campaign.runs` runs of each trial, in their order.

    progress: is called with the number of finished runs after each run
    stores: one for each trial, or none
    workers, executor: as of `evaluate.evaluate`
    """
    if executor is None:
        with open_executor(workers) as own:
            return evaluate_faults(campaign, trials, progress=progress, executor=own, stores=stores)
    every = [(t, k) for t in range(len(trials)) for k in range(campaign.runs)]
    done = {
        (t, k): Outcome.from_json(store.documents[k], trials[t])
        for t, store in enumerate(stores)
        for k in range(campaign.runs)
        if k in store.documents
    }
    missing = [place for place in every if place not in done]
    if missing and executor.apart:
        check(campaign)
    campaign = replace(campaign, own_process=campaign.own_process or executor.apart)
    for number, tried in executor.each(do_trial, [(campaign, trials[t], k) for t, k in missing]):
        t, k = missing[number]
        done[t, k] = tried.outcome
        if stores:
            stores[t].keep(k, tried.ran, tried.outcome.to_json())
        if progress is not None:
            progress(len(done))
    return [[done[t, k] for k in range(campaign.runs)] for t in range(len(trials))]


def report(trial: FaultTrial, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The results of a trial: its row of the table, as `evaluate --faults --json` prints it.

    faulted: number of runs in which a fault began before the end
    noticed: number of these runs that noticed the fault
    time_s: mean time of the runs that arrived, s
    as_expected: number of runs that arrived; if the fault cannot be survived, also those that ended for its reasons
    """
    because = "; ".join(dict.fromkeys(kind.because for kind in trial.kinds if kind.because))
    ends = {end for kind in trial.kinds for end in kind.ends if kind.because or not because}
    faulted = [outcome for outcome in outcomes if outcome.faults]
    noticed = [outcome.noticed_s for outcome in faulted if outcome.noticed_s is not None]
    times = [outcome.result.time_s for outcome in outcomes if outcome.result.success]
    arrived = len(times)
    stopped = Counter(outcome.result.reason for outcome in outcomes if not outcome.result.success)
    expected = arrived if not because else arrived + sum(count for end, count in stopped.items() if end in ends)
    recoveries = {
        failure.recovery
        for outcome in faulted
        for failure in outcome.result.failures
        if failure.recovery is not None and failure.t >= min(fault.at_s for fault in outcome.faults) - 1e-6
    }
    return {
        "fault": trial.name,
        "kinds": [kind.name for kind in trial.kinds],
        "survivable": not because,
        "because": because or None,
        "runs": len(outcomes),
        "faulted": len(faulted),
        "noticed": len(noticed),
        "noticed_s": {"p50": _rounded(np.median(noticed)), "worst": _rounded(max(noticed))} if noticed else None,
        "noticed_as": dict(Counter(outcome.noticed_as for outcome in faulted if outcome.noticed_as).most_common()),
        "recoveries": sorted(recoveries),
        "arrived": arrived,
        "time_s": _rounded(np.mean(times)) if times else None,
        "stopped": dict(stopped.most_common()),
        "as_expected": expected,
        "wrong": [f"seed {outcome.result.seed}: {what}" for outcome in outcomes for what in outcome.wrong],
    }


def _rounded(value: Any) -> float:
    return round(float(value), 3)


def good(rows: Sequence[dict[str, Any]]) -> bool:
    """Whether every run ended as expected and nothing happened that must never happen."""
    return all(row["as_expected"] == row["runs"] and not row["wrong"] for row in rows)
