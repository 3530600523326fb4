"""Reports of evaluations: each number by a second route."""

from __future__ import annotations

from pathlib import Path

import pytest
from report_documents import drawn, evaluation, kept

from mazeplan.apps.report.inputs import Input, of_document
from mazeplan.apps.report.page import PagePicture, PageTable
from mazeplan.apps.report.runs import evaluation_section
from mazeplan.apps.report.words import MISSING
from mazeplan.run.campaign.one_run import Campaign
from mazeplan.run.commands.evaluate import results_of, setup_document, summary


def given(name="toy", setup=None, **more):
    document = evaluation(name, **more)
    document |= {"setup": setup or document["setup"]}
    return Input("evaluation", Path(f"{name}.json"), name, document)


def test_the_table_and_the_lead():
    section = evaluation_section(given())
    assert section.lead == "3 of 4 arrived, on average after 3.33 ± 0.88 s."
    rows = {row[0]: row[1:] for row in kept(section.parts, PageTable)[0].rows}
    assert (rows["arrived"], rows["mean time"], rows["worst"]) == (["3 of 4"], ["3.33 s"], ["5.00 s"])
    assert rows["runs that did not arrive ended with"] == ["out of time 1"]
    assert rows["failures stuck: in runs that arrived + in the others"] == ["1 + 1"]
    assert [p.name for p in kept(section.parts, PagePicture)] == ["arrivals", "places"]
    none = evaluation_section(given(arrived=(False,) * 4))
    assert none.lead == "0 of 4 arrived."
    assert ["mean time", MISSING] in kept(none.parts, PageTable)[0].rows


def test_the_picture_shows_runs_that_did_not_arrive():
    (axes,) = drawn(evaluation_section(given()).parts, "arrivals").axes
    steps = axes.lines[0]
    assert steps.get_ydata()[-1] == pytest.approx(75.0)  # percent of all runs
    assert steps.get_xdata()[1:4].tolist() == [2.0, 3.0, 5.0]


def test_a_real_evaluation_has_starts_and_its_setup():
    campaign = Campaign(runs=2, rig="toy", start=4, seed=7)
    document = {**summary(results_of(campaign)), "setup": setup_document(campaign)}
    (one,) = of_document(document, Path("e.json"))
    assert [result["start"]["ring"] for result in document["results"]] == [4, 4]
    assert evaluation_section(one).facts[:2] == [("rig", "toy"), ("map", "cme")]
    (mean,) = [row[1] for row in kept(evaluation_section(one).parts, PageTable)[0].rows if row[0] == "mean time"]
    assert mean == f"{document['time_s']['mean']:.2f} s"
