"""Where the runs of `evaluate` are done, and where they are kept."""

from __future__ import annotations

from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mazeplan.cli.output import say

if TYPE_CHECKING:
    from mazeplan.campaign.executor import Executor
    from mazeplan.campaign.store import Store
    from mazeplan.evaluate import Campaign
    from mazeplan.records import NavigationResult

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


def evaluate_all(
    campaign: Campaign, workers: int | None, dask: str | None, folder: Path | None
) -> list[NavigationResult]:
    """All results, with a bar; whatever ends it, a person is told what is kept and how to go on."""
    from mazeplan.campaign.executor import open_executor
    from mazeplan.campaign.store import open_store
    from mazeplan.cli.progress import campaign_progress
    from mazeplan.errors import RigError
    from mazeplan.evaluate import evaluate

    with ExitStack() as stack:
        store = None if folder is None else stack.enter_context(open_store(folder, campaign))
        there = 0 if store is None else _tell_of(store, campaign.runs)
        try:
            if there < campaign.runs:
                executor = stack.enter_context(open_executor(workers, dask, say=say))
            else:
                executor = stack.enter_context(open_executor())
            with campaign_progress(campaign.runs, begin=there) as advance:
                return evaluate(campaign, progress=advance, executor=executor, store=store)
        except (KeyboardInterrupt, RigError):
            _tell_how_to_go_on(store, campaign.runs)
            raise


def _tell_of(store: Store, runs: int) -> int:
    """How many of the runs are there, said to a person, and what else is in the folder."""
    for other in store.others():
        say(f"{store.folder} has runs of another campaign, too, which stay apart: {other}")
    there = sum(index in store.results for index in range(runs))
    if there:
        say(f"{there} of {runs} runs are in {store.folder} already")
    return there


def _tell_how_to_go_on(store: Store | None, runs: int) -> None:
    if store is None:
        say("no run is kept; with --store DIR they are, and the same command goes on with the others")
    else:
        there = sum(index in store.results for index in range(runs))
        say(f"{there} of {runs} runs are kept in {store.folder}; the same command goes on with the others")


def faults_executor(workers: int | None, dask: str | None, folder: Path | None) -> AbstractContextManager[Executor]:
    """Where runs with faults are done; they are not kept. Raises InputError where they are to be."""
    from mazeplan.campaign.executor import open_executor
    from mazeplan.errors import InputError

    if folder is not None:
        raise InputError(f"--store: got {folder} with --faults, whose runs are not kept; expected one of the two")
    return open_executor(workers, dask, say=say)
