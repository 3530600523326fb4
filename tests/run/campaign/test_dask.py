"""A real scheduler and real workers on loopback."""

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
from campaign_work import refuse

from mazeplan.core.errors import InputError, RigError
from mazeplan.core.records import NavigationResult
from mazeplan.run.campaign import executor as executors
from mazeplan.run.campaign.executor import open_executor
from mazeplan.run.campaign.one_run import Campaign
from mazeplan.run.campaign.store import open_stores, program, runs_table
from mazeplan.run.commands.evaluate import results_of

RUNS = 12
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


CAMPAIGN = Campaign(runs=RUNS, rig="mazeplan.apps.testing.lightrig:LightRig", start=4, deadline=False)


def same(results: list[NavigationResult]) -> list[dict]:
    """All but what the clock on the wall says."""
    return [{**result.json(), "planner_ms": None, "tick_ms": None} for result in results]


def test_a_scheduler_without_workers_is_no_use(scheduler, monkeypatch):
    if scheduler.workers:
        pytest.skip("its workers have been begun by a test that came first")
    monkeypatch.setattr(executors, "WORKERS_S", 0.2)
    with (
        pytest.raises(InputError, match="has no workers; start some: dask worker tcp"),
        open_executor(dask=scheduler.address),
    ):
        pass


@pytest.mark.slow
def test_workers_that_would_compute_something_else_are_refused(site, monkeypatch):
    other = {**program(), "numpy": "1.0"}
    monkeypatch.setattr(executors, "program", lambda: other)
    expected = f"numpy {program()['numpy']} instead of 1.0"
    with pytest.raises(InputError, match=expected), open_executor(dask=site.address):
        pass


def test_what_work_raises_comes_out(site):
    with open_executor(dask=site.address) as executor:
        with pytest.raises(ValueError, match="two"):
            list(executor.each(refuse, [(x,) for x in range(4)]))
        assert dict(executor.each(refuse, [(5,)])) == {0: 5}


@pytest.mark.slow
def test_a_killed_worker_loses_nothing_and_then_a_lost_scheduler_only_what_was_under_way(site, tmp_path):
    alone = results_of(CAMPAIGN)

    def kill(finished: int) -> None:
        if finished == 4:
            os.kill(site.workers[0].pid, signal.SIGKILL)

    with open_stores(tmp_path, [CAMPAIGN]) as (store,), open_executor(dask=site.address) as executor:
        assert same(results_of(CAMPAIGN, executor=executor, store=store, progress=kill)) == same(alone)
    assert site.workers[0].wait() == -signal.SIGKILL
    table = runs_table(tmp_path)
    assert list(table["index"]) == list(range(RUNS))
    assert f":{site.workers[1].pid}" in {host[host.index(":") :] for host in table["host"]}

    def end(finished: int) -> None:
        if finished == RUNS + 2:
            site.scheduler.kill()

    more = replace(CAMPAIGN, runs=400)
    with open_stores(tmp_path, [more]) as (store,), open_executor(dask=site.address) as executor:
        assert len(store.runs) == RUNS
        with pytest.raises(RigError, match=r"the scheduler at .* does not answer any more"):
            results_of(more, executor=executor, store=store, progress=end)
    assert len(runs_table(tmp_path)) >= RUNS + 2
