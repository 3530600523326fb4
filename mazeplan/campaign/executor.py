"""Where independent pieces of work are done: one interface for this process, processes beside it, and Dask.

`each(work, tasks)` calls work(*task) for every task and yields (index, what it returned) as they end, in any order.
What work raises ends it. A process that dies while it works is no end: its task is done again elsewhere. One whose
process dies MOST_DEATHS times is not tried again; what is yielded for it is `Lost`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from mazeplan.errors import InputError, RigError

MOST_DEATHS = 3  # processes that one task may take with it
LOCAL = "local"  # in the place of a scheduler's address: a cluster of one's own on this machine

Result = TypeVar("Result")
Value = TypeVar("Value")
Words = Callable[[str], None]  # tells a person something


@dataclass(frozen=True)
class Lost:
    """In the place of a result: the process ended while it was worked on, so many times."""

    deaths: int


class Executor(Protocol):
    """See above. apart: the work is done in other processes."""

    apart: bool

    def share(self, value: Value) -> Value:
        """Something large that is part of many tasks: put what this returns into them, and it travels once."""
        ...

    def each(
        self, work: Callable[..., Result], tasks: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Result | Lost]]:
        """(index, work(*task)) of all tasks as they end."""
        ...


class InProcess:
    """One after the other, here."""

    apart = False

    def share(self, value: Value) -> Value:
        """The same; it need not travel."""
        return value

    def each(
        self, work: Callable[..., Result], tasks: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Result | Lost]]:
        """See `Executor`."""
        from mazeplan.campaign.processes import one_thread

        for index, task in enumerate(tasks):
            with one_thread():
                result = work(*task)
            yield index, result


def open_executor(
    workers: int | None = None, dask: str | None = None, *, carry: Sequence[Any] = (), say: Words | None = None
) -> AbstractContextManager[Executor]:
    """The executor that is asked for, as a context: in `workers` processes (None or 1: in this one), or what `dask`
    says: a scheduler's address, or `local`: a scheduler and `workers` processes (None: one a core) on this machine.

    carry: modules whose functions travel with the tasks, since workers on other machines cannot import them; say: is
    told what a person may want to know. Raises InputError where there is no such scheduler, or it has no workers, or
    none that would do the same."""
    if dask is not None:
        from mazeplan.campaign.daskcluster import dask_executor

        if dask != LOCAL and workers is not None:
            raise InputError(f"--workers: got {workers} with --dask {dask}, whose workers are as many as they are")
        return dask_executor(dask, workers, carry, say or (lambda text: None))
    from mazeplan.campaign.processes import in_processes

    return in_processes(workers or 1)


def each(
    work: Callable[..., Result],
    tasks: Sequence[tuple[Any, ...]],
    executor: Executor,
    lost: Callable[[int, Lost], Result] | None = None,
) -> Iterator[tuple[int, Result]]:
    """(index, work(*task)) of all tasks as they end; of one whose process ended again and again what `lost` makes of
    it. Without `lost` that raises RigError."""
    for index, result in executor.each(work, tasks):
        if not isinstance(result, Lost):
            yield index, result
        elif lost is not None:
            yield index, lost(index, result)
        else:
            raise RigError(f"task {index}: its worker process ended {result.deaths} times in the midst of it")
