"""Which worker of Dask gets what: nobody is without work while another has some in store."""

from __future__ import annotations

import random
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import pytest

from mazeplan.campaign import daskcluster

pytest.importorskip("distributed")


class Workers:
    """What a Dask client shows of workers that do one lot after the other, by a clock of their own: each time it is
    asked how it is, the lot that ends next has ended. Task k takes seconds[k]. Who is not told where a lot goes has it
    where the fewest are."""

    def __init__(self, number: int, seconds: list[float]) -> None:
        self.now = 0.0
        self.ends = {f"tcp://worker-{k}": 0.0 for k in range(number)}  # s, of all that each was given
        self.sizes: list[int] = []  # of lots
        self._seconds = seconds
        self._running: list[tuple[float, str, Future[Any], tuple[float, list[int]]]] = []

    @property
    def status(self) -> str:
        if self._running:
            self._running.sort(key=lambda lot: lot[0])
            self.now, _, future, result = self._running.pop(0)
            future.set_result(result)
        return "running"

    def nthreads(self) -> dict[str, int]:
        return dict.fromkeys(self.ends, 1)

    def submit(
        self, do: Callable[..., Any], *given: Any, key: str, workers: str | None = None, **_: Any
    ) -> Future[Any]:
        tasks = [index for (index,) in given[-1]]
        places = [place for _, place, *_ in self._running]
        where = workers or min(self.ends, key=places.count)
        took = sum(self._seconds[index] for index in tasks)
        self.ends[where] = max(self.ends[where], self.now) + took
        future: Any = Lot(key)
        self._running.append((self.ends[where], where, future, (took, tasks)))
        self.sizes.append(len(tasks))
        return future


class Lot(Future):
    """A future as Dask has it."""

    status = "finished"

    def __init__(self, key: str) -> None:
        super().__init__()
        self.key = key


@pytest.mark.parametrize("number", [1, 2, 3, 16])
@pytest.mark.parametrize("seed", range(5))
def test_all_workers_end_at_about_the_same_time(number, seed, monkeypatch):
    monkeypatch.setattr(daskcluster, "POLL_S", 1e-3)
    rng = random.Random(seed)
    seconds = [rng.uniform(0.15, 0.4) for _ in range(100)]
    workers = Workers(number, seconds)
    found = dict(daskcluster.Dask(workers, "here").each(lambda index: index, [(index,) for index in range(100)]))
    assert found == {index: index for index in range(100)}
    assert max(workers.sizes) > 1 or number == 16  # short tasks travel together
    assert max(workers.ends.values()) - min(workers.ends.values()) <= max(seconds)
