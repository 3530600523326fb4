"""The interface of everything that does independent pieces of work: this process, other processes, or Dask.

`each(work, tasks)` calls work(*task) for every task and yields (index, result) as the tasks end, in any order. An
exception of `work` ends it. The task of a process that dies is done again in another one. A task whose process died
MOST_DEATHS times is given up; its result is `Lost`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

MOST_DEATHS = 3  # of processes for one task

Result = TypeVar("Result")
Value = TypeVar("Value")
Arguments = tuple[Any, ...]  # of `work`, for one task


@dataclass(frozen=True)
class Lost:
    """In place of a result: the process died so many times during the task."""

    deaths: int


class Executor(Protocol):
    """Does independent pieces of work. apart: in other processes."""

    apart: bool

    def share(self, value: Value) -> Value:
        """Prepare a large value that many tasks have in common: put the returned one into them, and it travels once."""
        ...

    def each(self, work: Callable[..., Result], tasks: Sequence[Arguments]) -> Iterator[tuple[int, Result | Lost]]:
        """(index, work(*task)) of all tasks as they end."""
        ...
