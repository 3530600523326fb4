"""The folder of a model that learns: it goes on as if nothing had been between, for one program, rig and map at a time,
and what was changed in it by others is told."""

from __future__ import annotations

import shutil
from dataclasses import replace

import pytest
from commands import call

from mazeplan.core.errors import ModelError
from mazeplan.learning.modelfile import load_model, save_model
from mazeplan.learning.online_folder import read_about
from mazeplan.run.campaign import online_learning as learning
from mazeplan.run.campaign.evaluate import Campaign
from mazeplan.run.campaign.online_learning import LOCK, evaluate_learning, learning_alone


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A model folder with few rows, so that tests are quick."""
    model = load_model("toy")
    rows = {r: replace(p, inputs=p.inputs[::8], features=p.features[::8], alpha=p.alpha[::8])
            for r, p in model.processes.items()}  # fmt: skip
    folder = tmp_path_factory.mktemp("models") / "small"
    save_model(replace(model, processes=rows), folder)
    return folder


@pytest.fixture(scope="module")
def learned(tmp_path_factory, small):
    """A folder in which a model learned from two runs on the rig toy."""
    folder = tmp_path_factory.mktemp("learned") / "kept"
    evaluate_learning(Campaign(2, "toy", model=str(small), start=4, goal=5), folder)
    return folder


@pytest.fixture
def kept(learned, tmp_path):
    return shutil.copytree(learned, tmp_path / "kept")


def evaluated(monkeypatch, capsys, folder, *words):
    code, _, err = call(
        monkeypatch, capsys, "evaluate", "--learn", "--from", "ring4", "--runs", "1", "-o", folder, *words
    )
    return code, err


@pytest.mark.slow
def test_interrupted_and_gone_on_is_not_interrupted(small, tmp_path):
    campaign = Campaign(4, "toy", model=str(small), start=4, goal=5, seed=3, deadline=False)
    whole, _ = evaluate_learning(campaign, tmp_path / "whole")
    first, lessons = evaluate_learning(replace(campaign, runs=2), tmp_path / "parts")
    more, further = evaluate_learning(replace(campaign, runs=2, model=None), tmp_path / "parts")
    assert [lesson.run for lesson in (*lessons, *further)] == [1, 2, 3, 4]
    for one, other in zip((*first, *more), whole, strict=True):
        assert (one.seed, one.start, one.success) == (other.seed, other.start, other.success)
        assert one.time_s == pytest.approx(other.time_s)
    assert len({r.start.theta for r in whole if r.start}) == 4


def test_ctrl_c_tells_what_is_kept_and_how_it_goes_on(monkeypatch, capsys, small, tmp_path):
    ran = learning.run_one

    def run(campaign, index, model, ticks):
        if index == 1:
            raise KeyboardInterrupt
        return ran(campaign, index, model, ticks)

    monkeypatch.setattr("mazeplan.run.campaign.online_learning.run_one", run)
    folder = tmp_path / "kept"
    arguments = ["evaluate", "--learn", "--model", small, "--from", "ring4", "--runs", "3", "-o", folder]
    code, _, err = call(monkeypatch, capsys, *arguments)
    assert code == 130
    assert f"1 of 3 runs are kept in {folder}; --runs 2 continues with the others" in err


def test_one_program_at_a_time(monkeypatch, capsys, kept):
    with learning_alone(kept):
        code, _, err = call(monkeypatch, capsys, "evaluate", "--runs", "1", "--learn", "--from", "ring4", "-o", kept)
        assert (code, err) == (2, f"mazeplan: -o: learning is under way in {kept} already\n")


def test_another_rig_or_map_is_refused_and_the_advice_helps(monkeypatch, capsys, kept, tmp_path):
    advice = "give another folder with -o, and this one with --model to begin with what it is now"
    code, err = evaluated(monkeypatch, capsys, kept, "--rig", "ideal")
    assert (code, err) == (2, f"mazeplan: --rig: got ideal, but {kept} has learned on toy: {advice}\n")
    for name in ("lopsided", "seven"):
        code, err = evaluated(monkeypatch, capsys, kept, "--map", name)
        assert (code, err) == (2, f"mazeplan: --map: got {name}, but {kept} has learned on cme: {advice}\n")
    code, err = evaluated(monkeypatch, capsys, tmp_path / "new", "--rig", "ideal", "--model", kept)
    assert code == 0, err
    assert f"{tmp_path / 'new'}, 1 runs so far" in err


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("model.yaml", lambda p: p.write_text("foo: ["), "was changed, but the model in use comes"),
        ("model.yaml", lambda p: p.write_text(p.read_text() + "\n"), "was changed, but the model in use comes"),
        ("ring3.npz", lambda p: p.unlink(), "ring3.npz"),
        ("ring3.npz", lambda p: p.write_bytes(b"x"), "ring3.npz"),
        ("learning.npz", lambda p: p.write_bytes(b"x"), "learning.npz: cannot be read"),
        ("start/model.yaml", lambda p: p.unlink(), "start"),
    ],
)
def test_what_was_damaged_or_edited_is_told(monkeypatch, capsys, kept, name, change, said):
    change(kept / name)
    before = {p.name: p.read_bytes() for p in kept.iterdir() if p.is_file() and p.name != LOCK}
    code, err = evaluated(monkeypatch, capsys, kept)
    assert code == 2
    assert said in err
    assert err.count("\n") == 1
    assert {p.name: p.read_bytes() for p in kept.iterdir() if p.is_file() and p.name != LOCK} == before


def test_killed_between_two_files_it_goes_on(monkeypatch, capsys, kept, tmp_path):
    before = shutil.copytree(kept, tmp_path / "before")
    assert evaluated(monkeypatch, capsys, kept)[0] == 0
    assert read_about(kept)["files"]["ring4.npz"] != read_about(before)["files"]["ring4.npz"]
    shutil.copy(before / "ring4.npz", kept)  # as it would be if it had not been replaced yet
    with pytest.raises(ModelError, match="not the file that was saved here"):
        load_model(kept)
    code, err = evaluated(monkeypatch, capsys, kept)
    assert code == 0, err
    assert "4 runs so far" in err
    assert load_model(kept).kind == "sp"


def test_a_folder_of_an_older_version_goes_on(monkeypatch, capsys, kept):
    import numpy as np

    with np.load(kept / "learning.npz") as held:
        arrays = {name: held[name] for name in held.files if name != "about"}
    np.savez(kept / "learning.npz", **arrays)
    code, err = evaluated(monkeypatch, capsys, kept)
    assert code == 0, err
    assert "3 runs so far" in err


def test_a_folder_with_other_things_is_left_alone(monkeypatch, capsys, tmp_path):
    full = tmp_path / "full"
    full.mkdir()
    (full / "notes.txt").write_text("mine")
    monkeypatch.chdir(full)
    for folder in (full, "."):
        code, err = evaluated(monkeypatch, capsys, folder)
        assert code == 2
        assert "holds other things (notes.txt), expected a new or an empty folder, or one of --learn" in err
        assert [p.name for p in full.iterdir()] == ["notes.txt"]
    code, err = evaluated(monkeypatch, capsys, tmp_path / "new", "--model", "nosuch")
    assert code == 2
    assert not (tmp_path / "new").exists()


def test_no_name_is_no_folder_not_the_current_one(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    code, _, err = call(monkeypatch, capsys, "evaluate", "--learn", "--from", "ring4", "-o", "")
    assert (code, err) == (2, "mazeplan: -o: got '', expected a folder\n")
    assert not list(tmp_path.iterdir())


def test_a_run_that_was_too_short_is_named_once(monkeypatch, capsys, small):
    arguments = ["evaluate", "--learn", "--model", small, "--runs", "1", "--time-limit", "0.2"]
    _, _, err = call(monkeypatch, capsys, *arguments)
    assert "run 1: not learned from: no ring has enough samples in a row" in err
    assert err.count("run 1") == 1


def test_what_was_learned_and_where_it_is_kept_is_said(monkeypatch, capsys, small):
    arguments = ["evaluate", "--learn", "--model", small, "--from", "ring4", "--runs", "1"]
    code, _, err = call(monkeypatch, capsys, *arguments)
    assert code == 0
    assert "samples of 1 of 1 runs: not kept (give -o FOLDER)" in err
