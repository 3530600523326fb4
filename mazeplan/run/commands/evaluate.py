"""`evaluate`: many runs, in processes or on Dask, kept in a store, with or without faults.

Start angles: the first 16 are theta = pi k / 8 + pi / 16, as in the published evaluation; further ones are drawn by the
run's seed. Each run has its own seed, so the results are the same for any number of workers on any machines.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from operator import itemgetter
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mazeplan.core.constants import TIME_LIMIT
from mazeplan.core.errors import RigError
from mazeplan.core.progress import Advance, Display, Words, no_advance, no_words, of_total
from mazeplan.core.records import NavigationResult, spread
from mazeplan.core.results import DocumentResult
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.faults.schedule import FaultTrial, every_kind, load_schedule
from mazeplan.rigs.interface import Rig
from mazeplan.rigs.registry import is_simulated, kept_open
from mazeplan.run.campaign.executor import Executor, open_executor
from mazeplan.run.campaign.one_run import Campaign, Ran, do_run
from mazeplan.run.campaign.pairs import PairedRuns, paired
from mazeplan.run.campaign.store import Store, campaign_files, open_stores, read_runs, result_of
from mazeplan.run.loop import Run
from mazeplan.run.specification import log_header

RUNS, FAULT_RUNS = 16, 10
ROUNDED = 1e-4  # s; times of faults have four digits


@dataclass(frozen=True)
class Evaluation(DocumentResult):
    """Many navigations: the document of `evaluate --json`, and each result."""

    kind: ClassVar[str] = "evaluation"

    results: tuple[NavigationResult, ...] = field(repr=False)

    def compare(self, other: Evaluation) -> PairedRuns:
        """How the other evaluation differs from this one, seed by seed (`evaluate --compare`)."""
        return paired(self.document, other.document)


def evaluate(
    runs: int | None = None, *, rig: str | Path | Rig | type = "toy", map: str | Path | Maze = "cme",
    model: str | Path | RigModel | None = None, effects: str | None = None, policy: str | Path | None = None,
    behavior: str = "navigate", behavior_modules: Sequence[str] = (), settings: str | Path | None = None,
    start: int | str = 1, goal: int | str | None = None, balls: int | None = None, seed: int = 0,
    time_limit: float = TIME_LIMIT, workers: int | None = None, dask: str | None = None,
    store: str | Path | None = None, deadline: bool = True, faults: str | Path | None = None,
    own_process: bool = False, say: Words = no_words, advance: Advance = no_advance,
) -> Evaluation:  # fmt: skip
    """Run many navigations and summarise success, times and failures; with `faults` also the response to each fault.

    rig, map, model, effects, policy, behavior, behavior_modules, settings, balls: as of `mazeplan.navigate`;
        a rig that is an object does all runs in this process
    runs: number of runs; None: 16, or 10 for each fault
    seed: of the first run; the first 16 start angles go round the circle
    workers: number of processes; None: the cores for a simulated rig, else 1; dask: address of a scheduler
    store: folder that keeps each run; kept runs are not done again
    deadline: whether plans have a limit of time; without it, results are repeatable
    faults: file of faults to inject, or "all"

    Raises InputError, RigError."""
    with ExitStack() as stack:
        alone = (workers or 1) == 1 and dask is None and store is None
        rig = stack.enter_context(kept_open(rig, alone=alone))
        usual = FAULT_RUNS if faults else RUNS
        campaign = Campaign(
            start, goal, map, rig, model, policy, behavior, tuple(behavior_modules), effects, settings, balls=balls,
            seed=seed, time_limit=time_limit, deadline=deadline, runs=usual if runs is None else runs,
            own_process=own_process,
        )  # fmt: skip
        trials = () if faults is None else every_kind() if faults == "all" else load_schedule(faults)
        campaigns = [replace(campaign, fault=trial) for trial in trials] or [campaign]
        stores = () if store is None else stack.enter_context(open_stores(Path(store), campaigns))
        count, kept = campaign.runs * len(campaigns), _kept(stores, campaign.runs)
        if kept:
            say(f"{kept} of {count} runs are in {store} already")
        how: dict[str, Any] = {"workers": workers, "dask": dask, "copies": is_simulated(rig), "say": say}
        try:
            opened = open_executor(**how) if kept < count else open_executor()
            with opened as executor:
                advance(kept, count)
                ran = run_all(campaigns, executor, progress=of_total(advance, count), stores=stores)
        except (KeyboardInterrupt, RigError):
            if store is None:
                say("no run is kept; use --store DIR to keep runs and to continue with the same command")
            else:
                done = f"{_kept(stores, campaign.runs)} of {count} runs are kept in {store}"
                say(f"{done}; the same command continues with the others")
            raise
        flat = [run for of_one in ran for run in of_one]
        document = summary([run.result for run in flat]) | {"results": [run.document() for run in flat]}
        if trials:
            document["faults"] = [report(trial, found) for trial, found in zip(trials, ran, strict=True)]
        document["setup"] = setup_document(campaign)
    return Evaluation(document, tuple(run.result for run in flat))


def _kept(stores: Sequence[Store], runs: int) -> int:
    return sum(index in store.runs for store in stores for index in range(runs))


def results_of(
    campaign: Campaign, *, workers: int | None = 1, progress: Callable[[int], None] | None = None,
    executor: Executor | None = None, store: Store | None = None,
) -> list[NavigationResult]:  # fmt: skip
    """All results of a campaign in the order of their runs; see `run_all`."""
    with open_executor(workers, copies=is_simulated(campaign.rig)) as own:
        (runs,) = run_all([campaign], executor or own, progress=progress, stores=[] if store is None else [store])
    return [run.result for run in runs]


def run_all(
    campaigns: Sequence[Campaign], executor: Executor, *, progress: Callable[[int], None] | None = None,
    stores: Sequence[Store] = (),
) -> list[list[Ran]]:  # fmt: skip
    """All runs of campaigns that differ in their faults only, in their order.

    progress: is called with the number of finished runs after each run
    stores: one for each campaign, or none; runs in it are not done again, and new runs are stored as they end
    """
    every = [(c, k) for c, campaign in enumerate(campaigns) for k in range(campaign.runs)]
    done = {(c, k): run for c, store in enumerate(stores) for k, run in store.runs.items() if (c, k) in every}
    missing = [place for place in every if place not in done]
    if missing and (executor.apart or stores):
        ready = campaigns[0].resolve(job=campaigns[0].job_of(0))
        Run(ready.rig, ready.setup, ready.job, None, Display())  # finds wrong input before any process begins
    given = [replace(one, own_process=one.own_process or executor.apart) for one in campaigns]
    for number, ran in executor.each(do_run, [(given[c], k) for c, k in missing]):
        c, k = missing[number]
        done[c, k] = ran
        if stores:
            stores[c].keep(k, ran)
        if progress is not None:
            progress(len(done))
    return [[done[c, k] for k in range(campaign.runs)] for c, campaign in enumerate(campaigns)]


def summary(outcomes: list[NavigationResult]) -> dict[str, Any]:
    """The document that `evaluate --json` prints. Its times are those of the runs that arrived; null if none did."""
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
        "results": [outcome.json() for outcome in outcomes],
    }


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


def stored_documents(folder: Path) -> list[dict[str, Any]]:
    """The campaigns of a folder that `--store` named, each as a document of `evaluate --json`. Raises InputError."""
    documents = []
    for head, runs in map(read_runs, campaign_files(folder)):
        kept = ("version", "rig", "model", "behavior", "start_ring", "goal_ring", "time_limit_s", "fault")
        setup = {key: head[key] for key in kept if head.get(key) is not None} | {"map": head["setup"]["map"]}
        outcomes = [result_of(run["result"]) for run in sorted(runs, key=itemgetter("index"))]
        if outcomes:
            documents.append(summary(outcomes) | {"setup": setup | {"seed": outcomes[0].seed}})
    return documents


def setup_document(campaign: Campaign) -> dict[str, Any]:
    """The setup of a campaign, for readers of its document: program, rig, text of the map, and names of the rest.

    Two keys are there only if they apply:
    effects: MODULE:FUNCTION of the user
    policy: folder of the policy
    """
    ready = campaign.resolve(job=campaign.job_of(0))
    header = log_header(ready.setup, ready.job, 0.0)
    names = ("program", "version", "rig", "map", "map_name", "model", "behavior", "start_ring", "goal_ring", "seed")
    more = {"effects": campaign.effects, "policy": None if campaign.policy is None else str(campaign.policy)}
    return {**{name: header[name] for name in (*names, "time_limit_s")}, **{k: v for k, v in more.items() if v}}


def worst(outcomes: list[NavigationResult], which: str) -> dict[str, float]:
    """The spread over all runs: median of the runs' medians, largest p99 and largest maximum."""
    spreads = [getattr(outcome, which) for outcome in outcomes]
    if not spreads:
        return spread([])
    return {
        "p50": round(float(np.median([s["p50"] for s in spreads])), 4),
        "p99": max(s["p99"] for s in spreads),
        "max": max(s["max"] for s in spreads),
    }
