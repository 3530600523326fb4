"""`evaluate --faults`."""

from __future__ import annotations

import json

import pandas as pd
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


def test_the_table(call, few):
    code, out, _ = call(*EVALUATE, "--faults", few, "--runs", "1")
    assert code == 0
    head, closed, cable = out.splitlines()
    assert head.split()[:4] == ["fault", "arrived", "noticed", "after"]
    assert closed.split()[:3] == ["opening_closed", "1/1", "1/1"]
    assert "replan" in closed
    assert cable.startswith("cable out ")
    assert "0/1" in cable
    assert "rig_failed 1; cannot be survived: the rig itself says that it failed" in cable


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
    assert "out_of_time 1" in out.splitlines()[1]


@pytest.mark.parametrize(
    ("text", "more", "message"),
    [
        ("faults:\n  - {kind: smoke}\n", (), ":2: faults[0].kind: got 'smoke', expected one of frames_lost"),
        (None, (), "no such file"),
        (
            "faults:\n  - {kind: ball_stuck}\n",
            ("--rig", "planar_rig:PlanarRig"),
            "ball_stuck: this rig has no `inject`",
        ),
    ],
)
def test_bad_input(call, tmp_path, text, more, message):
    path = tmp_path / "bad.yaml"
    if text is not None:
        path.write_text(text)
    code, out, err = call("evaluate", *more, "--faults", path)
    assert (code, out) == (2, "")
    assert message in err.splitlines()[-1]


@pytest.mark.slow
def test_kept_runs_are_not_repeated(call, monkeypatch, few, tmp_path):
    arguments = (*EVALUATE, "--faults", few, "--json", "--no-deadline", "--store", tmp_path / "kept", "--runs")
    code, out, err = call(*arguments, "1")
    assert (code, "already" in err) == (0, False)
    first = json.loads(out)
    with monkeypatch.context() as patched:
        patched.setattr("mazeplan.run.campaign.faults.run_trial", lambda *task: pytest.fail("was kept"))
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


@pytest.mark.slow
def test_each_fault_is_its_own_campaign_in_the_folder(call, few, tmp_path):
    folder = tmp_path / "kept"
    plain = (*EVALUATE, "--runs", "1", "--store", folder)
    assert call(*plain)[0] == 0
    assert call(*plain, "--faults", few)[0] == 0
    table = pd.read_parquet(folder / "runs.parquet")
    assert sorted(table["fault"].fillna("-")) == ["-", "cable out", "opening_closed"]
    assert table["campaign"].nunique() == 3
    by = table.set_index("fault")
    assert by.loc["cable out", "reason"] == "rig_failed"
    assert json.loads(by.loc["opening_closed", "result"])["noticed_as"] == "opening_closed"
