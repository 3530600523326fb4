"""Work on all cores: compiled work in threads, and compiling in a second process."""

from __future__ import annotations

import os
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(int(os.environ.get("OMP_NUM_THREADS") or _cores()), "side-by-side")


def side_by_side(function: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """function(item) of each item, in order. As many at once as there are cores, or as OMP_NUM_THREADS says."""
    return list(_pool().map(function, items))


@contextmanager
def beside(work: Callable[[], None]) -> Iterator[None]:
    """Do `work` in a second process while the body runs; go on when both are done.

    Only what `work` leaves on the disk remains, such as compiled code. Without a second core, or beside other threads,
    which a copy of the process would not have, it is not done."""
    if _cores() < 2 or not hasattr(os, "fork") or threading.active_count() > 1:
        yield
        return
    with warnings.catch_warnings():  # the threads of a library for linear algebra are idle, and it expects a fork
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        try:
            work()
        finally:
            os._exit(0)  # an error shows again where the caller does the same work
    try:
        yield
    finally:
        os.waitpid(child, 0)
