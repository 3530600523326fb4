"""The report of a run: its numbers are those of the log."""

from __future__ import annotations

import math

import numpy as np
import pytest
from report_documents import EVIL, MAZE, STEP, a_log

from mazeplan.data.runlog import read_log
from mazeplan.errors import LogError
from mazeplan.report.page import Picture, Table
from mazeplan.report.run import (
    AHEAD,
    followed_plans,
    maze_of,
    mishaps,
    planned_before,
    run_section,
    spread_of,
    theta_lines,
    visits,
)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return read_log(a_log(tmp_path_factory.mktemp("log") / "run.mcap", detail=EVIL))


def test_rings_and_failures(log):
    assert [(v.ring, round(v.start, 4), round(v.end, 4), v.opening) for v in visits(log)] == [
        (1, 0.0, 2.0, "1-2@135"),
        (2, 2.0, round(89 * STEP, 4), ""),
    ]
    (m,) = mishaps(log)
    assert (m.kind, m.where, m.detail, m.recovery) == ("stuck", "Track", EVIL, "dither")
    assert math.atan2(m.y, m.x) == pytest.approx(m.t) == pytest.approx(1.0)  # the ball goes 1 rad/s
    assert math.hypot(m.x, m.y) == pytest.approx(MAZE.track_radius(1))


def test_of_several_plans_of_a_tick_the_one_that_was_followed(log):
    plans = followed_plans(log)
    assert len(plans) == 9
    assert len(log.plans) == 18
    assert all(plan["states"][0, 0] == pytest.approx(plan["t0"], abs=1e-5) for plan in plans)


def test_what_was_planned_before_is_what_the_newest_plan_old_enough_says(log):
    t = np.array([0.1, 0.25, 0.5, 0.9, 1.2])
    made = [math.floor((now - AHEAD + 1e-6) / (10 * STEP)) * 10 * STEP for now in t]
    expected = [since + 1.5 * (now - since) if since >= 0 and now - since <= 2 * AHEAD else math.nan
                for now, since in zip(t, made, strict=True)]  # fmt: skip
    assert planned_before(log, t) == pytest.approx(np.array(expected), abs=1e-5, nan_ok=True)
    assert np.isnan(planned_before(log, t)[0])  # none was made so early


def test_angles_of_each_ring(log):
    first, second = theta_lines(log, maze_of(log))
    assert [part[0].ring for part in (first, second)] == [1, 2]
    assert len(first[1]) == 60
    for _, t, real, planned in (first, second):
        assert real == pytest.approx(np.degrees(t))
        known = np.isfinite(planned)
        assert known.sum() > 10
        # a plan is between .2 and .4 s old, and the ball goes .5 rad/s less fast than planned
        assert np.all((planned - real)[known] > math.degrees(0.5 * AHEAD) - 1e-3)
        assert np.all((planned - real)[known] < math.degrees(0.5 * 2 * AHEAD) + 1e-3)


def test_the_section_says_how_it_went(log):
    section = run_section(log)
    assert section.lead == "The ball arrived after 2.97 s; 1 failure on the way."
    assert ("mazeplan", "9.9") in section.facts
    assert ("seed", "3") in section.facts
    tables = {part.caption: part.rows for part in section.parts if isinstance(part, Table)}
    assert tables["Failures and recoveries"] == [["1.00 s", "stuck", "Track", EVIL, "dither"]]
    assert tables["What the program took"][0][2:] == ["2.00 ms"] * 3
    assert tables["What the program took"][1] == ["tick", "90", "45.50 ms", "89.11 ms", "90.00 ms"]
    assert [p.name for p in section.parts if isinstance(p, Picture)] == ["path", "theta", "tree", "tilt", "times"]


def test_a_log_that_was_cut_says_so(tmp_path):
    whole = a_log(tmp_path / "whole.mcap", result=False).read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    section = run_section(read_log(tmp_path / "cut.mcap"))
    assert "the program did not come to its end" in section.lead
    assert ("log", "cut.mcap (cut off)") in section.facts


def test_a_log_of_nothing_is_refused(tmp_path):
    from mazeplan.data.runlog import RunLogWriter

    with RunLogWriter(tmp_path / "empty.mcap", {}):
        pass
    with pytest.raises(LogError, match="without a single tick"):
        run_section(read_log(tmp_path / "empty.mcap"))


def test_spread_of_nothing():
    assert all(math.isnan(value) for value in spread_of(np.array([math.nan])))


def test_a_condition_that_answers_no_is_no_failure(log):
    """It has a word of its own, and no cross; another leaf that fails has."""
    from dataclasses import replace

    from matplotlib.figure import Figure

    from mazeplan.data.runlog import STATUSES
    from mazeplan.report.run_pictures import run_pictures

    failed = STATUSES["FAILURE"]
    no, old, own = "no (a condition)", {}, {"conditions": [0]}
    for kind, told, words in (
        ("InRing", old, no),
        ("Track", old, "failed"),
        ("Mine", own, no),
        ("InRing", {"conditions": []}, "failed"),
    ):
        tree = {
            "t": 0.0,
            "paths": ["a"],
            "kinds": [kind],
            "names": ["a"],
            "parents": [-1],
            "statuses": [(0.0, failed)],
            **told,
        }
        figure = Figure()
        shown = replace(log, trees=[tree], events=[])
        next(p for p in run_pictures(shown, MAZE) if p.name == "tree").draw(figure)
        (axes,) = figure.axes
        assert [text.get_text() for text in axes.get_legend().get_texts()] == [words]
        assert any(drawn.get_marker() == "X" for drawn in axes.lines) == (words == "failed")
