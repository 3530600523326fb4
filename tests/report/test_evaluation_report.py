"""Reports of evaluations: each number by a second route."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from report_documents import evaluation
from scipy.stats import binomtest

from mazeplan.evaluate import Campaign, evaluate, setup_document, summary
from mazeplan.maze.mapfile import dump_map, load_map
from mazeplan.report.evaluation import (
    SECTORS,
    by_kind,
    by_ring,
    by_sector,
    evaluation_section,
    figures,
    interval,
    places,
    runs_of,
)
from mazeplan.report.inputs import Input, of_document
from mazeplan.report.page import Picture, Table


def given(name="toy", **more):
    return Input("evaluation", Path(f"{name}.json"), name, evaluation(name, **more))


RUNS = runs_of(given())


@pytest.mark.parametrize(("successes", "runs"), [(7, 10), (0, 5), (24, 24), (1, 3)])
def test_the_interval_is_wilsons(successes, runs):
    reference = binomtest(successes, runs).proportion_ci(method="wilson")
    assert interval(successes, runs) == pytest.approx((reference.low, reference.high), abs=1e-6)


def test_success_by_start_angle():
    arrived, total = by_sector(RUNS)
    expected = np.zeros((2, SECTORS), dtype=int)
    for degrees, good in ((10, 1), (11, 1), (100, 0), (200, 1)):
        expected[:, int(degrees // 22.5)] += (good, 1)
    assert (arrived.tolist(), total.tolist()) == (expected[0].tolist(), expected[1].tolist())


def test_time_in_a_ring_is_that_of_all_visits_of_runs_that_arrived():
    assert {ring: times.tolist() for ring, times in by_ring(RUNS).items()} == {1: [1.25, 2.25, 4.25], 2: [0.5] * 3}


def test_failures_by_kind_and_place():
    assert by_kind(RUNS) == {"stuck": (1, 1)}
    assert places(RUNS) == [("stuck", 0.05, -0.01)] * 2


def test_times_are_of_runs_that_arrived():
    assert figures(RUNS) == {"mean": pytest.approx(10 / 3), "best": 2.0, "p50": 3.0, "p95": 4.8, "worst": 5.0}
    assert RUNS.limit == 20.0
    assert all(math.isnan(v) for v in figures(runs_of(given(arrived=(False,) * 4))).values())


def test_one_evaluation_and_several_side_by_side():
    section = evaluation_section([given()])
    assert section.lead == "3 of 4 arrived, on average after 3.33 s."
    table = next(part for part in section.parts if isinstance(part, Table))
    told = {row[0]: row[1:] for row in table.rows}
    assert told["arrived"] == ["3 of 4", "7 of 10"]
    assert told["mean time"] == ["3.33 s", "7.71 s"]
    assert told["worst"] == ["5.00 s", "10.13 s"]
    assert told["those that did not arrive ended with"][0] == "out of time 1"
    both = evaluation_section([given(), given("rough"), given()])
    assert both.title == "Evaluations: toy, rough, toy (2)"
    (table,) = [p for p in both.parts if isinstance(p, Table) and "figures" in p.caption]
    assert table.head == ["", "toy", "rough", "toy (2)", "published, on hardware"]
    names = {p.name for p in both.parts if isinstance(p, Picture)}
    assert names == {"arrivals", "starts", "rings", "kinds", "places"}


def test_pictures_show_those_that_did_not_arrive_and_the_published_marks():
    import re

    from matplotlib.figure import Figure

    from mazeplan.report.evaluation_pictures import _arrivals, _starts

    figure = Figure()
    _arrivals(figure, [RUNS])
    upper, lower = figure.axes
    assert {t.get_text() for t in upper.texts} == {"best\n6.2 s", "mean\n7.71 s", "worst\n10.13 s"}
    steps = upper.lines[0]
    assert steps.get_ydata()[-1] == pytest.approx(75.0)  # percent of all runs
    assert steps.get_xdata()[1:4].tolist() == [2.0, 3.0, 5.0]
    assert any(line.get_marker() == "X" and line.get_xdata()[0] == 20.0 for line in lower.lines)
    figure = Figure()
    _starts(figure, [RUNS])
    shares, times = figure.axes
    counts = sorted(t.get_text() for t in shares.texts if re.fullmatch(r"\d/\d", t.get_text()))
    assert counts == ["0/1", "1/1", "2/2"]
    drawn = [line for line in times.lines if line.get_marker() == "X"]
    assert np.degrees(drawn[0].get_xdata()) == pytest.approx([100.0])


def test_a_real_evaluation_tells_starts_and_with_what_it_was_done():
    campaign = Campaign(runs=2, rig="toy", start=4, seed=7)
    outcomes = evaluate(campaign)
    document = {**summary(outcomes), "setup": setup_document(campaign)}
    (one,) = of_document(document, Path("e.json"))
    runs = runs_of(one)
    assert np.degrees(runs.start) == pytest.approx([11.25, 33.75])  # the first two of the published evaluation
    assert [result["start"]["ring"] for result in document["results"]] == [4, 4]
    assert one.document["setup"]["rig"] == "toy"
    assert evaluation_section([one]).facts[:2] == [("rig", "toy"), ("map", "cme")]
    assert figures(runs)["mean"] == pytest.approx(document["time_s"]["mean"], abs=1e-4)


def test_published_times_stand_beside_runs_in_that_maze_only():
    from matplotlib.figure import Figure

    one = given()
    one.document["setup"]["map"] = dump_map(load_map("seven"))
    section = evaluation_section([one])
    table = next(part for part in section.parts if isinstance(part, Table))
    assert table.head == ["", "toy"]
    assert all(len(row) == 2 for row in table.rows)
    arrivals = next(part for part in section.parts if isinstance(part, Picture) and part.name == "arrivals")
    assert arrivals.title == "Arrived by then"
    figure = Figure()
    arrivals.draw(figure)
    upper, lower = figure.axes
    assert not upper.texts
    assert [label.get_text() for label in lower.get_yticklabels()] == ["toy"]
