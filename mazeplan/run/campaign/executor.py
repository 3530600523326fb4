"""Does independent pieces of work: in this process, in processes of this machine (loky), or on other machines (Dask).

`executor.each(work, tasks)` calls work(*task) for every task and yields (index, result) as the tasks end, in any order.
An exception of `work` ends it. If a process dies, another process does its task again; after MOST_DEATHS deaths without
a finished task it ends with RigError.
"""

from __future__ import annotations

import signal
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, closing
from functools import partial
from typing import Any, Protocol, TypeVar

from threadpoolctl import threadpool_limits

from mazeplan.core.errors import InputError, RigError
from mazeplan.core.progress import Words, no_words
from mazeplan.core.side_by_side import in_copies

MOST_DEATHS = 3  # maximum number of processes that may die before a task ends
WAKE_S = 1.0  # s, longest wait without a break: on some systems signals do not interrupt a wait

Result = TypeVar("Result")
Arguments = tuple[Any, ...]  # arguments of `work` for one task
TOO_MANY_DEATHS = f"worker processes ended {MOST_DEATHS} times in the midst of their work"


class Executor(Protocol):
    """Does independent tasks. apart: whether in other processes"""

    apart: bool

    def each(self, work: Callable[..., Result], tasks: Sequence[Arguments]) -> Iterator[tuple[int, Result]]:
        """(index, work(*task)) of all tasks as they end."""
        ...


def open_executor(
    workers: int | None = None, dask: str | None = None, *, copies: bool = False, say: Words = no_words
) -> AbstractContextManager[Executor]:
    """An executor, as a context manager.

    workers: number of processes; None or 1: this process
    copies: whether this process, without a number of workers, may do tasks in copies of itself (`side_by_side`)
    dask: address of a Dask scheduler; None: no Dask
    say: gets messages for people

    Raises InputError for a scheduler that does not answer, has no workers, or has workers that would compute something
    else."""
    if dask is None:
        return closing(InProcess(copies and workers is None) if workers in (None, 1) else Processes(workers))
    from mazeplan.run.campaign.dask_cluster import dask_executor

    if workers is not None:
        raise InputError(f"--workers: got {workers} with --dask {dask}, whose workers are as many as they are")
    return dask_executor(dask, say)


class InProcess:
    """Does one task after the other, in this process, or some of them in copies of it."""

    apart = False

    def __init__(self, copies: bool = False) -> None:
        self._copies = copies

    def each(self, work: Callable[..., Result], tasks: Sequence[Arguments]) -> Iterator[tuple[int, Result]]:
        """See `Executor`."""
        if self._copies:
            yield from in_copies(partial(alone, work), tasks)
            return
        for index, task in enumerate(tasks):
            yield index, alone(work, task)

    def close(self) -> None:
        """Nothing is left to end."""


class Processes:
    """See `Executor`. Each worker has one task at a time."""

    apart = True

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._pool: Any = None  # of loky; None: no process has begun

    def each(self, work: Callable[..., Result], tasks: Sequence[Arguments]) -> Iterator[tuple[int, Result]]:
        """See `Executor`. After a death, the tasks that were under way are done again."""
        waiting, deaths = deque(range(len(tasks))), 0
        running: dict[Future[Result], int] = {}
        try:
            while waiting or running:
                while waiting and len(running) < self._workers:
                    index = waiting.popleft()
                    running[self._submit(work, tasks[index])] = index
                done = wait(running, WAKE_S, FIRST_COMPLETED).done
                if any(isinstance(future.exception(), BrokenProcessPool) for future in done):
                    done = wait(running).done  # a broken pool ends them all
                    deaths, self._pool = deaths + 1, None
                for future in done:
                    index = running.pop(future)
                    if isinstance(future.exception(), BrokenProcessPool):
                        waiting.appendleft(index)
                    else:
                        deaths = 0
                        yield index, future.result()
                if deaths == MOST_DEATHS:
                    raise RigError(TOO_MANY_DEATHS)
        finally:
            if running:
                self.close()

    def _submit(self, work: Callable[..., Result], task: Arguments) -> Future[Result]:
        from joblib.externals.loky import ProcessPoolExecutor  # loads slowly

        if self._pool is None:
            self._pool = ProcessPoolExecutor(self._workers, initializer=_begin)
        try:
            return self._pool.submit(alone, work, task)
        except BrokenProcessPool:  # a worker died between two tasks
            self._pool = ProcessPoolExecutor(self._workers, initializer=_begin)
            return self._pool.submit(alone, work, task)

    def close(self) -> None:
        """End the workers, also in the middle of a task."""
        if self._pool is not None:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # about tasks that are given up
                self._pool.shutdown(wait=True, kill_workers=True)
            self._pool = None


def alone(work: Callable[..., Result], task: Arguments) -> Result:
    """Do one task with one thread for linear algebra. The threads of many workers would compete for the cores, and a
    sum that is split among threads differs in its last bits."""
    with threadpool_limits(limits=1):
        return work(*task)


def _begin() -> None:
    """Set up a new worker process. A terminal sends Ctrl-C to all processes; the first process ends the others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
