"""The messages about the workers of a Dask scheduler, and the address of one."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from mazeplan.core.errors import InputError, RigError
from mazeplan.run.campaign import dask_cluster as daskcluster

pytest.importorskip("distributed")


class Deserted:
    """A client without workers from 10 s to 30 s by the test's clock, and again from 40 s; each look takes a second."""

    clock = 0.0

    @property
    def status(self) -> str:
        self.clock += 1.0
        return "running"

    def nthreads(self) -> dict[str, int]:
        return {} if 10.0 <= self.clock < 30.0 or self.clock >= 40.0 else {"tcp://worker": 1}

    def submit(self, *given, **more):
        return SimpleNamespace(add_done_callback=lambda call: None)


def test_missing_workers_give_a_warning_within_seconds_and_an_error_in_the_end(monkeypatch):
    monkeypatch.setattr(daskcluster, "POLL_S", 1e-4)
    client, said = Deserted(), []
    monkeypatch.setattr(daskcluster, "monotonic", lambda: client.clock)
    dask = daskcluster.Dask(client, "tcp://there:1", lambda words: said.append((client.clock, words)))
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
