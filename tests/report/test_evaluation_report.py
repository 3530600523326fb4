"""Reports of evaluations: each number by a second route."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from report_documents import drawn, evaluation, kept
from scipy.stats import binomtest

from mazeplan.apps.report.evaluation import evaluation_section
from mazeplan.apps.report.evaluation_runs import (
    by_kind,
    figures,
    interval,
    places,
    runs_of,
)
from mazeplan.apps.report.inputs import Input, of_document
from mazeplan.apps.report.page import PagePicture, PageTable
from mazeplan.maze.mapfile import dump_map, load_map
from mazeplan.run.campaign.evaluate import Campaign, evaluate, setup_document, summary


def given(name="toy", setup=None, **more):
    document = evaluation(name, **more)
    document |= {"setup": setup or document["setup"]}
    return Input("evaluation", Path(f"{name}.json"), name, document)


RUNS = runs_of(given())


@pytest.mark.parametrize(("successes", "runs"), [(7, 10), (0, 5), (24, 24), (1, 3)])
def test_the_interval_is_wilsons(successes, runs):
    reference = binomtest(successes, runs).proportion_ci(method="wilson")
    assert interval(successes, runs) == pytest.approx((reference.low, reference.high), abs=1e-6)


def test_success_times_and_failures_of_runs():
    assert by_kind(RUNS) == {"stuck": (1, 1)}
    assert places(RUNS) == [("stuck", 0.05, -0.01)] * 2
    assert figures(RUNS) == {"mean": pytest.approx(10 / 3), "best": 2.0, "p50": 3.0, "p95": 4.8, "worst": 5.0}
    assert RUNS.limit == 20.0
    assert all(math.isnan(v) for v in figures(runs_of(given(arrived=(False,) * 4))).values())


def test_one_evaluation_and_several_side_by_side():
    section = evaluation_section([given()])
    assert section.lead == "3 of 4 arrived, on average after 3.33 s."
    rows = {row[0]: row[1:] for row in kept(section.parts, PageTable)[0].rows}
    assert rows["arrived"] == ["3 of 4", "7 of 10"]
    assert rows["mean time"] == ["3.33 s", "7.71 s"]
    assert rows["worst"] == ["5.00 s", "10.13 s"]
    assert rows["runs that did not arrive ended with"][0] == "out of time 1"
    both = evaluation_section([given(), given("rough"), given()])
    assert both.title == "Evaluations: toy, rough, toy (2)"
    assert kept(both.parts, PageTable)[0].head == ["", "toy", "rough", "toy (2)", "published, on hardware"]
    assert {p.name for p in kept(both.parts, PagePicture)} == {"arrivals", "kinds", "places"}


def test_pictures_show_runs_that_did_not_arrive_and_the_published_marks():
    parts = evaluation_section([given()]).parts
    upper, lower = drawn(parts, "arrivals").axes
    assert {t.get_text() for t in upper.texts} == {"best\n6.2 s", "mean\n7.71 s", "worst\n10.13 s"}
    steps = upper.lines[0]
    assert steps.get_ydata()[-1] == pytest.approx(75.0)  # percent of all runs
    assert steps.get_xdata()[1:4].tolist() == [2.0, 3.0, 5.0]
    assert any(line.get_marker() == "X" and line.get_xdata()[0] == 20.0 for line in lower.lines)


def test_a_real_evaluation_has_starts_and_its_setup():
    campaign = Campaign(runs=2, rig="toy", start=4, seed=7)
    document = {**summary(evaluate(campaign)), "setup": setup_document(campaign)}
    (one,) = of_document(document, Path("e.json"))
    runs = runs_of(one)
    assert [result["start"]["ring"] for result in document["results"]] == [4, 4]
    assert evaluation_section([one]).facts[:2] == [("rig", "toy"), ("map", "cme")]
    assert figures(runs)["mean"] == pytest.approx(document["time_s"]["mean"], abs=1e-4)


def test_published_times_stand_beside_runs_in_that_maze_only():
    parts = evaluation_section([given(setup={"map": dump_map(load_map("seven"))})]).parts
    table = kept(parts, PageTable)[0]
    assert table.head == ["", "toy"]
    assert {len(row) for row in table.rows} == {2}
    upper, lower = drawn(parts, "arrivals").axes
    assert not upper.texts
    assert [label.get_text() for label in lower.get_yticklabels()] == ["toy"]
