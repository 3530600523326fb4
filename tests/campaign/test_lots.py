"""Which worker of Dask gets what: nobody is without work while another has some in store; and what is said of them."""

from __future__ import annotations

import random
from collections.abc import Callable
from concurrent.futures import Future
from types import SimpleNamespace
from typing import Any

import pytest

from mazeplan.campaign import daskcluster
from mazeplan.errors import InputError, RigError

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
    found = dict(daskcluster.Dask(workers, "here", print).each(lambda index: index, [(index,) for index in range(100)]))
    assert found == {index: index for index in range(100)}
    assert max(workers.sizes) > 1 or number == 16  # short tasks travel together
    assert max(workers.ends.values()) - min(workers.ends.values()) <= max(seconds)


class Deserted(Workers):
    """Workers that are gone from 10 s to 30 s by the test's clock, and again from 40 s; each look takes a second."""

    clock = 0.0

    @property
    def status(self) -> str:
        self.clock += 1.0
        return "running"

    def nthreads(self) -> dict[str, int]:
        gone = 10.0 <= self.clock < 30.0 or self.clock >= 40.0
        return {} if gone else super().nthreads()


def test_that_nobody_works_is_said_within_seconds_and_that_somebody_does_again(monkeypatch):
    monkeypatch.setattr(daskcluster, "POLL_S", 1e-4)
    workers, said = Deserted(2, [1.0] * 9), []
    monkeypatch.setattr(daskcluster, "monotonic", lambda: workers.clock)
    dask = daskcluster.Dask(workers, "tcp://there:1", lambda words: said.append((workers.clock, words)))
    with pytest.raises(RigError, match="tcp://there:1 had no workers for 60 s"):
        list(dask.each(lambda index: index, [(index,) for index in range(9)]))
    gone = "the scheduler at tcp://there:1 has no workers any more; waiting up to 60 s for one"
    assert [words for _, words in said] == [gone, "there are workers again", gone]
    assert [10.0 < said[0][0] <= 17.0, 30.0 <= said[1][0] <= 33.0, 40.0 < said[2][0] <= 47.0] == [True] * 3


def test_a_worker_without_this_program_is_told(monkeypatch):
    without = ModuleNotFoundError("No module named 'mazeplan'")
    client = SimpleNamespace(wait_for_workers=lambda *a, **k: None, run=lambda *a, **k: {"tcp://far:1": without})
    with pytest.raises(InputError, match=r"^--dask: worker tcp://far:1 has no mazeplan: install the same one there$"):
        daskcluster._check_workers(client, "tcp://there:1", print)


@pytest.mark.parametrize("address", ["http://there:8786", "there", "tcp://there", "tcp://:1", "there:x", "a:0"])
def test_what_is_no_address_of_a_scheduler(address):
    with pytest.raises(InputError, match=f"^--dask: got '{address}', expected local or an address such as tcp://"):
        daskcluster._checked(address)
    assert daskcluster._checked("there:8786") == "tcp://there:8786"
