"""Does independent pieces of work: in this process, in processes of this machine (loky), or on other machines (Dask).

`executor.each(work, tasks)` calls work(*task) for every task and yields (index, result) as the tasks end, in any order.
An exception of `work` ends it. If a process dies, another process does its task again. After MOST_DEATHS deaths the
task is given up; its result is `Lost`.
"""

from __future__ import annotations

import signal
import sys
import warnings
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from threadpoolctl import ThreadpoolController

from mazeplan.core.errors import InputError, RigError
from mazeplan.core.progress import Words, no_words

LOCAL = "local"  # in place of the address of a scheduler: start a cluster on this machine
MOST_DEATHS = 3  # maximum number of processes that may die during one task
WAKE_S = 1.0  # s, longest wait without a break: on some systems signals do not interrupt a wait

Result = TypeVar("Result")
Value = TypeVar("Value")
Arguments = tuple[Any, ...]  # arguments of `work` for one task
_found: list[tuple[int, ThreadpoolController]] = []  # number of modules, and the controller of their libraries


@dataclass(frozen=True)
class Lost:
    """In place of the result of a task that was given up. deaths: how often a process died during it."""

    deaths: int


class Executor(Protocol):
    """Does independent tasks.

    apart: whether in other processes
    elsewhere: whether perhaps on other machines, which lack the user's files
    """

    apart: bool
    elsewhere: bool

    def share(self, value: Value) -> Value:
        """Prepare a large value that many tasks share. Put the returned value into the tasks: it then travels once."""
        ...

    def each(self, work: Callable[..., Result], tasks: Sequence[Arguments]) -> Iterator[tuple[int, Result | Lost]]:
        """(index, work(*task)) of all tasks as they end."""
        ...


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
        return _here(workers or 1)
    from mazeplan.run.campaign.dask_cluster import dask_executor

    if dask != LOCAL and workers is not None:
        raise InputError(f"--workers: got {workers} with --dask {dask}, whose workers are as many as they are")
    return dask_executor(None if dask == LOCAL else dask, workers, carry, say)


@contextmanager
def _here(workers: int) -> Iterator[Executor]:
    if workers == 1:
        yield InProcess()
        return
    processes = Processes(workers)
    try:
        yield processes
    finally:
        processes.close()


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


@contextmanager
def one_thread() -> Iterator[None]:
    """A context in which linear algebra uses one thread. The threads of many workers would compete for the cores, and a
    sum that is split among threads differs in its last bits."""
    modules = len(sys.modules)
    if not _found or _found[0][0] != modules:  # the search for loaded libraries takes a while
        _found[:] = [(modules, ThreadpoolController())]
    with _found[0][1].limit(limits=1):
        yield


class InProcess:
    """Does one task after the other, in this process."""

    apart = elsewhere = False

    def share(self, value: Value) -> Value:
        """Returns the value itself: it does not travel."""
        return value

    def each(self, work: Callable[..., Result], tasks: Sequence[Arguments]) -> Iterator[tuple[int, Result | Lost]]:
        """See `Executor`."""
        for index, task in enumerate(tasks):
            yield index, _alone(work, task)


class Processes:
    """See `Executor`. Each worker has one task at a time, so it is known which tasks a death may be due to."""

    apart, elsewhere = True, False

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._pool: Any = None  # of loky; None: no process has begun

    def share(self, value: Value) -> Value:
        """Returns the value itself: through a pipe it travels fast enough."""
        return value

    def each(self, work: Callable[..., Result], tasks: Sequence[Arguments]) -> Iterator[tuple[int, Result | Lost]]:
        """See `Executor`. After a death, the tasks that were under way are done last, one by one."""
        waiting, suspects = deque(range(len(tasks))), deque[int]()
        deaths = Counter[int]()
        running: dict[Future[Result], int] = {}
        try:
            while waiting or suspects or running:
                while waiting and len(running) < self._workers:
                    index = waiting.popleft()
                    running[self._submit(work, tasks[index])] = index
                if not running:
                    index = suspects.popleft()
                    running[self._submit(work, tasks[index])] = index
                for future in wait(running, WAKE_S, FIRST_COMPLETED).done:
                    index = running.pop(future)
                    if not isinstance(future.exception(), BrokenProcessPool):
                        yield index, future.result()
                        continue
                    self._pool = None
                    deaths[index] += 1
                    if deaths[index] < MOST_DEATHS:
                        suspects.append(index)
                    else:
                        yield index, Lost(deaths[index])
        finally:
            if running:
                self.close()

    def _submit(self, work: Callable[..., Result], task: Arguments) -> Future[Result]:
        from joblib.externals.loky import ProcessPoolExecutor  # loads slowly

        if self._pool is None:
            self._pool = ProcessPoolExecutor(self._workers, initializer=_begin)
        try:
            return self._pool.submit(_alone, work, task)
        except BrokenProcessPool:  # a worker died between two tasks
            self._pool = ProcessPoolExecutor(self._workers, initializer=_begin)
            return self._pool.submit(_alone, work, task)

    def close(self) -> None:
        """End the workers, also in the middle of a task."""
        if self._pool is not None:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # about tasks that are given up
                self._pool.shutdown(wait=True, kill_workers=True)
            self._pool = None


def _alone(work: Callable[..., Result], task: Arguments) -> Result:
    with one_thread():
        return work(*task)


def _begin() -> None:
    """Set up a new worker process. A terminal sends Ctrl-C to all processes; the first process ends the others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
