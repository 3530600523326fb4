"""When which leaf ran, against the log itself."""

from __future__ import annotations

import numpy as np
import pytest
from report_documents import LEAVES, STEP, a_log

from mazeplan.data.runlog import read_log
from mazeplan.report.timeline import Bar, labels, leaf_bars


def test_intervals_are_those_of_the_statuses(tmp_path):
    track, passing, dither = LEAVES
    bars = [(b.path, b.status, round(b.start, 4), round(b.end, 4)) for b in leaf_bars(read_log(a_log(tmp_path / "a")))]
    last = round(89 * STEP, 4)
    assert bars == [
        (track, "R", 0.0, 1.0), (track, "F", 1.0, 2.0), (track, "R", 2.0, last),
        (dither, "R", 1.0, 2.0), (dither, "S", 2.0, last),
    ]  # fmt: skip
    assert not any(path == passing for path, *_ in bars)  # it was never ticked
    assert not any(path == "Root/Go" for path, *_ in bars)  # no leaf


def test_at_every_tick_a_leaf_runs_that_the_log_says_did(tmp_path):
    log = read_log(a_log(tmp_path / "a"))
    running = [b for b in leaf_bars(log) if b.status == "R"]
    for t, leaf in zip(log.ticks["t"][:-1], log.ticks["leaf"][:-1], strict=True):
        assert [b.path.split("/")[-1] for b in running if b.start <= t + 1e-9 < b.end] == [leaf]


def test_of_an_old_log_who_commanded(tmp_path):
    bars = leaf_bars(read_log(a_log(tmp_path / "a", trees=False)))
    assert [(b.path, b.status) for b in bars] == [("Track", "R"), ("Dither", "R"), ("Track", "R")]
    assert np.array([(b.start, b.end) for b in bars]) == pytest.approx(np.array([(0, 1), (1, 2), (2, 89 * STEP)]))


def test_names_are_as_short_as_they_can_be():
    bars = [Bar(path, "R", 0.0, 1.0) for path in ("a/x/Wait", "a/y/Wait", "a/y/Go")]
    assert labels(bars) == {"a/x/Wait": "x / Wait", "a/y/Wait": "y / Wait", "a/y/Go": "Go"}
