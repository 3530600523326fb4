"""An executor that uses the workers of a Dask scheduler. Only this file imports dask and distributed.

If a worker dies, Dask does its tasks again elsewhere. After too many deaths Dask gives up every task of these workers,
also tasks that did not cause a death. Each such task is tried once more, alone.
"""

from __future__ import annotations

import logging
import math
import os
import platform
import threading
import uuid
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from time import monotonic
from typing import TYPE_CHECKING, Any

from mazeplan.core.errors import InputError, RigError
from mazeplan.core.progress import Words
from mazeplan.core.resources import to_install
from mazeplan.run.campaign.executor import MOST_DEATHS, Arguments, Executor, Lost, Result, Value, one_thread
from mazeplan.run.campaign.versions import program, program_mismatch

if TYPE_CHECKING:
    from distributed import Client, Future

LOOPBACK = "127.0.0.1"
CONNECT_S = 5.0  # s within which a scheduler must answer
WORKERS_S = 10.0  # s within which the first worker must come
ALONE_S = 60.0  # s without any worker before an error
POLL_S = 1.0  # s between looks for workers while no task ends
PROTOCOLS = ("tcp", "tls", "ws", "wss", "ucx")
SETTINGS = {
    "distributed.comm.timeouts.connect": CONNECT_S,
    "distributed.scheduler.allowed-failures": MOST_DEATHS - 1,
    "distributed.admin.large-graph-warning-threshold": 1 << 30,  # bytes; a user's files may be large
    # for workers on this machine: profiling them a hundred times a second takes a tenth of their time
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.worker.memory.monitor-interval": "1s",
}
_one_at_a_time = threading.Lock()  # a process does one run at a time


@contextmanager
def dask_executor(address: str | None, workers: int | None, carry: Sequence[Any], say: Words) -> Iterator[Executor]:
    """An executor with the workers of a scheduler. address: None: start a cluster on this machine. Raises as
    `executor.open_executor`."""
    try:
        import cloudpickle
        import distributed
        from dask import config
    except ImportError:
        raise InputError(f"--dask needs dask and distributed: {to_install('campaign')}") from None
    elsewhere = address is not None
    with ExitStack() as stack:
        stack.enter_context(_silence())
        stack.enter_context(config.set(SETTINGS))
        target: Any = _checked(address) if address is not None else stack.enter_context(_own_cluster(workers))
        address = address or "local"
        try:
            client = stack.enter_context(distributed.Client(target, timeout=CONNECT_S, set_as_default=False))
        except (OSError, ValueError, TypeError, ImportError) as problem:
            raise InputError(f"--dask: got {address}: no scheduler answers there: {_line(problem)}") from None
        for module in carry:
            cloudpickle.register_pickle_by_value(module)
        _check_workers(client, address)
        say(f"Dask's dashboard: {client.dashboard_link}")
        yield Dask(client, address, say, elsewhere)


@contextmanager
def _silence() -> Iterator[None]:
    """A context without the messages of Dask, which are for the operator of a cluster."""
    from distributed.versions import VersionMismatchWarning

    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] in ("distributed", "tornado")]
    before = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", VersionMismatchWarning)  # `_check_workers` checks what matters
            yield
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)


def _checked(address: str) -> str:
    """The address with its protocol: tcp://host:port for host:port. Raises InputError for anything else."""
    full = address if "://" in address else f"tcp://{address}"
    protocol, _, place = full.partition("://")
    host, _, port = place.rpartition(":")
    if not (protocol in PROTOCOLS and host and port.isdecimal() and 0 < int(port) < 65536):
        raise InputError(f"--dask: got {address!r}, expected local or an address such as tcp://scheduler:8786")
    return full


def _own_cluster(workers: int | None) -> Any:
    """A scheduler and workers on this machine that nobody else can reach."""
    import distributed

    return distributed.LocalCluster(
        n_workers=workers or _cores(), threads_per_worker=1, processes=True, host=LOOPBACK,
        silence_logs=logging.CRITICAL, dashboard_address=f"{LOOPBACK}:0", worker_dashboard_address=f"{LOOPBACK}:0",
    )  # fmt: skip


def _cores() -> int:
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


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

    def __init__(self, client: Client, address: str, say: Words, elsewhere: bool) -> None:
        self._client, self._address, self._say, self.elsewhere = client, address, say, elsewhere

    def share(self, value: Value) -> Value:
        """The value as the result of a task: if its worker dies, the scheduler does this task again."""
        shared: Any = self._client.submit(_itself, value, key=f"shared-{uuid.uuid4().hex}", pure=False)
        return shared

    def each(self, work: Callable[..., Result], tasks: Sequence[Arguments]) -> Iterator[tuple[int, Result | Lost]]:
        """See `Executor`. Raises RigError if the scheduler is lost, or if there have been no workers for ALONE_S."""
        suspects: list[int] = []
        for index, result in self._each(work, tasks, range(len(tasks))):
            if isinstance(result, Lost):
                suspects.append(index)
            else:
                yield index, result
        for index in suspects:  # alone: another task may have killed its workers
            yield from self._each(work, tasks, [index])

    def _each(
        self, work: Callable[..., Result], tasks: Sequence[Arguments], which: Sequence[int]
    ) -> Iterator[tuple[int, Result | Lost]]:
        from distributed import wait
        from distributed.client import FuturesCancelledError

        expected, running = dict(program()), dict[Any, int]()
        seen = monotonic()  # when there was a worker last
        try:
            for index in which:
                key = f"run-{index}-{uuid.uuid4().hex}"
                running[self._client.submit(_do, work, expected, tasks[index], key=key, pure=False)] = index
            while running:
                # the wait ends with cancelled tasks if the scheduler is lost: the check of the workers says so
                with suppress(TimeoutError, FuturesCancelledError), self._client.as_current():
                    wait(list(running), timeout=POLL_S, return_when="FIRST_COMPLETED")
                seen = self._checked_workers(seen)
                for future in [future for future in running if future.status not in ("pending", "lost")]:
                    yield running.pop(future), self._outcome(future)
        finally:
            if running and self._client.status == "running":
                with suppress(Exception):  # another error is on its way already
                    self._client.cancel(list(running), force=True)

    def _outcome(self, future: Future) -> Any:
        """The result of a task. Raises what the task raised, and RigError when the scheduler does not know it."""
        from distributed import KilledWorker

        try:
            return future.result()
        except KilledWorker as killed:
            return Lost(killed.allowed_failures + 1)
        except CancelledError:
            raise self._lost() from None
        except OSError:  # from the connection, or from the work
            if future.status == "error":
                raise
            raise self._lost() from None

    def _checked_workers(self, seen: float) -> float:
        """When there was a worker last. Raises RigError if this was ALONE_S ago, or if the scheduler is lost."""
        if self._client.status != "running":
            raise self._lost()
        now = monotonic()
        if self._client.scheduler_info()["workers"]:
            return now
        if math.isclose(seen, now, abs_tol=POLL_S):
            self._say(f"the scheduler at {self._address} has no workers; waiting up to {ALONE_S:g} s for one")
        if now - seen > ALONE_S:
            raise RigError(f"the scheduler at {self._address} had no workers for {ALONE_S:g} s")
        return seen

    def _lost(self) -> RigError:
        return RigError(f"the scheduler at {self._address} does not answer any more")


def _itself(value: Any) -> Any:
    return value


def _do(work: Callable[..., Any], expected: Mapping[str, str], task: Arguments) -> Any:
    """Do one task on a worker. The check is for workers that came after the first check."""
    if other := program_mismatch(expected, program()):
        raise InputError(f"--dask: worker {platform.node()}:{os.getpid()} would not compute the same: it has {other}")
    with _one_at_a_time, one_thread():
        return work(*task)
