"""Compiled work that releases Python's lock, on all cores."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


@cache
def _pool() -> ThreadPoolExecutor:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return ThreadPoolExecutor(int(os.environ.get("OMP_NUM_THREADS") or cores), "side-by-side")


def side_by_side(function: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """function(item) of each item, in order. As many at once as there are cores, or as OMP_NUM_THREADS says."""
    return list(_pool().map(function, items))
