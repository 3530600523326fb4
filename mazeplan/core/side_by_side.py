"""Work on all cores: compiled work in threads, and the work of Python in copies of this process."""

from __future__ import annotations

import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing import Pipe
from multiprocessing.connection import wait
from operator import itemgetter
from typing import Any, TypeVar

T = TypeVar("T")
R = TypeVar("R")


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _at_once() -> int:
    return int(os.environ.get("OMP_NUM_THREADS") or _cores())


def side_by_side(function: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """function(item) of each item, in order, for compiled work. As many at once as there are cores, or as
    OMP_NUM_THREADS says."""
    with ThreadPoolExecutor(_at_once(), "side-by-side") as pool:
        return list(pool.map(function, items))


def in_copies(function: Callable[[T], R], items: Sequence[T]) -> Iterator[tuple[int, R]]:
    """(index, function(item)) of all items as they end, for the work of Python.

    Copies of this process do a part of it, as many at once as in `side_by_side`; of what they do, only the results
    remain. What a copy cannot do, as after an error, this process does at the end."""
    count = min(_at_once(), len(items)) if _may_fork(daemons=True) else 1
    readers, children = list[Any](), list[int]()
    missing = dict(enumerate(items))

    def arrived(timeout: float | None) -> Iterator[tuple[int, R]]:
        ready: list[Any] = wait(readers, timeout) if readers else []
        for reader in ready:
            try:
                j, result = reader.recv()
            except EOFError:
                readers.remove(reader)
                continue
            del missing[j]
            yield j, result

    try:
        for k in range(1, count):
            reader, writer = Pipe(duplex=False)
            mine = range(k, len(items), count)
            children.append(_fork(lambda to=writer, mine=mine: [to.send((i, function(items[i]))) for i in mine]))
            readers.append(reader)
            writer.close()
        for i in range(0, len(items), count):
            yield i, function(missing.pop(i))
            yield from arrived(0.0)
        while readers:
            yield from arrived(None)
        for i, item in missing.items():
            yield i, function(item)
    finally:
        for child in children:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)


def in_processes(function: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """function(item) of each item, in order; see `in_copies`."""
    return [result for _, result in sorted(in_copies(function, items), key=itemgetter(0))]


def _may_fork(daemons: bool) -> bool:
    """Whether a copy of this process can work: on Linux (libraries of macOS may not be copied), with a second core, and
    without other threads, which the copy would not have.

    daemons: a thread of the background, such as that of a progress bar, may be left behind"""
    others = [thread for thread in threading.enumerate() if thread is not threading.current_thread()]
    alone = all(thread.daemon for thread in others) if daemons else not others
    return _cores() > 1 and sys.platform == "linux" and alone


def _fork(work: Callable[[], object]) -> int:
    """The number of a copy of this process that does some work and ends."""
    with warnings.catch_warnings():  # the threads of a library for linear algebra are idle, and it expects a fork
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        try:
            work()
        finally:
            os._exit(0)  # an error shows again where the caller does the same work
    return child


@contextmanager
def beside(work: Callable[[], None]) -> Iterator[None]:
    """Do `work` in a copy of this process while the body runs; go on when both are done.

    Only what `work` leaves on the disk remains, such as compiled code."""
    if not _may_fork(daemons=False):
        yield
        return
    child = _fork(work)
    try:
        yield
    finally:
        os.waitpid(child, 0)
