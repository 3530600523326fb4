"""Work on all cores."""

from __future__ import annotations

import subprocess
import sys

import pytest

from mazeplan.core.side_by_side import side_by_side

THREADS = """
import threading
from mazeplan.core.side_by_side import side_by_side
meet = threading.Barrier(3)
print(sum(side_by_side(lambda _: meet.wait(20.0) >= 0, range(3))))
"""


def test_results_come_in_order():
    assert side_by_side(lambda i: i * i, range(50)) == [i * i for i in range(50)]


def test_an_error_is_passed_on():
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda i: 1 / i, [1, 0])


def test_omp_num_threads_says_how_many_at_once(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert subprocess.check_output([sys.executable, "-c", THREADS], text=True) == "3\n"
