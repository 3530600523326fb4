"""`evaluate --faults`."""

from __future__ import annotations

import json

import pytest

FEW = """faults:
  - {kind: opening_closed, at_s: 0.3}
  - {kind: observe_raises, at_s: 0.2, name: cable out}
"""
EVALUATE = ("evaluate", "--rig", "ideal", "--from", "ring3")


@pytest.fixture
def few(tmp_path):
    path = tmp_path / "few.yaml"
    path.write_text(FEW)
    return path


@pytest.mark.slow
def test_the_document_has_the_keys_of_evaluate_and_the_faults(call, few):
    code, out, _ = call(*EVALUATE, "--faults", few, "--runs", "2", "--seed", "9", "--json")
    document = json.loads(out)
    assert code == 0
    assert {"runs", "success", "time_s", "failures", "planner_ms", "results", "faults"} <= set(document)
    assert (document["runs"], document["success"]) == (4, 2)
    assert [row["fault"] for row in document["faults"]] == ["opening_closed", "cable out"]
    assert [run["seed"] for run in document["results"]] == [9, 10, 9, 10]
    first = document["results"][0]
    assert first["faults"] == [{"kind": "opening_closed", "at_s": 0.3, "duration_s": None, "size": None, "unit": None}]
    assert (first["noticed_as"], first["wrong"]) == ("opening_closed", [])


def test_a_run_without_recovery_is_status_1(call, few):
    code, out, _ = call("evaluate", "--rig", "ideal", "--faults", few, "--runs", "1", "--time-limit", "0.5")
    assert code == 1
    assert "out_of_time 1" in out


@pytest.mark.slow
def test_kept_runs_are_not_repeated(call, monkeypatch, few, tmp_path):
    arguments = (*EVALUATE, "--faults", few, "--json", "--no-deadline", "--store", tmp_path / "kept", "--runs")
    code, out, err = call(*arguments, "1")
    assert (code, "already" in err) == (0, False)
    first = json.loads(out)
    with monkeypatch.context() as patched:
        patched.setattr("mazeplan.run.campaign.one_run.run_one", lambda *task: pytest.fail("was kept"))
        code, out, err = call(*arguments, "1")
    assert code == 0
    assert f"2 of 2 runs are in {tmp_path / 'kept'} already" in err
    assert json.loads(out) == first
    few.write_text(FEW + "  - {kind: ball_pushed, at_s: 0.3}\n")  # one more fault, and one more run of each
    code, out, err = call(*arguments, "2")
    assert code == 0
    assert "2 of 6 runs are in" in err
    more = json.loads(out)
    assert [more["results"][k] for k in (0, 2)] == first["results"]
    runs = {row["fault"]: row["runs"] for row in more["faults"]}
    assert runs == {"opening_closed": 2, "cable out": 2, "ball_pushed": 2}
