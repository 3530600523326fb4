"""`navigate` and `evaluate`: results, exit statuses, notes."""

from __future__ import annotations

import json

import pytest

from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.learning.modelfile import load_model

BROKEN = """
from mazeplan.core.errors import RigError

class Broken:
    rate_hz = 30.0
    def __init__(self, maze, settings): pass
    def reset(self, *, ring, theta, rng): pass
    def observe(self): raise RigError("serial line: no answer from /dev/ttyACM0")
    def command(self, u_beta, u_gamma): pass
    def level(self): pass
    def close(self): pass
"""


def test_a_run_arrives_and_writes_its_log(call, tmp_path):
    log = tmp_path / "run.mcap"
    code, out, err = call("navigate", "--from", "ring4", "--rig", "ideal", "--log", log, "--json")
    document = json.loads(out)
    assert code == 0
    assert document["success"]
    assert "arrived" in err
    assert read_log(log).result["time_s"] == document["time_s"]


def test_a_run_that_does_not_arrive_is_status_1_and_names_the_reason(call):
    code, out, _ = call("navigate", "--rig", "ideal", "--time-limit", "0.3", "--json")
    assert code == 1
    assert json.loads(out)["reason"] == "out_of_time"


def test_a_rig_that_fails_is_status_3(call, monkeypatch, tmp_path):
    (tmp_path / "broken_rig.py").write_text(BROKEN)
    monkeypatch.chdir(tmp_path)
    code, _, err = call("navigate", "--rig", "broken_rig:Broken")
    assert code == 3
    assert "no answer" in err


def test_evaluate_prints_a_summary(call):
    arguments = ("evaluate", "--rig", "ideal", "--from", "ring4", "--runs", "2")
    code, out, _ = call(*arguments)
    assert code == 0
    assert "2 of 2 arrived" in out
    assert "tick" in out
    assert json.loads(call(*arguments, "--json")[1])["success"] == 2
    assert call(*arguments, "--time-limit", "0.1")[0] == 1


def test_a_rig_without_a_model_gives_a_note(call, tmp_path):
    rig = tmp_path / "own.yaml"
    for text, noted in (("camera_noise_mm: 0.1\n", True), ("model: ideal\n", False)):
        rig.write_text(text)
        code, _, err = call("navigate", "--rig", rig, "--from", "ring4")
        assert (code, "no model for rig" in err) == (0, noted)


@pytest.mark.slow
def test_a_model_is_learned_first_and_used_the_next_time(call, tmp_path, monkeypatch):
    monkeypatch.setattr("mazeplan.apps.cli.navigate.LEARNING_S", 45.0)
    folder = tmp_path / "model"
    first, out, err = call("navigate", "--rig", "toy", "--learn", folder, "--seed", "3", "--json")
    assert json.loads(out)["success"]
    assert first == 0
    assert f"wrote {folder}" in err
    assert load_model(folder).body is not None
    record = (folder / "record.mcap").stat().st_mtime_ns
    again, _, err = call("navigate", "--rig", "toy", "--learn", folder, "--seed", "4")
    assert again == 0
    assert "wrote" not in err
    assert (folder / "record.mcap").stat().st_mtime_ns == record


def test_a_folder_of_other_things_and_a_wrong_rig_are_refused_before_anything_is_written(call, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    code, _, err = call("navigate", "--learn", tmp_path)
    assert code == 2
    assert str(tmp_path) in err
    assert call("navigate", "--rig", "nowhere", "--learn", tmp_path / "new")[0] == 2
    assert not (tmp_path / "new").exists()
