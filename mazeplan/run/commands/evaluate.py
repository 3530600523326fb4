"""`evaluate`: many runs, in processes or on Dask, kept in a store, with or without faults."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

from mazeplan.core.errors import RigError
from mazeplan.core.progress import Words, no_words
from mazeplan.core.records import NavigationResult
from mazeplan.core.results import DocumentResult
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.faults.schedule import every_kind, load_schedule
from mazeplan.rigs.interface import Rig
from mazeplan.rigs.registry import is_simulated, named_rig
from mazeplan.run.campaign.evaluate import run_all, setup_document, summary
from mazeplan.run.campaign.executor import open_executor
from mazeplan.run.campaign.faults import report
from mazeplan.run.campaign.one_run import Campaign
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
    with ExitStack() as stack:
        alone = (workers or 1) == 1 and dask is None and store is None
        name = stack.enter_context(named_rig(rig, alone=alone))
        usual = FAULT_RUNS if faults else RUNS
        campaign = Campaign(
            start, goal, map, name, model, policy, behavior, tuple(behavior_modules), effects, settings, balls=balls,
            seed=seed, time_limit=time_limit, deadline=deadline, runs=usual if runs is None else runs,
            own_process=own_process,
        )  # fmt: skip
        trials = () if faults is None else every_kind() if faults == "all" else load_schedule(faults)
        campaigns = [replace(campaign, fault=trial) for trial in trials] or [campaign]
        stores = () if store is None else stack.enter_context(open_stores(Path(store), campaigns))
        count, kept = campaign.runs * len(campaigns), _kept(stores, campaign.runs)
        if kept:
            say(f"{kept} of {count} runs are in {store} already")
        how: dict[str, Any] = {"workers": workers, "dask": dask, "copies": is_simulated(name), "say": say}
        try:
            opened = open_executor(**how) if kept < count else open_executor()
            with opened as executor, bar(count, kept) as advance:
                ran = run_all(campaigns, executor, progress=advance, stores=stores)
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
