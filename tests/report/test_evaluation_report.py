"""Reports of evaluations: each number by a second route."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from report_documents import drawn, evaluation, kept
from scipy.stats import binomtest

from mazeplan.apps.report.evaluation import EvaluatedRuns, evaluation_section, interval
from mazeplan.apps.report.inputs import Input, of_document
from mazeplan.apps.report.page import PagePicture, PageTable
from mazeplan.run.campaign.evaluate import evaluate, setup_document, summary
from mazeplan.run.campaign.one_run import Campaign


def given(name="toy", setup=None, **more):
    document = evaluation(name, **more)
    document |= {"setup": setup or document["setup"]}
    return Input("evaluation", Path(f"{name}.json"), name, document)


@pytest.mark.parametrize(("successes", "runs"), [(7, 10), (0, 5), (24, 24), (1, 3)])
def test_the_interval_is_wilsons(successes, runs):
    reference = binomtest(successes, runs).proportion_ci(method="wilson")
    assert interval(successes, runs) == pytest.approx((reference.low, reference.high), abs=1e-6)


def test_success_times_and_failures_of_runs():
    runs = EvaluatedRuns(given())
    assert runs.failures == [("stuck", 0.05, -0.01, True), ("stuck", 0.05, -0.01, False)]
    assert runs.figures() == {"mean": pytest.approx(10 / 3), "best": 2.0, "p50": 3.0, "p95": 4.8, "worst": 5.0}
    assert runs.limit == 20.0
    assert all(math.isnan(v) for v in EvaluatedRuns(given(arrived=(False,) * 4)).figures().values())


def test_the_table_and_the_lead():
    section = evaluation_section(given())
    assert section.lead == "3 of 4 arrived, on average after 3.33 ± 0.88 s."
    rows = {row[0]: row[1:] for row in kept(section.parts, PageTable)[0].rows}
    assert (rows["arrived"], rows["mean time"], rows["worst"]) == (["3 of 4"], ["3.33 s"], ["5.00 s"])
    assert rows["runs that did not arrive ended with"] == ["out of time 1"]
    assert rows["failures stuck: in runs that arrived + in the others"] == ["1 + 1"]
    assert [p.name for p in kept(section.parts, PagePicture)] == ["arrivals", "places"]


def test_the_picture_shows_runs_that_did_not_arrive():
    (axes,) = drawn(evaluation_section(given()).parts, "arrivals").axes
    steps = axes.lines[0]
    assert steps.get_ydata()[-1] == pytest.approx(75.0)  # percent of all runs
    assert steps.get_xdata()[1:4].tolist() == [2.0, 3.0, 5.0]


def test_a_real_evaluation_has_starts_and_its_setup():
    campaign = Campaign(runs=2, rig="toy", start=4, seed=7)
    document = {**summary(evaluate(campaign)), "setup": setup_document(campaign)}
    (one,) = of_document(document, Path("e.json"))
    runs = EvaluatedRuns(one)
    assert [result["start"]["ring"] for result in document["results"]] == [4, 4]
    assert evaluation_section(one).facts[:2] == [("rig", "toy"), ("map", "cme")]
    assert runs.figures()["mean"] == pytest.approx(document["time_s"]["mean"], abs=1e-4)
