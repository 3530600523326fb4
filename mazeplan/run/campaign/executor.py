"""Does independent pieces of work: in this process, in processes of this machine (loky), or on other machines (Dask).

`executor.each(work, tasks)` calls work(*task) for every task and yields (index, result) as the tasks end, in any order.
An exception of `work` ends it. If a process dies, another process does its task again; after MOST_DEATHS deaths without
a finished task it ends with RigError.

Only this file imports dask and distributed. Dask's workers read the user's files at the same paths as this process:
give them a folder that all machines share.
"""

from __future__ import annotations

import logging
import os
import platform
import signal
import threading
import uuid
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, closing, contextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from threadpoolctl import threadpool_limits

from mazeplan.core.errors import InputError, RigError
from mazeplan.core.progress import Words, no_words
from mazeplan.core.resources import to_install
from mazeplan.core.side_by_side import in_copies
from mazeplan.run.campaign.store import program, program_mismatch

if TYPE_CHECKING:
    from distributed import Client

MOST_DEATHS = 3  # maximum number of processes that may die before a task ends
WAKE_S = 1.0  # s, longest wait without a break: on some systems signals do not interrupt a wait

CONNECT_S = 5.0  # s within which a Dask scheduler must answer
WORKERS_S = 10.0  # s within which its first worker must come
POLL_S = 1.0  # s between looks for the scheduler while no task ends
QUIET = ("distributed", "distributed.client", "tornado.application")  # their messages are for who runs the cluster
DASK = {
    "distributed.comm.timeouts.connect": CONNECT_S,
    "distributed.scheduler.allowed-failures": MOST_DEATHS - 1,
    "distributed.admin.large-graph-warning-threshold": 1 << 30,
}
_one_at_a_time = threading.Lock()  # a process does one run at a time

Result = TypeVar("Result")
Arguments = tuple[Any, ...]  # arguments of `work` for one task
TOO_MANY_DEATHS = f"worker processes ended {MOST_DEATHS} times in the midst of their work"


class Executor(Protocol):
    """Does independent tasks. apart: whether in other processes"""

    apart: bool

    def each(self, work: Callable[..., Result], tasks: Sequence[Arguments]) -> Iterator[tuple[int, Result]]:
        """(index, work(*task)) of all tasks as they end."""
        ...


@contextmanager
def open_executor(
    workers: int | None = None, dask: str | None = None, *, copies: bool = False, say: Words = no_words
) -> Iterator[Executor]:
    """An executor, as a context manager.

    workers: number of processes; None or 1: this process
    copies: whether this process, without a number of workers, may do tasks in copies of itself (`side_by_side`)
    dask: address of a Dask scheduler; None: no Dask
    say: gets messages for people

    Raises InputError for a scheduler that does not answer, has no workers, or has workers that would compute something
    else."""
    if dask is not None and workers is not None:
        raise InputError(f"--workers: got {workers} with --dask {dask}, whose workers are as many as they are")
    with ExitStack() as stack:
        if dask is not None:
            yield Dask(stack.enter_context(_connection(dask, say)), dask)
        elif workers in (None, 1):
            yield InProcess(copies and workers is None)
        else:
            yield stack.enter_context(closing(Processes(workers)))


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


@contextmanager
def _connection(address: str, say: Words) -> Iterator[Client]:
    """The connection to a scheduler. Raises as `open_executor`."""
    try:
        import distributed
        from dask import config
        from distributed.versions import VersionMismatchWarning
    except ImportError:
        raise InputError(f"--dask needs dask and distributed: {to_install('campaign')}") from None
    with ExitStack() as stack:
        stack.enter_context(config.set(DASK))
        stack.enter_context(warnings.catch_warnings())
        warnings.simplefilter("ignore", VersionMismatchWarning)  # `_check_workers` checks what matters
        for name in QUIET:
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        try:
            client = stack.enter_context(distributed.Client(address, timeout=CONNECT_S, set_as_default=False))
        except (OSError, ValueError, TypeError, ImportError) as problem:
            raise InputError(f"--dask: got {address}: no scheduler answers there: {_line(problem)}") from None
        _check_workers(client, address)
        say(f"Dask's dashboard: {client.dashboard_link}")
        yield client


def _line(problem: BaseException) -> str:
    return " ".join(f"{problem}".split()) or type(problem).__name__


def _check_workers(client: Client, address: str) -> None:
    """Raises InputError unless there are workers and all have the same program and packages as this process."""
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
    except TimeoutError:
        start = f"dask worker {address} --nthreads 1"
        raise InputError(f"--dask: the scheduler at {address} has no workers; start some: {start}") from None
    found: Any = client.run(facts, on_error="return")
    for worker, theirs in found.items():
        if isinstance(theirs, BaseException):
            raise InputError(
                f"--dask: worker {worker} cannot do this: {_line(theirs)}; install the same mazeplan there"
            )
        if other := program_mismatch(program(), theirs):
            raise InputError(f"--dask: worker {worker} would not compute the same: it has {other}")


def facts() -> dict[str, str]:
    """The versions of program and packages on a worker."""
    return dict(program())


class Dask:
    """See `Executor`."""

    apart = True

    def __init__(self, client: Client, address: str) -> None:
        self._client = client
        self._address = address

    def each(self, work: Callable[..., Result], tasks: Sequence[Arguments]) -> Iterator[tuple[int, Result]]:
        """See `Executor`. Raises RigError also if the scheduler is lost."""
        from distributed import wait as wait_for
        from distributed.client import FuturesCancelledError

        expected, running = dict(program()), dict[Any, int]()
        try:
            for index, task in enumerate(tasks):
                key = f"run-{index}-{uuid.uuid4().hex}"
                running[self._client.submit(_do, work, expected, task, key=key, pure=False)] = index
            while running:
                with suppress(TimeoutError, FuturesCancelledError), self._client.as_current():
                    wait_for(list(running), timeout=POLL_S, return_when="FIRST_COMPLETED")
                if self._client.status != "running":
                    raise self._lost()
                for future in [future for future in running if future.status not in ("pending", "lost")]:
                    yield running.pop(future), self._outcome(future)
        finally:
            if running and self._client.status == "running":
                with suppress(Exception):  # another error is on its way already
                    self._client.cancel(list(running), force=True)

    def _outcome(self, future: Any) -> Any:
        """The result of a task. Raises what the task raised, and RigError when the scheduler does not know it."""
        from distributed import KilledWorker

        try:
            return future.result()
        except KilledWorker:
            raise RigError(TOO_MANY_DEATHS) from None
        except CancelledError:
            raise self._lost() from None
        except OSError:  # from the connection, or from the work
            if future.status == "error":
                raise
            raise self._lost() from None

    def _lost(self) -> RigError:
        return RigError(f"the scheduler at {self._address} does not answer any more")


def _do(work: Callable[..., Any], expected: Mapping[str, str], task: Arguments) -> Any:
    """Do one task on a worker. The check is for workers that came after the first check."""
    if other := program_mismatch(expected, program()):
        raise InputError(f"--dask: worker {platform.node()}:{os.getpid()} would not compute the same: it has {other}")
    with _one_at_a_time:
        return alone(work, task)


def alone(work: Callable[..., Result], task: Arguments) -> Result:
    """Do one task with one thread for linear algebra. The threads of many workers would compete for the cores, and a
    sum that is split among threads differs in its last bits."""
    with threadpool_limits(limits=1):
        return work(*task)


def _begin() -> None:
    """Set up a new worker process. A terminal sends Ctrl-C to all processes; the first process ends the others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
