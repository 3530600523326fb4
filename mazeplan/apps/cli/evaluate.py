"""`evaluate`: many runs, in processes or on Dask, kept in a store, with faults or with learning."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.learning import check_learning, evaluate_learning
from mazeplan.apps.cli.navigate import note_missing_model
from mazeplan.apps.cli.output import print_json, say

if TYPE_CHECKING:
    from mazeplan.core.records import NavigationResult
    from mazeplan.rigs.faults.schedule import FaultTrial
    from mazeplan.run.campaign.evaluate import Campaign
    from mazeplan.run.campaign.executor import Executor
    from mazeplan.run.campaign.store import Store

RUNS, FAULT_RUNS = 16, 10


def evaluate(
    runs: opt.Runs = None,
    rig: opt.RigName = "toy",
    map_: opt.Map = "cme",
    model: opt.Model = None,
    effects: opt.EffectModule = None,
    policy: opt.Policy = None,
    behavior: opt.Behavior = "navigate",
    behavior_module: opt.BehaviorModule = None,
    settings: opt.Settings = None,
    start: opt.StartRing = "ring1",
    goal: opt.GoalRing = "centre",
    balls: opt.Balls = None,
    seed: opt.FirstSeed = 0,
    time_limit: opt.TimeLimit = 20.0,
    workers: opt.Workers = None,
    dask: opt.Dask = None,
    store: opt.Store = None,
    no_deadline: opt.NoDeadline = False,
    faults: opt.Faults = None,
    learn: opt.Learn = False,
    output: opt.LearnedModel = None,
    sense: opt.Sense = None,
    report: opt.Report = None,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Run many navigations and summarise success, times and failures; with --faults also the response to each fault."""
    from mazeplan.apps.cli.report import write_report
    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.registry import make_rig
    from mazeplan.run.balls import with_balls
    from mazeplan.run.campaign.evaluate import Campaign, setup_document, summary

    check_learning(learn, output, workers, {"--faults": faults, "--dask": dask, "--store": store})
    make_rig(rig, with_balls(load_map(map_), balls), sense)
    note_missing_model(rig, model)
    campaign = Campaign(
        runs=runs or (FAULT_RUNS if faults else RUNS), rig=rig, map=map_, model=model, start=start,
        behavior="policy" if policy is not None and behavior == "navigate" else behavior,
        goal=goal, seed=seed, time_limit=time_limit, settings=settings,
        behavior_modules=tuple(behavior_module or ()), own_process=True, sense=sense, deadline=not no_deadline,
        effects=effects, policy=policy, balls=balls,
    )  # fmt: skip
    if faults is not None:
        document = _evaluate_faults(campaign, faults, workers, dask, store)
    elif learn:
        outcomes, learning = evaluate_learning(campaign, output)
        document = {**summary(outcomes), "learning": learning}
    else:
        document = summary(_evaluate(campaign, workers, dask, store))
    document["setup"] = setup_document(campaign)
    if report is not None:
        write_report("evaluation", document, report, document["setup"]["rig"] + (" with faults" if faults else ""))
    if as_json:
        print_json(document)
    elif faults is not None:
        print("\n".join(fault_lines(document["faults"])))
    else:
        print("\n".join(summary_lines(document)))
    sys.exit(_exit_status(document, campaign.runs))


def _exit_status(document: dict[str, Any], runs: int) -> int:
    """0 if all runs arrived, or with faults if all faults ended as they should.

    Raises RigError if a rig failed in a campaign without faults."""
    from mazeplan.core.errors import RigError
    from mazeplan.core.records import FailureKind
    from mazeplan.run.campaign.faults import good

    if "faults" in document:
        return 0 if good(document["faults"]) else 1
    failures = (failure for result in document["results"] for failure in result["failures"])
    failed = next((failure for failure in failures if failure["kind"] == FailureKind.RIG_FAILED.value), None)
    if failed is not None:
        raise RigError(failed["words"])
    return 0 if document["success"] == runs else 1


def _evaluate(campaign: Campaign, workers: int | None, dask: str | None, folder: Path | None) -> list[NavigationResult]:
    """Run a campaign without faults. Returns all results."""
    from mazeplan.run.campaign.evaluate import evaluate
    from mazeplan.run.campaign.store import open_store

    with ExitStack() as stack:
        stores = [] if folder is None else [stack.enter_context(open_store(folder, campaign))]
        executor, advance = stack.enter_context(_executor(workers, dask, stores, campaign.runs, 1))
        return evaluate(campaign, progress=advance, executor=executor, store=stores[0] if stores else None)


def _evaluate_faults(
    campaign: Campaign, faults: str, workers: int | None, dask: str | None, folder: Path | None
) -> dict[str, Any]:
    """Run a campaign that tries each fault of a schedule. Returns its document. faults: file of the schedule, or all"""
    from mazeplan.run.campaign.evaluate import summary
    from mazeplan.run.campaign.faults import evaluate_faults, report
    from mazeplan.run.campaign.store import open_stores

    trials = _trials(faults)
    late = [trial.name for trial in trials if any(e.at_s[0] >= campaign.time_limit for e in trial.entries)]
    if late:
        limit = f"begins only after the time limit of {campaign.time_limit:g} s"
        say(f"--faults: {', '.join(late)}: {limit}; expected an earlier at_s, or a longer --time-limit")
    with ExitStack() as stack:
        documents = [trial.to_json() for trial in trials]
        stores = () if folder is None else stack.enter_context(open_stores(folder, campaign, documents))
        executor, advance = stack.enter_context(_executor(workers, dask, stores, campaign.runs, len(trials)))
        outcomes = evaluate_faults(campaign, trials, progress=advance, executor=executor, stores=stores)
    flat = [outcome for per_trial in outcomes for outcome in per_trial]
    document = summary([outcome.result for outcome in flat])
    document["results"] = [outcome.to_json() for outcome in flat]
    document["faults"] = [report(trial, found) for trial, found in zip(trials, outcomes, strict=True)]
    return document


def _trials(faults: str) -> tuple[FaultTrial, ...]:
    """The trials of a schedule. faults: file of the schedule, or all"""
    from mazeplan.core.errors import InputError
    from mazeplan.core.name_hints import nearest
    from mazeplan.rigs.faults.kinds import KINDS
    from mazeplan.rigs.faults.schedule import every_kind, load_schedule

    if faults == "all":
        return every_kind()
    kind = faults if faults in KINDS else nearest(faults, KINDS)
    if kind is not None and not Path(faults).exists():
        how = f"{kind} is a kind of fault, for such a file: `faults: [{{kind: {kind}}}]`"
        raise InputError(f"got {faults!r}, expected all, or a schedule of faults (YAML); {how}", key="--faults")
    return load_schedule(faults)


@contextmanager
def _executor(
    workers: int | None, dask: str | None, stores: Sequence[Store], runs: int, campaigns: int
) -> Iterator[tuple[Executor, Any]]:
    """The executor of the runs that no store holds, and `advance(finished)` of their bar.

    stores: one for each campaign

    After Ctrl-C or a failure of the rig, a message says what is kept and how to continue."""
    from mazeplan.apps.cli.progress import campaign_progress
    from mazeplan.core.errors import RigError
    from mazeplan.run.campaign.executor import open_executor

    count = runs * campaigns
    kept = _kept(stores, runs)
    if kept:
        say(f"{kept} of {count} runs are in {stores[0].folder} already")
    try:
        opened = open_executor(workers, dask, say=say) if kept < count else open_executor()
        with opened as executor, campaign_progress(count, begin=kept) as advance:
            yield executor, advance
    except (KeyboardInterrupt, RigError):
        if stores:
            kept, folder = _kept(stores, runs), stores[0].folder
            say(f"{kept} of {count} runs are kept in {folder}; the same command continues with the others")
        else:
            say("no run is kept; use --store DIR to keep runs and to continue with the same command")
        raise


def _kept(stores: Sequence[Store], runs: int) -> int:
    return sum(index in store.documents for store in stores for index in range(runs))


def summary_lines(document: dict[str, Any]) -> list[str]:
    """The summary of a campaign, as lines."""
    times, failures = document["time_s"], document["failures"]
    lines = [f"arrived       {document['success']} of {document['runs']}"]
    if times["mean"] is not None:
        figures = ", ".join(f"{key} {times[key]:.2f} s" for key in ("mean", "best", "p50", "p95", "worst"))
        lines.append(f"time          {figures}")
    lines.append("failures      " + (", ".join(f"{kind} {count}" for kind, count in failures.items()) or "none"))
    for key, label in (("planner_ms", "planner"), ("tick_ms", "tick")):
        figures = ", ".join(f"{name} {document[key][name]:.2f} ms" for name in ("p50", "p99", "max"))
        lines.append(f"{label:13s} {figures}")
    return lines


def fault_lines(rows: list[dict[str, Any]]) -> list[str]:
    """One line for each fault, and below it a line for each broken rule."""
    width = max(len("fault"), *(len(row["fault"]) for row in rows))
    lines = [f"{'fault':{width}s}  arrived  noticed  after s  recoveries, and other ends"]
    for row in rows:
        after = "-" if row["noticed_s"] is None else f"{row['noticed_s']['p50']:.2f}"
        ends = [f"{reason} {count}" for reason, count in row["stopped"].items()]
        if row["because"]:
            ends.append(f"cannot be survived: {row['because']}")
        text = "; ".join([", ".join(row["recoveries"]) or "none", *ends])
        arrived, noticed = f"{row['arrived']}/{row['runs']}", f"{row['noticed']}/{row['faulted']}"
        lines.append(f"{row['fault']:{width}s}  {arrived:>7s}  {noticed:>7s}  {after:>7s}  {text}")
        lines += [f"{'':{width}s}  WRONG: {wrong}" for wrong in row["wrong"]]
    return lines
