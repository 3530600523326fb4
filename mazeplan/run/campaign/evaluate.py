"""Many navigations: success, times, failures by kind.

Start angles: the first 16 are theta = pi k / 8 + pi / 16, as in the published evaluation; further ones are drawn by the
run's seed. Each run has its own seed, so the results are the same for any number of workers on any machines
(`campaign`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from mazeplan.core.display import NullDisplay
from mazeplan.core.maths.spread import spread
from mazeplan.core.records import NavigationResult
from mazeplan.run.campaign.executor import Executor, open_executor
from mazeplan.run.campaign.one_run import (
    FIXED_STARTS,
    Campaign,
    Ran,
    job_of,
    measured,
    rig_failed,
    rig_of_run,
    run_one,
    setup_of,
    start_angle,
)
from mazeplan.run.campaign.store import Store
from mazeplan.run.loop import Run
from mazeplan.run.specification import log_header

__all__ = [
    "FIXED_STARTS", "Campaign", "evaluate", "job_of", "rig_failed", "run_one", "setup_document", "setup_of",
    "start_angle", "summary",
]  # fmt: skip


def evaluate(
    campaign: Campaign,
    *,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
    executor: Executor | None = None,
    store: Store | None = None,
) -> list[NavigationResult]:
    """All results of a campaign in the order of their runs.

    workers: number of processes
    progress: is called with the number of finished runs after each run
    executor: does the runs, in place of `workers` (`campaign.executor.open_executor`)
    store: runs in it are not done again; new runs are stored as they end
    """
    if executor is None:
        with open_executor(workers) as own:
            return evaluate(campaign, progress=progress, executor=own, store=store)
    done = {} if store is None else {k: r for k, r in store.results.items() if k < campaign.runs}
    missing = [index for index in range(campaign.runs) if index not in done]
    if missing and (executor.apart or store is not None):
        check(campaign)
    campaign = replace(campaign, own_process=campaign.own_process or executor.apart)
    for k, ran in executor.each(do_run, [(campaign, index) for index in missing]):
        done[missing[k]] = ran.result
        if store is not None:
            store.keep(missing[k], ran)
        if progress is not None:
            progress(len(done))
    return [done[index] for index in range(campaign.runs)]


def do_run(campaign: Campaign, index: int) -> Ran:
    """Run number `index` of a campaign, with its times."""
    return Ran(*measured(lambda: run_one(campaign, index)))


def check(campaign: Campaign) -> None:
    """Prepare a run without doing it, to find wrong input before any process begins. Raises InputError."""
    maze = campaign.maze()
    rig = rig_of_run(campaign, 0, maze)
    Run(rig, setup_of(campaign, maze), job_of(campaign, 0, maze), None, NullDisplay())


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


def setup_document(campaign: Campaign) -> dict[str, Any]:
    """The setup of a campaign, for readers of its document: program, rig, text of the map, and names of the rest.

    Two keys are there only if they apply:
    effects: MODULE:FUNCTION of the user
    policy: folder of the policy
    """
    maze = campaign.maze()
    job, setup = job_of(campaign, 0, maze), setup_of(campaign, maze)
    header = log_header(setup, job, 0.0)
    names = ("program", "version", "rig", "map", "map_name", "model", "behavior", "start_ring", "goal_ring", "seed")
    more = {"effects": campaign.effects, "policy": campaign.policy}
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
