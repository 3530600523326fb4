"""Where the runs of `evaluate` are done, and where they are kept."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mazeplan.cli.output import say

if TYPE_CHECKING:
    from mazeplan.campaign.executor import Executor
    from mazeplan.campaign.store import Store
    from mazeplan.evaluate import Campaign
    from mazeplan.faultcampaign import Outcome
    from mazeplan.records import NavigationResult
    from mazeplan.rigs.faultschedule import Trial

Workers = Annotated[
    int | None, typer.Option("--workers", min=1, help="Processes to run in: 1; with --dask local one a core.")
]
DaskAddress = Annotated[
    str | None,
    typer.Option("--dask", metavar="ADDRESS", help="Dask scheduler to run at, such as tcp://host:8786, or local."),
]
StoreFolder = Annotated[
    Path | None,
    typer.Option("--store", metavar="DIR", help="Keep each run as it ends (Parquet); what is there is not done again."),
]
NoDeadline = Annotated[
    bool, typer.Option("--no-deadline", help="Plans may take long: results do not depend on how busy a machine is.")
]

MOST_OTHERS = 3  # campaigns in the same folder that are told one by one


def evaluate_all(
    campaign: Campaign, workers: int | None, dask: str | None, folder: Path | None
) -> list[NavigationResult]:
    """All results, with a bar; whatever ends it, a person is told what is kept and how to go on."""
    from mazeplan.campaign.store import open_store
    from mazeplan.cli.progress import campaign_progress
    from mazeplan.evaluate import evaluate

    with ExitStack() as stack:
        stores = [] if folder is None else [stack.enter_context(open_store(folder, campaign))]
        executor, there = stack.enter_context(_executor(workers, dask, stores, campaign.runs, 1))
        advance = stack.enter_context(campaign_progress(campaign.runs, begin=there))
        return evaluate(campaign, progress=advance, executor=executor, store=stores[0] if stores else None)


def evaluate_all_faults(
    campaign: Campaign, trials: Sequence[Trial], workers: int | None, dask: str | None, folder: Path | None
) -> list[list[Outcome]]:
    """The same for each trial of faults."""
    from mazeplan.campaign.store import open_stores
    from mazeplan.cli.progress import campaign_progress
    from mazeplan.faultcampaign import evaluate_faults

    count = campaign.runs * len(trials)
    with ExitStack() as stack:
        documents = [trial.to_json() for trial in trials]
        stores = () if folder is None else stack.enter_context(open_stores(folder, campaign, documents))
        executor, there = stack.enter_context(_executor(workers, dask, stores, campaign.runs, len(trials)))
        advance = stack.enter_context(campaign_progress(count, begin=there))
        return evaluate_faults(campaign, trials, progress=advance, executor=executor, stores=stores)


@contextmanager
def _executor(
    workers: int | None, dask: str | None, stores: Sequence[Store], runs: int, campaigns: int
) -> Iterator[tuple[Executor, int]]:
    """Where so many runs of each campaign are done, and how many of all are there; whatever ends them, a person is told
    what is kept and how to go on."""
    from mazeplan.campaign.executor import open_executor
    from mazeplan.errors import RigError

    count = runs * campaigns
    there = _tell_of(stores, runs, count) if stores else 0
    try:
        with open_executor(workers, dask, say=say) if there < count else open_executor() as executor:
            yield executor, there
    except (KeyboardInterrupt, RigError):
        _tell_how_to_go_on(stores, runs, count)
        raise


def _tell_of(stores: Sequence[Store], runs: int, count: int) -> int:
    """How many of the runs are there, said to a person, and what else is in the folder."""
    others = stores[0].others([store.name for store in stores])
    for other in others[:MOST_OTHERS]:
        say(f"{stores[0].folder} has runs of another campaign, too, which stay apart: {other}")
    if len(others) > MOST_OTHERS:
        say(f"and of {len(others) - MOST_OTHERS} more")
    there = _there(stores, runs)
    if there:
        say(f"{there} of {count} runs are in {stores[0].folder} already")
    return there


def _there(stores: Sequence[Store], runs: int) -> int:
    return sum(index in store.documents for store in stores for index in range(runs))


def _tell_how_to_go_on(stores: Sequence[Store], runs: int, count: int) -> None:
    if not stores:
        say("no run is kept; with --store DIR they are, and the same command goes on with the others")
    else:
        kept, folder = _there(stores, runs), stores[0].folder
        say(f"{kept} of {count} runs are kept in {folder}; the same command goes on with the others")
