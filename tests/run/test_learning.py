"""Runs one after the other with a model that learns: what is learned from, what is kept, what goes on."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import call

from mazeplan.core.errors import InputError, ModelError
from mazeplan.core.records import Doubt, Failure, FailureKind
from mazeplan.learning.modelfile import load_model, save_model
from mazeplan.learning.online_rig import Lesson, OnlineOptions
from mazeplan.maze.mapfile import load_map
from mazeplan.run.campaign.evaluate import Campaign, run_one
from mazeplan.run.campaign.online_learning import (
    Learner,
    Ticks,
    evaluate_learning,
    learner_of,
    lesson_document,
    lesson_line,
    unfit,
)

MAZE = load_map("cme")


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A model folder with few rows: the packaged one, so that tests are quick."""
    model = load_model("toy")
    rows = {r: replace(p, inputs=p.inputs[::8], features=p.features[::8], alpha=p.alpha[::8])
            for r, p in model.processes.items()}  # fmt: skip
    folder = tmp_path_factory.mktemp("models") / "small"
    save_model(replace(model, processes=rows), folder)
    return folder


@pytest.fixture(scope="module")
def a_run(small):
    ticks = Ticks()
    return run_one(Campaign(1, "toy", model=str(small), start=3, goal=5, seed=4), 0, None, ticks), ticks


def test_a_run_tells_what_is_needed_and_is_learned_from(small, a_run):
    result, ticks = a_run
    assert result.success
    assert ticks.camera_delay is None
    learner = Learner.begin(load_model(small), MAZE)
    lesson = learner.learn(result, ticks)
    assert set(lesson.rows) <= {3, 4}
    assert 5 < sum(lesson.rows.values()) <= len(ticks.rows)
    assert 0.0 < lesson.error < 1.0
    ages = [rows.age.max() for rows in learner.online.rings.values()]
    assert ages[:2] == [0.0, 0.0]
    assert max(ages[2:]) == lesson.pace > 0.0


def test_a_delay_that_was_measured_of_the_rig_counts_for_more_than_the_models():
    ticks = Ticks()
    ticks("/header", 0.0, {"replay": {"latency": {"camera_s": 0.031, "command_s": 0.02}}})
    assert ticks.camera_delay == 0.031


def test_runs_that_tell_nothing_true_are_not_learned_from(small, a_run):
    result, ticks = a_run
    blind = Ticks([{k: v for k, v in row.items() if k != "x"} if i % 3 else row for i, row in enumerate(ticks.rows)])
    assert unfit(result, ticks) == ""
    assert "ball_lost after 1.5 s" in unfit(
        replace(result, failures=(Failure(FailureKind.BALL_LOST, "x", 1.5),)), ticks
    )
    assert "rig_failed" in unfit(replace(result, failures=(Failure(FailureKind.RIG_FAILED, "x", 1.0),)), ticks)
    assert "in doubt (tilt after 0.5 s)" in unfit(replace(result, doubts=(Doubt("tilt", 0.5),)), ticks)
    assert "seen in" in unfit(result, blind)
    assert unfit(result, Ticks())
    # what merely did not succeed is what there is most to be learned from
    stuck = replace(result, success=False, failures=(Failure(FailureKind.STUCK, "x", 1.0),))
    assert unfit(stuck, ticks) == ""
    learner = Learner.begin(load_model(small), MAZE)
    before = learner.online.rings
    lesson = learner.learn(replace(result, doubts=(Doubt("tilt", 0.5),)), ticks)
    assert learner.online.rings is before
    assert lesson_line(lesson).startswith("run 1: not learned from: what was measured is in doubt")
    assert lesson_document(lesson)["error_m_s2"] is None


def test_what_is_not_trusted_is_said():
    assert lesson_line(Lesson(3, {1: 9}, error=0.1, fixed=0.2)) == ""
    assert "which is therefore used" in lesson_line(Lesson(3, {1: 9}, error=0.2, fixed=0.1, trusted=False))
    assert lesson_document(Lesson(3, {1: 9}, 2, "", 0.123456, math.nan))["rows"] == {"ring1": 9}


def test_a_folder_goes_on_and_no_other_model_is_overwritten(small, a_run, tmp_path):
    kept = tmp_path / "kept"
    learner = learner_of(str(small), "toy", MAZE, kept)
    learner.learn(*a_run)
    again = learner_of(None, "toy", MAZE, kept)
    assert again.online.now == 1
    assert load_model(kept).kind == "sp"
    np.testing.assert_array_equal(load_model(kept / "start").processes[3].alpha, load_model(small).processes[3].alpha)
    np.testing.assert_allclose(again.model.processes[3].alpha, load_model(kept).processes[3].alpha, atol=1e-9)
    assert learner_of(str(kept), "toy", MAZE, kept).online.now == 1
    with pytest.raises(InputError, match="leave --model out"):
        learner_of(str(small), "toy", MAZE, kept)
    with pytest.raises(ModelError, match="not made by --learn"):
        learner_of(None, "toy", MAZE, small)


def test_the_second_run_is_driven_with_what_the_first_taught(small, monkeypatch):
    driven = []

    def run(campaign, index, model, ticks):
        driven.append(model)
        return run_one(campaign, index, model, ticks)

    monkeypatch.setattr("mazeplan.run.campaign.online_learning.run_one", run)
    campaign = Campaign(2, "toy", model=str(small), start=4, goal=5, seed=11)
    outcomes, lessons = evaluate_learning(campaign, options=OnlineOptions(most=130))
    assert [o.seed for o in outcomes] == [11, 12]
    assert [lesson.run for lesson in lessons] == [1, 2]
    np.testing.assert_array_equal(driven[0].processes[4].alpha, load_model(small).processes[4].alpha)
    assert len(driven[1].processes[4]) > len(driven[0].processes[4])


# -- from the command line -----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_evaluate_learns_keeps_reports_and_tells(monkeypatch, capsys, tmp_path, small):
    kept, page = tmp_path / "kept", tmp_path / "page.html"
    arguments = ("evaluate", "--learn", "--rig", "toy", "--model", small, "--from", "ring4", "--runs", 2, "--json")
    code, out, _ = call(monkeypatch, capsys, *arguments, "-o", kept, "--report", page)
    document = json.loads(out)
    assert code == 0
    assert document["learning"]["model"] == str(kept)
    assert [x["run"] for x in document["learning"]["runs"]] == [1, 2]
    assert page.exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["evaluate", "--learn", "--workers", "2"], "expected 1"),
        (["evaluate", "--learn", "--faults", "all"], "faulty runs must not teach the model"),
        (["evaluate", "--learn", "--dask", "local"], "--dask"),
        (["evaluate", "--learn", "--store", "runs/kept"], "--store"),
        (["evaluate", "-o", "somewhere"], "--learn"),
        (["evaluate", "--learn", "-o", "FILE/none"], "-o: got"),
        (["evaluate", "--learn", "--rig", "BARE"], "mazeplan collect"),
    ],
)
def test_what_cannot_be_learned_is_one_line_and_two(monkeypatch, capsys, tmp_path, arguments, said):
    bare = Path(tmp_path / "bare.yaml")
    bare.write_text("wall_grip: 0.3\n")
    given = [a.replace("BARE", str(bare)).replace("FILE", str(bare)) for a in arguments]
    code, out, err = call(monkeypatch, capsys, *given)
    assert (code, out) == (2, "")
    assert said in err.splitlines()[-1]
    assert len([line for line in err.splitlines() if line.startswith("mazeplan: ")]) == 1
