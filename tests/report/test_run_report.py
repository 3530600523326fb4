"""The report of a run: its numbers are those of the log."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from report_documents import EVIL, MAZE, STEP, a_log, drawn

from mazeplan.apps.report.page import PagePicture, PageTable
from mazeplan.apps.report.runs import lead, logged_failures, run_section, visits
from mazeplan.core.errors import LogError
from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.core.logs.run_log_reader import read_log


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return read_log(a_log(tmp_path_factory.mktemp("log") / "run.mcap", detail=EVIL))


def test_rings_and_failures(log):
    assert [(v.ring, round(v.start, 4), round(v.end, 4), v.opening) for v in visits(log)] == [
        (1, 0.0, 2.0, "1-2@135"),
        (2, 2.0, round(89 * STEP, 4), ""),
    ]
    (m,) = logged_failures(log)
    assert (m.kind, m.where, m.detail, m.recovery) == ("stuck", "Track", EVIL, "dither")
    assert math.atan2(m.y, m.x) == pytest.approx(m.t) == pytest.approx(1.0)  # the ball goes 1 rad/s
    assert math.hypot(m.x, m.y) == pytest.approx(MAZE.track_radius(1))


def test_the_log_of_a_collection_is_no_run_that_broke_off(log):
    whole = replace(log, header={**log.header, "excitation": "multisine"}, result=None, complete=True)
    assert lead(whole) == "A collection of 3 s."
    for broken in (replace(whole, complete=False), replace(log, result=None)):
        assert lead(broken) == "The log ends without a result after 2.97 s: the program did not come to its end."


def test_the_section_says_how_it_went(log):
    section = run_section(log)
    assert section.lead == "The ball arrived after 2.97 s; 1 failure on the way."
    assert ("mazeplan", "9.9") in section.facts
    assert ("seed", "3") in section.facts
    tables = {part.caption: part.rows for part in section.parts if isinstance(part, PageTable)}
    assert tables["Failures and recoveries"] == [["1.00 s", "stuck", "Track", EVIL, "dither"]]
    assert [p.name for p in section.parts if isinstance(p, PagePicture)] == ["path", "time"]


def test_a_log_that_was_cut_says_so(tmp_path):
    whole = a_log(tmp_path / "whole.mcap", result=False).read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    section = run_section(read_log(tmp_path / "cut.mcap"))
    assert "the program did not come to its end" in section.lead
    assert ("log", "cut.mcap (cut off)") in section.facts


def test_a_log_of_nothing_is_refused(tmp_path):
    with RunLogWriter(tmp_path / "empty.mcap", {}):
        pass
    with pytest.raises(LogError, match="without a single tick"):
        run_section(read_log(tmp_path / "empty.mcap"))


def test_the_picture_over_time_has_the_numbers_of_the_log(log):
    angle, beta, _ = drawn(run_section(log).parts, "time").axes
    real = next(line for line in angle.lines if line.get_label() == "real")
    assert real.get_ydata() == pytest.approx(np.degrees(log.ticks["t"]))
    commanded = next(line for line in beta.lines if line.get_label() == "commanded")
    assert commanded.get_ydata() == pytest.approx(math.degrees(0.02))
