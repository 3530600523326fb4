"""Work on all cores."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from mazeplan.core.side_by_side import beside, in_processes, side_by_side

THREADS = """
import threading
from mazeplan.core.side_by_side import beside, side_by_side
meet = threading.Barrier(3)
print(sum(side_by_side(lambda _: meet.wait(20.0) >= 0, range(3))))
"""


@pytest.mark.parametrize("each", [side_by_side, in_processes])
def test_results_come_in_order_and_errors_are_passed_on(each):
    assert each(lambda i: i * i, range(50)) == [i * i for i in range(50)]
    with pytest.raises(ZeroDivisionError):
        each(lambda i: 1 / i, [1, 0])


def test_omp_num_threads_says_how_many_at_once(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert subprocess.check_output([sys.executable, "-c", THREADS], text=True) == "3\n"


@pytest.mark.skipif(sys.platform != "linux", reason="the process is copied on Linux only")
def test_copies_of_the_process_work_and_are_waited_for(tmp_path: Path):
    program = f"""
import os, pathlib
from mazeplan.core import side_by_side
side_by_side._cores = lambda: 2
os.environ["OMP_NUM_THREADS"] = "2"
kept = pathlib.Path({str(tmp_path / "kept")!r})
with side_by_side.beside(lambda: kept.write_text(str(os.getpid()))):
    own = os.getpid()
print(int(kept.read_text()) != own)
found = side_by_side.in_processes(lambda i: (i, 1 // i if os.getpid() != own else os.getpid()), [1, 2, 3, 0])
print([number for number, _ in found], [value == own for _, value in found])
"""
    assert (
        subprocess.check_output([sys.executable, "-W", "error", "-c", program], text=True)
        == "True\n[1, 2, 3, 0] [True, False, True, True]\n"
    )


def test_work_beside_is_left_out_on_one_core(monkeypatch):
    monkeypatch.setattr("mazeplan.core.side_by_side._cores", lambda: 1)
    done: list[int] = []
    with beside(lambda: done.append(1)):
        pass
    assert done == []
