"""An executor that uses the workers of a Dask scheduler. Only this file imports dask and distributed.

Dask chooses the worker of each task. If a worker dies, Dask does its tasks again elsewhere. After too many deaths Dask
gives up every task of these workers, also tasks that did not cause a death. Each such task is tried once more, alone.
"""

from __future__ import annotations

import logging
import math
import os
import platform
import queue
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
from mazeplan.run.campaign.processes import interrupts_held, one_thread
from mazeplan.run.campaign.tasks import MOST_DEATHS, Arguments, Executor, Lost, Result, Value
from mazeplan.run.campaign.versions import program, program_mismatch

if TYPE_CHECKING:
    from distributed import Client, Future

LOOPBACK = "127.0.0.1"
CONNECT_S = 5.0  # s within which a scheduler must answer
WORKERS_S = 10.0  # s within which the first worker must come
WARN_S = 4.0  # s without any worker before a warning
ALONE_S = 60.0  # s without any worker before an error
POLL_S = 1.0  # s between looks for workers while no task ends
COUNT_S = 2.0  # s between two counts of the workers
PROTOCOLS = ("tcp", "tls", "ws", "wss", "ucx")
LARGE = 1 << 30  # bytes; files of a user may be larger than the default limit of Dask's warning
_one_at_a_time = threading.Lock()  # a process does one run at a time


@contextmanager
def dask_executor(address: str | None, workers: int | None, carry: Sequence[Any], say: Words) -> Iterator[Executor]:
    """An executor with the workers of a scheduler. address: None: start a cluster on this machine. Raises as
    `executor.open_executor`."""
    try:
        import cloudpickle
        import distributed
    except ImportError:
        raise InputError(f"--dask needs dask and distributed: {to_install('campaign')}") from None
    with ExitStack() as stack:
        stack.enter_context(_silence())
        stack.enter_context(_settings())
        target = stack.enter_context(_own_cluster(workers)) if address is None else _checked(address)
        address = address or "local"
        try:
            client = stack.enter_context(distributed.Client(target, timeout=CONNECT_S, set_as_default=False))
        except (OSError, ValueError, TypeError, ImportError) as problem:
            raise InputError(f"--dask: got {address}: no scheduler answers there: {_line(problem)}") from None
        for module in carry:
            cloudpickle.register_pickle_by_value(module)
        _check_workers(client, address, say)
        say(_dashboard(client))
        yield Dask(client, address, say)


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


def _settings() -> Any:
    from dask import config

    return config.set(
        {
            "distributed.comm.timeouts.connect": CONNECT_S,
            "distributed.scheduler.allowed-failures": MOST_DEATHS - 1,
            "distributed.admin.large-graph-warning-threshold": LARGE,
            # for workers on this machine: profiling them a hundred times a second takes a tenth of their time
            "distributed.worker.profile.enabled": False,
            "distributed.admin.tick.interval": "1s",
            "distributed.worker.memory.monitor-interval": "1s",
        }
    )


def _checked(address: str) -> str:
    """The address with its protocol: tcp://host:port for host:port. Raises InputError for anything else."""
    full = address if "://" in address else f"tcp://{address}"
    protocol, _, place = full.partition("://")
    host, _, port = place.rpartition(":")
    if not (protocol in PROTOCOLS and host and port.isdecimal() and 0 < int(port) < 65536):
        raise InputError(f"--dask: got {address!r}, expected local or an address such as tcp://scheduler:8786")
    return full


@contextmanager
def _own_cluster(workers: int | None) -> Iterator[Any]:
    """A scheduler and workers on this machine that nobody else can reach."""
    import distributed

    with interrupts_held():
        cluster = distributed.LocalCluster(
            n_workers=workers or _cores(), threads_per_worker=1, processes=True, host=LOOPBACK,
            silence_logs=logging.CRITICAL, dashboard_address=f"{LOOPBACK}:0",
            worker_dashboard_address=f"{LOOPBACK}:0",
        )  # fmt: skip
    with cluster:
        yield cluster


def _cores() -> int:
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _dashboard(client: Client) -> str:
    """A message with the address of Dask's own page."""
    if "dashboard" not in client.scheduler_info()["services"]:
        return "Dask has no dashboard: it is switched off, or the package bokeh is not installed at the scheduler"
    try:
        client.run_on_scheduler(__import__, "bokeh")
    except Exception:  # whatever a scheduler elsewhere raises
        return "Dask has no dashboard: the package bokeh is not installed at the scheduler"
    return f"Dask's dashboard: {client.dashboard_link}"


def _line(problem: BaseException) -> str:
    return " ".join(f"{problem}".split()) or type(problem).__name__


def _check_workers(client: Client, address: str, say: Words) -> None:
    """Raises InputError unless there are workers and all have the same program and packages as this process."""
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
    except TimeoutError:
        start = f"dask worker {address} --nthreads 1"
        raise InputError(f"--dask: the scheduler at {address} has no workers; start some: {start}") from None
    found: Any = client.run(facts, on_error="return")
    for worker, theirs in found.items():
        if isinstance(theirs, BaseException) and "No module named 'mazeplan'" in str(theirs):
            raise InputError(f"--dask: worker {worker} has no mazeplan: install the same one there")
        if isinstance(theirs, BaseException):
            raise InputError(f"--dask: worker {worker} cannot do this: {_line(theirs)}")
        if other := program_mismatch(program(), theirs):
            raise InputError(f"--dask: worker {worker} would not compute the same: it has {other}")
    threads: Any = client.nthreads()
    if many := sum(count > 1 for count in threads.values()):
        more = "worker has" if many == 1 else "workers have"
        say(f"{many} {more} several threads, of which one is used: a run takes its process (dask worker --nthreads 1)")


def facts() -> dict[str, str]:
    """The versions of program and packages on a worker."""
    return dict(program())


class Dask:
    """See `Executor`."""

    apart = True

    def __init__(self, client: Client, address: str, say: Words) -> None:
        self._client, self._address, self._say = client, address, say
        self._counted, self._alone_since, self._warned = -math.inf, math.inf, False

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
        arrived: queue.SimpleQueue[Future] = queue.SimpleQueue()
        name = uuid.uuid4().hex[:8]
        running: dict[Any, tuple[int, Future]] = {}
        expected = dict(program())
        try:
            for index in which:
                key = f"run-{name}-{index}"
                future = self._client.submit(_do, work, expected, tasks[index], key=key, pure=False)
                running[key] = index, future
                future.add_done_callback(arrived.put)
            while running:
                self._count()
                try:
                    future = arrived.get(timeout=POLL_S)
                except queue.Empty:
                    continue
                if future.status in ("pending", "lost"):  # its worker died before the result was fetched
                    future.add_done_callback(arrived.put)
                    continue
                index, _ = running.pop(future.key)
                yield index, self._outcome(future)
        finally:
            if running and self._client.status == "running":
                with suppress(Exception):  # another error is on its way already
                    self._client.cancel([future for _, future in running.values()], force=True)

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

    def _count(self) -> None:
        """Check every COUNT_S that there are workers. Raises RigError after ALONE_S without any."""
        now = monotonic()
        if self._client.status != "running":
            raise self._lost()
        if now - self._counted < COUNT_S:
            return
        try:
            workers: Any = self._client.nthreads()
        except (OSError, TimeoutError):
            raise self._lost() from None
        self._counted = now
        self._alone_since = math.inf if workers else min(self._alone_since, now)
        alone_s = now - self._alone_since
        if not self._warned and alone_s >= WARN_S:
            self._warned = True
            self._say(f"the scheduler at {self._address} has no workers any more; waiting up to {ALONE_S:g} s for one")
        elif self._warned and workers:
            self._warned = False
            self._say("there are workers again")
        if alone_s > ALONE_S:
            raise RigError(f"the scheduler at {self._address} had no workers for {ALONE_S:g} s")

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
