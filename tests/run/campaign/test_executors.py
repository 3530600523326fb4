"""Work in this process and in others: everything is done once, and whoever dies takes nothing with it."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from campaign_work import deadly, mine, refuse, square, wait_long
from soon import soon
from threadpoolctl import threadpool_info, threadpool_limits

from mazeplan.core.errors import InputError, RigError
from mazeplan.run.campaign.executor import InProcess, Processes, open_executor


@pytest.fixture(scope="module")
def pair():
    with open_executor(2) as executor:
        yield executor


def tries(notes: Path) -> dict[str, int]:
    """{task: how often it was begun}."""
    first = [line.split()[0] for line in notes.read_text().splitlines()]
    return {name: first.count(name) for name in first}


def test_one_worker_is_this_process():
    with open_executor(1) as executor:
        assert isinstance(executor, InProcess)
        assert dict(executor.each(square, [(2.0,), (3.0,)])) == {0: 4.0, 1: 9.0}


def test_two_processes_do_everything_once(pair):
    assert isinstance(pair, Processes)
    assert dict(pair.each(square, [(float(x),) for x in range(9)])) == {x: float(x * x) for x in range(9)}


def test_work_of_a_process_that_dies_is_done_again(pair, tmp_path):
    notes = tmp_path / "notes"
    notes.touch()
    tasks = [(2 if x == 1 else 0, str(notes), x) for x in range(5)]
    assert dict(pair.each(deadly, tasks)) == {x: x for x in range(5)}
    assert tries(notes)["1"] == 3


def test_work_that_ends_its_process_again_and_again_ends(pair, tmp_path):
    notes = tmp_path / "notes"
    notes.touch()
    with pytest.raises(RigError):
        list(pair.each(deadly, [(99, str(notes), 0)]))


def test_what_work_raises_comes_out(pair):
    with pytest.raises(ValueError, match="two"):
        list(pair.each(refuse, [(x,) for x in range(4)]))
    assert dict(pair.each(refuse, [(5,)])) == {0: 5}  # and others may follow


def test_leaving_early_ends_the_workers(tmp_path):
    notes = tmp_path / "ended"
    with open_executor(2) as executor:
        pids = {pid for _, (_, pid) in executor.each(mine, [(x,) for x in range(10)])}
        going = executor.each(wait_long, [(str(notes), 0), (str(notes), 1), (str(notes), 2)])
        assert next(going) == (0, 0)
        going.close()
    assert pids
    assert os.getpid() not in pids
    assert soon(lambda: not any(map(running, pids)))


def running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_linear_algebra_has_one_thread_while_work_is_done():
    np.ones(1) @ np.ones(1)
    with threadpool_limits(2):
        (threads,) = {threads for _, threads in InProcess().each(blas_threads, [()])}
    assert threads == 1


def blas_threads() -> int:
    return max(info["num_threads"] for info in threadpool_info() if info["user_api"] == "blas")


def test_workers_of_a_scheduler_are_as_many_as_they_are():
    expected = r"--workers: got 3 with --dask tcp://127\.0\.0\.1:1"
    with pytest.raises(InputError, match=expected), open_executor(3, "tcp://127.0.0.1:1"):
        pass
