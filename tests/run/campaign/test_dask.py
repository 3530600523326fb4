"""A real scheduler and real workers on loopback, in a folder that has none of the user's files."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from campaign_work import deadly, mine, refuse

from mazeplan.core.errors import InputError, RigError
from mazeplan.core.records import NavigationResult
from mazeplan.core.resources import share
from mazeplan.run.campaign import dask_cluster as daskcluster
from mazeplan.run.campaign.evaluate import Campaign, evaluate
from mazeplan.run.campaign.executor import Lost, open_executor
from mazeplan.run.campaign.store import open_store, runs_table
from mazeplan.run.campaign.versions import program

RUNS = 12
RIG = """\
from dask_helper import BASE


class FarRig(BASE):
    def __init__(self, maze, settings):
        super().__init__(maze)
"""
ROOT = Path(__file__).resolve().parents[3]

# of the libraries at work: sockets of somebody who was killed
pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")


@dataclass
class Site:
    """Where the scheduler is, and processes."""

    address: str
    scheduler: subprocess.Popen[bytes]
    workers: list[subprocess.Popen[bytes]]


def begin(stack: ExitStack, folder: Path, what: str, *words: str) -> subprocess.Popen[bytes]:
    paths = [str(ROOT), str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")]
    process = subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.dask_{what}", *words, "--no-dashboard"],
        cwd=folder, env={**os.environ, "PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1"},
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    stack.callback(process.wait)
    stack.callback(process.kill)
    return process


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("far")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with ExitStack() as stack:
        process = begin(stack, folder, "scheduler", "--host", "127.0.0.1", "--port", str(port))
        until = time.monotonic() + 60.0
        while time.monotonic() < until:
            with socket.socket() as there:
                if there.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.05)
        yield Site(f"tcp://127.0.0.1:{port}", process, [])


@pytest.fixture(scope="module")
def site(scheduler, tmp_path_factory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("workers")
    with ExitStack() as stack:
        for _ in range(2):
            words = (scheduler.address, "--nthreads", "1", "--no-nanny", "--local-directory", str(folder))
            scheduler.workers.append(begin(stack, folder, "worker", *words))
        yield scheduler


@pytest.fixture(scope="module")
def desk(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("desk")
    (folder / "far_rig.py").write_text(RIG)
    (folder / "dask_helper.py").write_text("from mazeplan.apps.testing.lightrig import LightRig as BASE\n")
    (folder / "far.yaml").write_text("class: far_rig:FarRig\n")
    for kind, name in (("maps", "cme.yaml"), ("behaviors", "navigate.xml")):
        (folder / f"my_{name}").write_text((share(kind) / name).read_text())
    return folder


CAMPAIGN = Campaign(RUNS, "far.yaml", "my_cme.yaml", None, "my_navigate.xml", start=4, deadline=False)


def same(results: list[NavigationResult]) -> list[dict]:
    """All but what the clock on the wall says."""
    return [{**result.json(), "planner_ms": None, "tick_ms": None} for result in results]


def test_a_scheduler_without_workers_is_no_use(scheduler, monkeypatch):
    if scheduler.workers:
        pytest.skip("its workers have been begun by a test that came first")
    monkeypatch.setattr(daskcluster, "WORKERS_S", 0.2)
    with (
        pytest.raises(InputError, match="has no workers; start some: dask worker tcp"),
        open_executor(dask=scheduler.address),
    ):
        pass


def test_where_nobody_listens_is_said_within_seconds(monkeypatch):
    monkeypatch.setattr(daskcluster, "CONNECT_S", 0.5)
    began = time.monotonic()
    with pytest.raises(InputError, match="no scheduler answers there"), open_executor(dask="127.0.0.1:9"):
        pass
    assert time.monotonic() - began < 10.0


@pytest.mark.slow
def test_workers_that_would_compute_something_else_are_refused(site, monkeypatch):
    other = {**program(), "numpy": "1.0"}
    monkeypatch.setattr(daskcluster, "program", lambda: other)
    expected = f"numpy {program()['numpy']} instead of 1.0"
    with pytest.raises(InputError, match=expected), open_executor(dask=site.address):
        pass


def test_what_work_raises_comes_out(site):
    with open_executor(dask=site.address) as executor:
        with pytest.raises(ValueError, match="two"):
            list(executor.each(refuse, [(x,) for x in range(4)]))
        assert dict(executor.each(refuse, [(executor.share(5),)])) == {0: 5}


@pytest.mark.slow
def test_a_killed_worker_loses_nothing_and_then_a_lost_scheduler_only_what_was_under_way(
    site, desk, tmp_path, monkeypatch
):
    monkeypatch.chdir(desk)
    monkeypatch.setattr(sys, "path", [str(desk), *sys.path])
    alone = evaluate(CAMPAIGN)
    words: list[str] = []

    def kill(finished: int) -> None:
        if finished == 4:
            os.kill(site.workers[0].pid, signal.SIGKILL)

    with open_store(tmp_path, CAMPAIGN) as store, open_executor(dask=site.address, say=words.append) as executor:
        assert same(evaluate(CAMPAIGN, executor=executor, store=store, progress=kill)) == same(alone)
    assert site.workers[0].wait() == -signal.SIGKILL
    assert len(words) == 1
    assert "Dask" in words[0]
    table = runs_table(tmp_path)
    assert list(table["index"]) == list(range(RUNS))
    assert f":{site.workers[1].pid}" in {host[host.index(":") :] for host in table["host"]}

    def end(finished: int) -> None:
        if finished == RUNS + 2:
            site.scheduler.kill()

    more = replace(CAMPAIGN, runs=400)
    with open_store(tmp_path, more) as store, open_executor(dask=site.address) as executor:
        assert len(store.results) == RUNS
        with pytest.raises(RigError, match=r"the scheduler at .* does not answer any more"):
            evaluate(more, executor=executor, store=store, progress=end)
    assert len(runs_table(tmp_path)) >= RUNS + 2


@pytest.mark.slow
def test_work_that_ends_its_worker_again_and_again_ends_on_a_cluster_of_ones_own(tmp_path, monkeypatch):
    monkeypatch.setattr(
        daskcluster, "_check_workers", lambda *arguments: None
    )  # which takes a second of processor time
    notes = tmp_path / "notes"
    notes.touch()
    with open_executor(1, "local") as executor:
        done = dict(executor.each(deadly, [(99 if x == 0 else 0, str(notes), x) for x in range(3)]))
    assert done == {0: Lost(3), 1: 1, 2: 2}


@pytest.mark.slow
def test_all_workers_killed_at_once_lose_nothing(monkeypatch):
    """While there is none, the scheduler has nobody to give their work to; then come others under other names."""
    monkeypatch.setattr(daskcluster, "_check_workers", lambda *arguments: None)
    with open_executor(2, "local") as executor:
        first = {pid for _, (_, pid) in executor.each(mine, [(x,) for x in range(40)])}
        assert len(first) == 2
        done: dict[int, int] = {}
        for _, (x, pid) in executor.each(mine, [(x,) for x in range(40)]):
            if not done:
                for worker in first:
                    os.kill(worker, signal.SIGKILL)
            done[x] = pid
    assert sorted(done) == list(range(40))
    assert set(done.values()) - first
