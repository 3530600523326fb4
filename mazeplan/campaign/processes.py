"""Work in processes on this machine.

Each worker is a pool of one process: when it dies it is known whose work it was, no other's is lost with it, and only
this pool is made anew. Workers are spawned: a forked child would inherit locks of threads that do not exist in it.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing import connection, resource_tracker
from tempfile import TemporaryDirectory
from typing import Any

from threadpoolctl import ThreadpoolController

from mazeplan.campaign.executor import MOST_DEATHS, Executor, InProcess, Lost, Result, Value

WAKE_S = 1.0  # s after which waiting looks up, for systems whose waits no signal ends
GRACE_S = 3.0  # s that a worker has to level its plate when it is told to stop
INTERRUPT = {signal.SIGINT}
_found: list[tuple[int, ThreadpoolController]] = []  # number of modules, and what was found then


@contextmanager
def one_thread() -> Iterator[None]:
    """Linear algebra in one thread: so many workers' threads would fight over the cores, and sums that are split among
    threads differ in their last bits."""
    with _thread_pools().limit(limits=1):
        yield


def _thread_pools() -> ThreadpoolController:
    """Those of the libraries that are loaded by now; to look for them takes a while."""
    modules = len(sys.modules)
    if not _found or _found[0][0] != modules:
        _found[:] = [(modules, ThreadpoolController())]
    return _found[0][1]


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Processes and threads that are begun here never see Ctrl-C, which a terminal sends to all; this one sees it
    afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # else the first process that is begun would have it unblock them here
    before = signal.pthread_sigmask(signal.SIG_BLOCK, INTERRUPT)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def in_processes(workers: int) -> Iterator[Executor]:
    """Work in so many processes; one: in this."""
    if workers == 1:
        yield InProcess()
        return
    pools = Processes(workers)
    try:
        yield pools
    finally:
        pools.close()


class Processes:
    """See `Executor`."""

    apart = True

    def __init__(self, workers: int) -> None:
        self._pools: list[ProcessPoolExecutor | None] = [None] * workers
        self._folder: TemporaryDirectory[str] | None = None  # for what workers unpack: they are ended too fast to tidy
        self._last: dict[int, Future[Any]] = {}

    def share(self, value: Value) -> Value:
        """The same: through a pipe it travels fast enough."""
        return value

    def each(
        self, work: Callable[..., Result], tasks: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Result | Lost]]:
        """See `Executor`."""
        waiting = deque((index, 0) for index in range(len(tasks)))
        idle = list(range(len(self._pools)))[::-1]
        running: dict[Future[Result], tuple[int, int, int]] = {}  # task, deaths until now, pool
        try:
            while True:
                while waiting and idle:
                    (index, deaths), pool = waiting.popleft(), idle.pop()
                    running[self._submit(pool, work, tasks[index])] = (index, deaths, pool)
                if not running:
                    return
                ended: list[tuple[int, Result | Lost]] = []
                for future in wait(running, WAKE_S, FIRST_COMPLETED).done:
                    index, deaths, pool = running.pop(future)
                    idle.append(pool)
                    try:
                        ended.append((index, future.result()))
                    except BrokenProcessPool:
                        self._discard(pool)
                        if deaths + 1 < MOST_DEATHS:
                            waiting.appendleft((index, deaths + 1))
                        else:
                            ended.append((index, Lost(deaths + 1)))
                while waiting and idle and ended:  # nobody waits while what has ended is taken in
                    (index, deaths), pool = waiting.popleft(), idle.pop()
                    running[self._submit(pool, work, tasks[index])] = (index, deaths, pool)
                yield from ended
        finally:
            if running:
                self.close()

    def _submit(self, number: int, work: Callable[..., Result], task: tuple[Any, ...]) -> Future[Result]:
        pool = self._pools[number]
        if pool is not None:
            try:
                future = pool.submit(work, *task)
            except BrokenProcessPool:  # it died while it had nothing to do
                self._discard(number)
            else:
                self._last[number] = future
                return future
        if self._folder is None:
            self._folder = TemporaryDirectory(prefix="mazeplan-", ignore_cleanup_errors=True)
        context, given = multiprocessing.get_context("spawn"), (self._folder.name,)
        pool = self._pools[number] = ProcessPoolExecutor(1, context, _begin, given)
        with interrupts_held():
            future = self._last[number] = pool.submit(work, *task)
        return future

    def _discard(self, number: int) -> None:
        pool, self._pools[number] = self._pools[number], None
        if pool is not None:
            pool.shutdown(wait=True)

    def close(self) -> None:
        """End the workers, those that are in the midst of something, too: their plates go level first."""
        pools = [pool for pool in self._pools if pool is not None]
        self._pools = [None for _ in self._pools]
        # a pool has no public way to end its process before Python 3.14
        processes = [process for pool in pools for process in (pool._processes or {}).values()]
        going = [future for future in self._last.values() if future.running()]
        for pool in pools:
            pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()
        wait(going, GRACE_S)
        for process in processes:  # at once: to take an interpreter down in order takes a while, and nobody has of it
            process.kill()
        for process in processes:
            connection.wait([process.sentinel], GRACE_S)
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None


def _begin(folder: str) -> None:
    """What a worker does first."""
    tempfile.tempdir = folder
    ThreadpoolController().limit(limits=1)
    signal.signal(signal.SIGTERM, _end)
    threading.Thread(target=_end_with_parent, args=(folder,), daemon=True).start()


class _Ended(SystemExit):
    """By a signal: no doing of the leaf that happened to run."""


def _end(number: int, frame: Any) -> None:
    """As an exception, so that what is under way is put away in order."""
    raise _Ended(128 + number)


def _end_with_parent(folder: str) -> None:
    """A worker whose parent was killed would wait for work for ever, and nobody would clear the folder away."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        with suppress(OSError):
            parent.join()
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(1)
