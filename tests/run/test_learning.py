"""Runs one after the other with a model that learns: what is learned from, what is kept, what goes on."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from commands import call

from mazeplan.core.errors import InputError
from mazeplan.core.records import Doubt, Failure, FailureKind
from mazeplan.maze.mapfile import load_map
from mazeplan.run.campaign import online_learning as learning
from mazeplan.run.campaign.one_run import Campaign, run_one
from mazeplan.run.campaign.online_learning import Ticks, evaluate_learning, open_learner, unfit
from mazeplan.run.request import Company

MAZE = load_map("cme")


@pytest.fixture(scope="module")
def a_run():
    ticks = Ticks()
    return run_one(Campaign(rig="toy", start=3, goal=5, seed=4), 0, Company(feed=ticks)), ticks


def test_a_delay_that_was_measured_of_the_rig_counts_for_more_than_the_models():
    ticks = Ticks()
    ticks("/header", 0.0, {"replay": {"latency": {"camera_s": 0.031, "command_s": 0.02}}})
    assert ticks.camera_delay == 0.031


def test_runs_that_tell_nothing_true_are_not_learned_from(a_run):
    result, ticks = a_run
    blind = Ticks([{k: v for k, v in row.items() if k != "x"} if i % 3 else row for i, row in enumerate(ticks.rows)])
    assert unfit(result, ticks) == ""
    for kind in (FailureKind.BALL_LOST, FailureKind.RIG_FAILED):
        assert unfit(replace(result, failures=(Failure(kind, "x", 1.5),)), ticks)
    assert unfit(replace(result, doubts=(Doubt("tilt", 0.5),)), ticks)
    assert unfit(result, blind)
    assert unfit(result, Ticks())
    # what merely did not succeed is what there is most to be learned from
    stuck = replace(result, success=False, failures=(Failure(FailureKind.STUCK, "x", 1.0),))
    assert unfit(stuck, ticks) == ""


def test_each_run_is_driven_with_what_the_runs_before_taught_also_after_a_break(monkeypatch, tmp_path):
    driven = []

    def run(campaign, index, company):
        driven.append((index, campaign.model))
        return run_one(campaign, index, company)

    monkeypatch.setattr(learning, "run_one", run)
    campaign, kept = Campaign(runs=2, rig="toy", goal=5, seed=11), tmp_path / "kept"
    outcomes, lessons = evaluate_learning(campaign, kept)
    more, further = evaluate_learning(replace(campaign, runs=1), kept)
    assert [o.seed for o in (*outcomes, *more)] == [11, 12, 13]
    assert [lesson.run for lesson in (*lessons, *further)] == [1, 2, 3]
    balls = [model.balls[2] for _, model in driven]
    assert balls[0] != balls[1] != balls[2] != balls[0]
    with pytest.raises(InputError, match="leave --model out"), open_learner("toy", "toy", MAZE, kept):
        pass
    with pytest.raises(InputError, match="under way"), open_learner(None, "toy", MAZE, kept):
        evaluate_learning(campaign, kept)


def test_a_folder_with_other_things_is_left_alone(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="holds other things"), open_learner(None, "toy", MAZE, tmp_path):
        pass
    with pytest.raises(InputError), open_learner("nosuch", "toy", MAZE, tmp_path / "new"):
        pass
    assert not (tmp_path / "new").exists()


@pytest.mark.slow
def test_evaluate_learns_keeps_reports_and_tells(monkeypatch, capsys, tmp_path):
    kept, page = tmp_path / "kept", tmp_path / "page.html"
    arguments = ("evaluate", "--learn", "--rig", "toy", "--from", "ring4", "--runs", 2, "--json")
    code, out, _ = call(monkeypatch, capsys, *arguments, "-o", kept, "--report", page)
    document = json.loads(out)
    assert code == 0
    assert document["learning"]["model"] == str(kept)
    assert [x["run"] for x in document["learning"]["runs"]] == [1, 2]
    assert page.exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ["evaluate", "--learn", "--workers", "2"],
        ["evaluate", "--learn", "--faults", "all"],
        ["evaluate", "--learn", "--dask", "local"],
        ["evaluate", "--learn", "--store", "runs/kept"],
        ["evaluate", "-o", "somewhere"],
        ["evaluate", "--learn", "-o", "FILE/none"],
        ["evaluate", "--learn", "--rig", "FILE"],
    ],
)
def test_what_cannot_be_learned_is_one_line_and_two(monkeypatch, capsys, tmp_path, arguments):
    bare = tmp_path / "bare.yaml"
    bare.write_text("wall_grip: 0.3\n")
    code, out, err = call(monkeypatch, capsys, *[a.replace("FILE", str(bare)) for a in arguments])
    assert (code, out) == (2, "")
    assert len([line for line in err.splitlines() if line.startswith("mazeplan: ")]) == 1
