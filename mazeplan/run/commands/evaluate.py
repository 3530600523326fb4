"""`evaluate`: many runs, in processes or on Dask, kept in a store, with or without faults."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

from mazeplan.core.errors import InputError, RigError
from mazeplan.core.name_hints import nearest
from mazeplan.core.progress import Words, no_words
from mazeplan.core.records import NavigationResult
from mazeplan.core.results import DocumentResult
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.faults.kinds import KINDS
from mazeplan.rigs.faults.schedule import FaultTrial, every_kind, load_schedule
from mazeplan.rigs.interface import Rig
from mazeplan.rigs.registry import is_simulated, named_rig
from mazeplan.run.campaign.evaluate import run_all, setup_document, summary
from mazeplan.run.campaign.executor import Executor, open_executor
from mazeplan.run.campaign.faults import report
from mazeplan.run.campaign.one_run import Campaign, Ran
from mazeplan.run.campaign.pairs import PairedRuns, paired
from mazeplan.run.campaign.store import Store, open_stores
from mazeplan.run.specification import TIME_LIMIT

RUNS, FAULT_RUNS = 16, 10
Bar = Callable[[int, int], AbstractContextManager[Callable[[int], None]]]  # of so many runs, of which some are done


def no_bar(total: int, begin: int) -> AbstractContextManager[Callable[[int], None]]:
    """The default: the progress is not shown."""
    return nullcontext(lambda finished: None)


@dataclass(frozen=True)
class Evaluation(DocumentResult):
    """Many navigations: the document of `evaluate --json`, and each result."""

    kind: ClassVar[str] = "evaluation"

    results: tuple[NavigationResult, ...] = field(repr=False)

    def compare(self, other: Evaluation) -> PairedRuns:
        """How the other evaluation differs from this one, seed by seed (`evaluate --compare`)."""
        return paired(self.document, other.document)


@dataclass(frozen=True)
class Work:
    """How a campaign is done. store: folder of finished runs; say: gets messages; bar: shows the progress"""

    workers: int | None
    dask: str | None
    store: Path | None
    say: Words
    bar: Bar


def evaluate(
    runs: int | None = None, *, rig: str | Path | Rig | type = "toy", map: str | Path | Maze = "cme",
    model: str | Path | RigModel | None = None, effects: str | None = None, policy: str | Path | None = None,
    behavior: str = "navigate", behavior_modules: Sequence[str] = (), settings: str | Path | None = None,
    start: int | str = 1, goal: int | str | None = None, balls: int | None = None, seed: int = 0,
    time_limit: float = TIME_LIMIT, workers: int | None = None, dask: str | None = None,
    store: str | Path | None = None, deadline: bool = True, faults: str | Path | None = None,
    own_process: bool = False, say: Words = no_words, bar: Bar = no_bar,
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
    work = Work(workers, dask, None if store is None else Path(store), say, bar)
    alone = (workers or 1) == 1 and dask is None and store is None
    with named_rig(rig, alone=alone) as name:
        usual = FAULT_RUNS if faults else RUNS
        campaign = Campaign(
            start, goal, map, name, model, policy, behavior, tuple(behavior_modules), effects, settings, balls=balls,
            seed=seed, time_limit=time_limit, deadline=deadline, runs=usual if runs is None else runs,
            own_process=own_process,
        )  # fmt: skip
        ran, document = _all_runs(campaign, None if faults is None else str(faults), work)
        document["setup"] = setup_document(campaign)
    return Evaluation(document, tuple(run.result for run in ran))


def _all_runs(campaign: Campaign, faults: str | None, work: Work) -> tuple[list[Ran], dict[str, Any]]:
    """Do all runs of a campaign; with faults, all runs of each fault. Returns the runs and their document.

    faults: file of the schedule, or all; None: no faults"""
    trials = () if faults is None else _trials(faults, campaign.time_limit, work.say)
    campaigns = [replace(campaign, fault=trial) for trial in trials] or [campaign]
    with ExitStack() as stack:
        stores = () if work.store is None else stack.enter_context(open_stores(work.store, campaigns))
        executor, advance = stack.enter_context(_executor(work, stores, campaign, len(campaigns)))
        runs = run_all(campaigns, executor, progress=advance, stores=stores)
    flat = [run for of_one in runs for run in of_one]
    document = summary([run.result for run in flat]) | {"results": [run.document() for run in flat]}
    if trials:
        document["faults"] = [report(trial, found) for trial, found in zip(trials, runs, strict=True)]
    return flat, document


def _trials(faults: str, limit_s: float, say: Words) -> tuple[FaultTrial, ...]:
    """The trials of a schedule; says which begin only after the time limit. faults: file of the schedule, or all"""
    if faults == "all":
        return every_kind()
    kind = faults if faults in KINDS else nearest(faults, KINDS)
    if kind is not None and not Path(faults).exists():
        how = f"{kind} is a kind of fault, for such a file: `faults: [{{kind: {kind}}}]`"
        raise InputError(f"got {faults!r}, expected all, or a schedule of faults (YAML); {how}", key="--faults")
    trials = load_schedule(faults)
    late = [trial.name for trial in trials if any(e.at_s[0] >= limit_s for e in trial.entries)]
    if late:
        limit = f"begins only after the time limit of {limit_s:g} s"
        say(f"--faults: {', '.join(late)}: {limit}; expected an earlier at_s, or a longer --time-limit")
    return trials


@contextmanager
def _executor(
    work: Work, stores: Sequence[Store], campaign: Campaign, campaigns: int
) -> Iterator[tuple[Executor, Any]]:
    """The executor of the runs that no store holds, and `advance(finished)` of their bar.

    stores: one for each campaign

    After Ctrl-C or a failure of the rig, a message says what is kept and how to continue."""
    runs, copies = campaign.runs, is_simulated(campaign.rig)
    count = runs * campaigns
    kept = _kept(stores, runs)
    if kept:
        work.say(f"{kept} of {count} runs are in {stores[0].folder} already")
    try:
        how = {"copies": copies, "say": work.say}
        opened = open_executor(work.workers, work.dask, **how) if kept < count else open_executor()
        with opened as executor, work.bar(count, kept) as advance:
            yield executor, advance
    except (KeyboardInterrupt, RigError):
        if stores:
            kept, folder = _kept(stores, runs), stores[0].folder
            work.say(f"{kept} of {count} runs are kept in {folder}; the same command continues with the others")
        else:
            work.say("no run is kept; use --store DIR to keep runs and to continue with the same command")
        raise


def _kept(stores: Sequence[Store], runs: int) -> int:
    return sum(index in store.runs for store in stores for index in range(runs))
