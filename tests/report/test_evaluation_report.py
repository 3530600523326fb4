"""Reports of evaluations: each number by a second route."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from report_documents import drawn, evaluation, kept
from scipy.stats import binomtest

from mazeplan.apps.report.evaluation import evaluation_section
from mazeplan.apps.report.evaluation_runs import (
    SECTORS,
    by_kind,
    by_ring,
    by_sector,
    figures,
    interval,
    places,
    runs_of,
)
from mazeplan.apps.report.inputs import Input, of_document
from mazeplan.apps.report.learning import is_baseline
from mazeplan.apps.report.page import Note, PagePicture, PageTable
from mazeplan.core.errors import InputError
from mazeplan.maze.mapfile import dump_map, load_map
from mazeplan.run.campaign.evaluate import Campaign, evaluate, setup_document, summary


def given(name="toy", setup=None, learning=None, **more):
    document = evaluation(name, **more)
    document |= {"setup": setup or document["setup"], "learning": learning}
    return Input("evaluation", Path(f"{name}.json"), name, document)


RUNS = runs_of(given())


@pytest.mark.parametrize(("successes", "runs"), [(7, 10), (0, 5), (24, 24), (1, 3)])
def test_the_interval_is_wilsons(successes, runs):
    reference = binomtest(successes, runs).proportion_ci(method="wilson")
    assert interval(successes, runs) == pytest.approx((reference.low, reference.high), abs=1e-6)


def test_success_times_and_failures_of_runs():
    expected = np.zeros((2, SECTORS), dtype=int)
    for degrees, good in ((10, 1), (11, 1), (100, 0), (200, 1)):
        expected[:, int(degrees // 22.5)] += (good, 1)
    assert np.array_equal(by_sector(RUNS), expected)
    # all visits of a ring count, in runs that arrived
    assert {ring: times.tolist() for ring, times in by_ring(RUNS).items()} == {1: [1.25, 2.25, 4.25], 2: [0.5] * 3}
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
    assert {p.name for p in kept(both.parts, PagePicture)} == {"arrivals", "starts", "rings", "kinds", "places"}


def test_pictures_show_runs_that_did_not_arrive_and_the_published_marks():
    parts = evaluation_section([given()]).parts
    upper, lower = drawn(parts, "arrivals").axes
    assert {t.get_text() for t in upper.texts} == {"best\n6.2 s", "mean\n7.71 s", "worst\n10.13 s"}
    steps = upper.lines[0]
    assert steps.get_ydata()[-1] == pytest.approx(75.0)  # percent of all runs
    assert steps.get_xdata()[1:4].tolist() == [2.0, 3.0, 5.0]
    assert any(line.get_marker() == "X" and line.get_xdata()[0] == 20.0 for line in lower.lines)
    shares, times = drawn(parts, "starts").axes
    counts = sorted(t.get_text() for t in shares.texts if re.fullmatch(r"\d/\d", t.get_text()))
    assert counts == ["0/1", "1/1", "2/2"]
    lost = next(line for line in times.lines if line.get_marker() == "X")
    assert np.degrees(lost.get_xdata()) == pytest.approx([100.0])


def test_a_real_evaluation_has_starts_and_its_setup():
    campaign = Campaign(runs=2, rig="toy", start=4, seed=7)
    document = {**summary(evaluate(campaign)), "setup": setup_document(campaign)}
    (one,) = of_document(document, Path("e.json"))
    runs = runs_of(one)
    assert np.degrees(runs.start) == pytest.approx([11.25, 191.25])  # opposite each other
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


SAME = {"rig": "worn", "map": dump_map(load_map("cme")), "start_ring": 1, "goal_ring": 5, "seed": 0}


def taught(first=1, **setup):
    """Four runs while a model learned, numbered from `first` on."""
    lessons = [{"run": first + k, "error_m_s2": 0.2, "fixed_error_m_s2": 0.3, "why_not": None} for k in range(4)]
    return given("learning", SAME | setup, {"runs": lessons})


def run_by_run(*inputs):
    """Title, notes, and {label: (x, y) of its points} of the upper panel and of the lower."""
    parts = evaluation_section(list(inputs)).parts
    (title,) = [p.title for p in kept(parts, PagePicture) if p.name == "learning"]
    panels = [{a.get_label(): a.get_xydata() for a in axes.lines} for axes in drawn(parts, "learning").axes]
    return title, [p.text for p in kept(parts, Note)], panels


@pytest.mark.parametrize("order", [1, -1])
def test_runs_that_learned_stand_beside_those_that_did_not(order):
    fixed = given("fixed", SAME, arrived=(True, False, False, True))
    title, notes, (upper, _) = run_by_run(*[taught(), fixed][::order])
    assert title == "Run by run, while the model learned: learning, beside fixed"
    assert any("in learning the model learned, in fixed it stayed as it was" in note for note in notes)
    # the points of a run lie on either side of its number
    for name, runs in (("learning", runs_of(taught())), ("fixed", runs_of(fixed))):
        for label, which in (("arrived", runs.arrived), ("did not arrive", ~runs.arrived)):
            x, y = upper.pop(f"{name}: {label}").T
            assert np.round(x).tolist() == (np.flatnonzero(which) + 1).tolist()
            assert not set(x) & {1.0, 2.0, 3.0, 4.0}
            assert y.tolist() == runs.time[which].tolist()
    assert not upper


@pytest.mark.parametrize("other", [{"rig": "toy"}, {"start_ring": 4}, {"goal_ring": 4}, {"seed": 1}, {"map": "x"}])
def test_runs_of_something_else_do_not_stand_beside(other):
    learned = runs_of(taught())
    assert is_baseline(learned, runs_of(given("fixed", SAME)))
    for runs in (given("fixed", SAME | other), taught(), given("older version")):
        assert not is_baseline(learned, runs_of(runs))


def test_runs_that_went_on_have_their_own_numbers_and_a_change_of_the_rig_is_marked():
    title, _, (upper, lower) = run_by_run(taught(first=9, changes=[3, 11]))
    assert title == "Run by run, while the model learned: learning"
    x = np.concatenate([upper["arrived"][:, 0], upper["did not arrive"][:, 0]])
    assert sorted(x) == [9.0, 10.0, 11.0, 12.0] == lower["by the model that learns"][:, 0].tolist()
    assert upper["the rig changes"][:, 0].tolist() == [10.5, 10.5]
    assert "the rig changes" not in run_by_run(taught(first=9))[2][0]


def test_an_evaluation_has_the_changes_of_its_rig(tmp_path):
    file = tmp_path / "rig.yaml"
    file.write_text("model: toy\nchanges:\n- {from_run: 7, wall_grip: 0.1}\n- {from_run: 4, wall_grip: 0.2}\n")
    assert setup_document(Campaign(2, "worn"))["changes"] == [11]
    assert setup_document(Campaign(2, str(file)))["changes"] == [4, 7]
    assert "changes" not in setup_document(Campaign(2, "toy"))
    with pytest.raises(InputError, match=r"setup.changes\[1\]"):
        given(setup=SAME | {"changes": [11, "x"]})
