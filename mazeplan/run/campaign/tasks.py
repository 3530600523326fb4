"""The interface of executors, which do independent tasks: in this process, in other processes, or by Dask.

`each(work, tasks)` calls work(*task) for every task and yields (index, result) as the tasks end, in any order. An
exception of `work` ends `each`. If a process dies during a task, another process does the task again. After
MOST_DEATHS deaths the task is given up; its result is `Lost`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

MOST_DEATHS = 3  # maximum number of processes that may die during one task

Result = TypeVar("Result")
Value = TypeVar("Value")
Arguments = tuple[Any, ...]  # arguments of `work` for one task


@dataclass(frozen=True)
class Lost:
    """In place of the result of a task that was given up. deaths: how often a process died during it."""

    deaths: int


class Executor(Protocol):
    """Does independent tasks. apart: whether in other processes."""

    apart: bool

    def share(self, value: Value) -> Value:
        """Prepare a large value that many tasks share. Put the returned value into the tasks: it then travels once."""
        ...

    def each(self, work: Callable[..., Result], tasks: Sequence[Arguments]) -> Iterator[tuple[int, Result | Lost]]:
        """(index, work(*task)) of all tasks as they end."""
        ...
