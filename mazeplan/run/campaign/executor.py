"""Chooses where independent pieces of work are done: in this process, in others, or by Dask."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from typing import Any

from mazeplan.core.errors import InputError, RigError
from mazeplan.core.progress import Words, no_words
from mazeplan.run.campaign.processes import InProcess, in_processes
from mazeplan.run.campaign.tasks import Arguments, Executor, Lost, Result

__all__ = ["Executor", "InProcess", "Lost", "each", "open_executor"]

LOCAL = "local"  # in place of the address of a scheduler: start a cluster on this machine


def open_executor(
    workers: int | None = None, dask: str | None = None, *, carry: Sequence[Any] = (), say: Words = no_words
) -> AbstractContextManager[Executor]:
    """An executor, as a context manager.

    workers: number of processes; None or 1: this process. With dask="local", None means one process for each core
    dask: address of a Dask scheduler; "local" starts a scheduler and worker processes on this machine; None: no Dask
    carry: modules whose functions travel with the tasks, because workers on other machines cannot import them
    say: gets messages for people

    Raises InputError for a scheduler that does not answer, has no workers, or has workers that would compute something
    else."""
    if dask is None:
        return in_processes(workers or 1)
    from mazeplan.run.campaign.dask_cluster import dask_executor

    if dask != LOCAL and workers is not None:
        raise InputError(f"--workers: got {workers} with --dask {dask}, whose workers are as many as they are")
    return dask_executor(None if dask == LOCAL else dask, workers, carry, say)


def each(
    work: Callable[..., Result],
    tasks: Sequence[Arguments],
    executor: Executor,
    lost: Callable[[int, Lost], Result] | None = None,
) -> Iterator[tuple[int, Result]]:
    """(index, work(*task)) of all tasks as they end.

    lost: makes the result of a task whose process died too often; None: such a task raises RigError"""
    for index, result in executor.each(work, tasks):
        if not isinstance(result, Lost):
            yield index, result
        elif lost is not None:
            yield index, lost(index, result)
        else:
            raise RigError(f"task {index}: its worker process ended {result.deaths} times in the midst of it")
