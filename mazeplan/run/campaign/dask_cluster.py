"""An executor that uses the workers of a Dask scheduler. Only this file imports dask and distributed.

If a worker dies, Dask does its tasks again elsewhere. After too many deaths the work ends with RigError. Workers read
the user's files at the same paths as this process: give them a folder that all machines share.
"""

from __future__ import annotations

import logging
import os
import platform
import threading
import uuid
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING, Any

from mazeplan.core.errors import InputError, RigError
from mazeplan.core.progress import Words
from mazeplan.core.resources import to_install
from mazeplan.run.campaign.executor import MOST_DEATHS, TOO_MANY_DEATHS, Arguments, Executor, Result, alone
from mazeplan.run.campaign.store import program, program_mismatch

if TYPE_CHECKING:
    from distributed import Client

CONNECT_S = 5.0  # s within which a scheduler must answer
WORKERS_S = 10.0  # s within which the first worker must come
POLL_S = 1.0  # s between looks for the scheduler while no task ends
QUIET = ("distributed", "distributed.client", "tornado.application")  # their messages are for who runs the cluster
SETTINGS = {
    "distributed.comm.timeouts.connect": CONNECT_S,
    "distributed.scheduler.allowed-failures": MOST_DEATHS - 1,
    "distributed.admin.large-graph-warning-threshold": 1 << 30,
}
_one_at_a_time = threading.Lock()  # a process does one run at a time


@contextmanager
def dask_executor(address: str, say: Words) -> Iterator[Executor]:
    """An executor with the workers of a scheduler. Raises as `executor.open_executor`."""
    try:
        import distributed
        from dask import config
        from distributed.versions import VersionMismatchWarning
    except ImportError:
        raise InputError(f"--dask needs dask and distributed: {to_install('campaign')}") from None
    with ExitStack() as stack:
        stack.enter_context(config.set(SETTINGS))
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
        yield Dask(client, address)


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
        self._client, self._address = client, address

    def each(self, work: Callable[..., Result], tasks: Sequence[Arguments]) -> Iterator[tuple[int, Result]]:
        """See `Executor`. Raises RigError also if the scheduler is lost."""
        from distributed import wait
        from distributed.client import FuturesCancelledError

        expected, running = dict(program()), dict[Any, int]()
        try:
            for index, task in enumerate(tasks):
                key = f"run-{index}-{uuid.uuid4().hex}"
                running[self._client.submit(_do, work, expected, task, key=key, pure=False)] = index
            while running:
                with suppress(TimeoutError, FuturesCancelledError), self._client.as_current():
                    wait(list(running), timeout=POLL_S, return_when="FIRST_COMPLETED")
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
