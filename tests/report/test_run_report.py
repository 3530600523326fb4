"""The report of a run: its numbers are those of the log."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from report_documents import EVIL, LEAVES, MAZE, STEP, a_log, drawn

from mazeplan.apps.report.page import PagePicture, PageTable
from mazeplan.apps.report.run import lead, run_section, spread_of
from mazeplan.apps.report.run_record import (
    AHEAD,
    Bar,
    followed_plans,
    labels,
    leaf_bars,
    logged_failures,
    planned_before,
    theta_lines,
    visits,
)  # fmt: skip
from mazeplan.apps.report.words import setup_facts
from mazeplan.core.errors import LogError
from mazeplan.core.logs.run_log import STATUSES, RunLogWriter, read_log
from mazeplan.core.logs.run_log_reader import LoggedTree
from mazeplan.core.records import TreeOutline


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


def test_of_several_plans_of_a_tick_the_one_that_was_followed(log):
    plans = followed_plans(log)
    assert len(plans) == 9
    assert len(log.plans) == 18
    assert all(plan.states[0, 0] == pytest.approx(plan.t0, abs=1e-5) for plan in plans)


def test_what_was_planned_before_is_what_the_newest_plan_old_enough_says(log):
    t = np.array([0.1, 0.25, 0.5, 0.9, 1.2])
    made = [math.floor((now - AHEAD + 1e-6) / (10 * STEP)) * 10 * STEP for now in t]
    expected = [since + 1.5 * (now - since) if since >= 0 and now - since <= 2 * AHEAD else math.nan
                for now, since in zip(t, made, strict=True)]  # fmt: skip
    assert planned_before(followed_plans(log), t) == pytest.approx(np.array(expected), abs=1e-5, nan_ok=True)
    assert np.isnan(planned_before(followed_plans(log), t)[0])  # none was made so early


def test_angles_of_each_ring(log):
    first, second = theta_lines(log, MAZE)
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
    tables = {part.caption: part.rows for part in section.parts if isinstance(part, PageTable)}
    assert tables["Failures and recoveries"] == [["1.00 s", "stuck", "Track", EVIL, "dither"]]
    assert tables["Computing time"][0][2:] == ["2.00 ms"] * 3
    assert tables["Computing time"][1] == ["tick", "90", "45.50 ms", "89.11 ms", "90.00 ms"]
    assert [p.name for p in section.parts if isinstance(p, PagePicture)] == ["path", "theta", "tree", "tilt"]


def test_the_balls_angle_reads_0_to_360_over_whole_turns_like_the_names_of_openings(log):
    """A ball that rolls from 350 on to 370 and over three turns."""
    t = log.ticks["t"]
    for speed, start in ((1.0, 350.0), (-7.0, 20.0)):
        theta = np.radians(start) + speed * t
        radius = MAZE.track_radius(1)
        ticks = {
            **log.ticks,
            "estimate_x": radius * np.cos(theta),
            "estimate_y": radius * np.sin(theta),
            "estimate_t": t,
        }
        moved = replace(log, ticks=ticks)
        upper = drawn(run_section(moved).parts, "theta").axes[0]
        upper.figure.draw_without_rendering()
        shown = [float(text.get_text()) for text in upper.get_yticklabels()]
        assert all(0.0 <= angle < 360.0 for angle in shown)
        assert len(shown) >= 3
        first, second = (real for _, _, real, _ in theta_lines(moved, MAZE))
        assert 0.0 <= first[0] < 360.0
        assert second[0] - first[-1] == pytest.approx(np.degrees(speed) * STEP, abs=0.1)  # on over the wall


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


def test_spread_of_nothing():
    assert all(math.isnan(value) for value in spread_of(np.array([math.nan])))


def test_a_condition_that_answers_no_is_no_failure(log):
    """It has a word of its own, and no cross; another leaf that fails has."""
    failed = STATUSES["FAILURE"]
    no = "no (a condition)"
    for kind, conditions, words in (
        ("Mine", (0,), no),
        ("InRing", (), "failed"),
    ):
        tree = LoggedTree(0.0, TreeOutline(("a",), (kind,), ("a",), (-1,), conditions), ((0.0, failed),))
        (axes,) = drawn(run_section(replace(log, trees=[tree], events=[])).parts, "tree").axes
        legend = axes.get_legend()
        assert legend is not None
        assert [text.get_text() for text in legend.get_texts()] == [words]
        assert any(line.get_marker() == "X" for line in axes.lines) == (words == "failed")


def test_intervals_are_those_of_the_statuses(tmp_path):
    track, passing, dither = LEAVES
    bars = [(b.path, b.status, round(b.start, 4), round(b.end, 4)) for b in leaf_bars(read_log(a_log(tmp_path / "a")))]
    last = round(90 * STEP, 4)  # what the last tick said holds for one more sample
    assert bars == [
        (track, "R", 0.0, 1.0), (track, "F", 1.0, 2.0), (track, "R", 2.0, last),
        (dither, "R", 1.0, 2.0), (dither, "S", 2.0, last),
    ]  # fmt: skip
    assert not any(path == passing for path, *_ in bars)  # it was never ticked
    assert not any(path == "Root/Go" for path, *_ in bars)  # no leaf


def test_names_are_as_short_as_they_can_be():
    bars = [Bar(path, "R", 0.0, 1.0) for path in ("a/x/Wait", "a/y/Wait", "a/y/Go")]
    assert labels(bars) == {"a/x/Wait": "x / Wait", "a/y/Wait": "y / Wait", "a/y/Go": "Go"}


def test_the_rings_on_the_way_are_named():
    facts = dict(setup_facts({"start_ring": 1, "via_rings": [3, 2, 3], "goal_ring": 5}))
    assert facts == {"from ring": "1", "by way of rings": "3, 2, 3", "to ring": "5"}
