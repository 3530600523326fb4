"""Executors that work in this process, or in several processes on this machine.

Each worker has a thread, which hands tasks to a pool of one process. When this process dies, only its task is lost, and
only its pool is made again. Workers are spawned, because a forked child would inherit locks of threads that it does not
have.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing import connection, resource_tracker
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from typing import Any

from threadpoolctl import ThreadpoolController

from mazeplan.run.campaign.tasks import MOST_DEATHS, Arguments, Executor, Lost, Result, Value

WAKE_S = 1.0  # s, longest wait without a break: on some systems signals do not interrupt a wait
GRACE_S = 3.0  # s that a worker has to level its plate when it must stop
INTERRUPT = {signal.SIGINT}
_at_work = threading.Event()  # in a worker: a task is in progress
_found: list[tuple[int, ThreadpoolController]] = []  # number of modules, and the controller of their libraries


@contextmanager
def one_thread() -> Iterator[None]:
    """A context in which linear algebra uses one thread. The threads of many workers would compete for the cores, and a
    sum that is split among threads differs in its last bits."""
    modules = len(sys.modules)
    if not _found or _found[0][0] != modules:  # the search for loaded libraries takes a while
        _found[:] = [(modules, ThreadpoolController())]
    with _found[0][1].limit(limits=1):
        yield


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Block Ctrl-C in processes and threads that begin in this context, because a terminal sends it to all processes.
    This process gets it afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # else the first new process would start it, and that unblocks Ctrl-C here
    before = signal.pthread_sigmask(signal.SIG_BLOCK, INTERRUPT)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class InProcess:
    """Does one task after the other, in this process."""

    apart = False

    def share(self, value: Value) -> Value:
        """Returns the value itself: it does not travel."""
        return value

    def each(self, work: Callable[..., Result], tasks: Sequence[Arguments]) -> Iterator[tuple[int, Result | Lost]]:
        """See `Executor`."""
        for index, task in enumerate(tasks):
            with one_thread():
                result = work(*task)
            yield index, result


@contextmanager
def in_processes(workers: int) -> Iterator[Executor]:
    """An executor with this number of processes; 1: this process."""
    if workers == 1:
        yield InProcess()
        return
    processes = Processes(workers)
    try:
        yield processes
    finally:
        processes.close()


class _Worker:
    """Does one task at a time in a process; replaces the process when it dies. folder: for files that it unpacks."""

    def __init__(self, folder: str) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._pool: ProcessPoolExecutor | None = None
        self._ended = False
        self.last: Future[Any] = Future()

    def do(self, work: Callable[..., Result], task: Arguments) -> Result | Lost:
        """work(*task); if the process dies, again in a new one. Raises CancelledError once the worker was ended."""
        deaths = 0
        while deaths < MOST_DEATHS:
            try:
                self.last = self._submit(work, task)
                return self.last.result()
            except BrokenProcessPool:
                deaths += 1
                self._discard()
        return Lost(deaths)

    def _submit(self, work: Callable[..., Result], task: Arguments) -> Future[Result]:
        with self._lock:
            if self._ended:
                raise CancelledError
            with interrupts_held():
                if self._pool is not None:
                    with suppress(BrokenProcessPool):  # it died between two tasks
                        return self._pool.submit(_work_in_worker, work, *task)
                context = multiprocessing.get_context("spawn")
                self._pool = ProcessPoolExecutor(1, context, _begin, (self._folder,))
                return self._pool.submit(_work_in_worker, work, *task)

    def _discard(self) -> None:
        with self._lock:
            pool, self._pool = self._pool, None
        if pool is not None:
            pool.shutdown(wait=True)

    def end(self) -> list[Any]:
        """Ask the process to end, and accept no more tasks. Returns the process, if there is one."""
        with self._lock:
            self._ended, pool = True, self._pool
            # a pool has no public way to end its process before Python 3.14
            processes = list((pool._processes or {}).values()) if pool is not None else []
            if pool is not None:
                pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()
        return processes


class Processes:
    """See `Executor`."""

    apart = True

    def __init__(self, workers: int) -> None:
        self._number = workers
        self._threads: ThreadPoolExecutor | None = None  # None: no process has begun
        self._workers: list[_Worker] = []
        self._idle: SimpleQueue[_Worker] = SimpleQueue()
        self._folder: TemporaryDirectory[str] | None = None  # workers end too fast to clear it themselves

    def share(self, value: Value) -> Value:
        """Returns the value itself: through a pipe it travels fast enough."""
        return value

    def each(self, work: Callable[..., Result], tasks: Sequence[Arguments]) -> Iterator[tuple[int, Result | Lost]]:
        """See `Executor`."""
        threads = self._threads or self._start()
        futures = {threads.submit(self._do, work, task): index for index, task in enumerate(tasks)}
        try:
            while futures:
                for future in wait(futures, WAKE_S, FIRST_COMPLETED).done:
                    yield futures.pop(future), future.result()
        finally:
            if futures:
                self.close()

    def _start(self) -> ThreadPoolExecutor:
        self._folder = TemporaryDirectory(prefix="mazeplan-", ignore_cleanup_errors=True)
        self._workers = [_Worker(self._folder.name) for _ in range(self._number)]
        self._idle = SimpleQueue()
        for worker in self._workers:
            self._idle.put(worker)
        self._threads = ThreadPoolExecutor(self._number)
        return self._threads

    def _do(self, work: Callable[..., Result], task: Arguments) -> Result | Lost:
        worker = self._idle.get()
        try:
            return worker.do(work, task)
        finally:
            self._idle.put(worker)

    def close(self) -> None:
        """End the workers, also in the middle of a task: their plates go level first."""
        if self._threads is None or self._folder is None:
            return
        self._threads.shutdown(wait=False, cancel_futures=True)
        going = [worker.last for worker in self._workers if worker.last.running()]
        processes = [process for worker in self._workers for process in worker.end()]
        wait(going, GRACE_S)
        for process in processes:  # at once: the interpreter need not shut down in order
            process.kill()
        connection.wait([process.sentinel for process in processes], GRACE_S)
        self._threads.shutdown(wait=True)
        self._folder.cleanup()
        self._threads = self._folder = None


def _begin(folder: str) -> None:
    """Set up a new worker process."""
    tempfile.tempdir = folder
    ThreadpoolController().limit(limits=1)
    signal.signal(signal.SIGTERM, _end)
    threading.Thread(target=_end_with_parent, args=(folder,), daemon=True).start()


def _work_in_worker(work: Callable[..., Result], *task: Any) -> Result:
    """work(*task), in a worker."""
    _at_work.set()
    try:
        return work(*task)
    finally:
        _at_work.clear()


class _Ended(SystemExit):
    """A signal ended the task; the task itself made no error."""


def _end(number: int, frame: Any) -> None:
    """Handler of SIGTERM. During a task it raises an exception, so that the task ends in order. Otherwise it ends the
    process at once."""
    if not _at_work.is_set():
        os._exit(128 + number)
    raise _Ended(128 + number)


def _end_with_parent(folder: str) -> None:
    """End this worker when its parent process ends, and remove the folder. Otherwise a worker whose parent was killed
    would wait for work for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        with suppress(OSError):
            parent.join()
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(1)
