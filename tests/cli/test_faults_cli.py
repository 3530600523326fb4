"""`evaluate --faults` from the command line."""

from __future__ import annotations

import json

import pandas as pd
import pytest
from commands import call

FEW = """faults:
  - {kind: opening_closed, at_s: 0.3}
  - {kind: observe_raises, at_s: 0.2, name: cable out}
"""


@pytest.fixture
def few(tmp_path):
    path = tmp_path / "few.yaml"
    path.write_text(FEW)
    return path


def test_a_table_for_people(monkeypatch, capsys, few):
    arguments = ("evaluate", "--rig", "ideal", "--from", "ring3", "--faults", few, "--runs", "1")
    code, out, _ = call(monkeypatch, capsys, *arguments)
    assert code == 0
    head, closed, cable = out.splitlines()
    assert head.split()[:4] == ["fault", "arrived", "noticed", "after"]
    assert closed.split()[:3] == ["opening_closed", "1/1", "1/1"]
    assert "replan" in closed
    assert cable.startswith("cable out ")
    assert "0/1" in cable
    assert "rig_failed 1; not to be survived: the rig itself says that it failed" in cable


def test_one_document_with_the_keys_of_evaluate_and_the_faults(monkeypatch, capsys, few):
    arguments = (
        "evaluate",
        "--rig",
        "ideal",
        "--from",
        "ring3",
        "--faults",
        few,
        "--runs",
        "2",
        "--seed",
        "9",
        "--json",
    )
    code, out, _ = call(monkeypatch, capsys, *arguments)
    document = json.loads(out)
    assert code == 0
    assert {"runs", "success", "time_s", "failures", "planner_ms", "results", "faults"} <= set(document)
    assert (document["runs"], document["success"]) == (4, 2)
    assert [row["fault"] for row in document["faults"]] == ["opening_closed", "cable out"]
    assert [run["seed"] for run in document["results"]] == [9, 10, 9, 10]
    first = document["results"][0]
    assert first["faults"] == [{"kind": "opening_closed", "at_s": 0.3, "duration_s": None, "size": None, "unit": None}]
    assert first["noticed_as"] == "opening_closed"
    assert first["wrong"] == []


def test_a_run_that_does_not_get_over_what_it_should_is_one(monkeypatch, capsys, few):
    arguments = ("evaluate", "--rig", "ideal", "--faults", few, "--runs", "1", "--time-limit", "0.5")
    code, out, _ = call(monkeypatch, capsys, *arguments)
    assert code == 1
    assert "out_of_time 1" in out.splitlines()[1]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("faults:\n  - {kind: smoke}\n", ":2: faults[0].kind: got 'smoke', expected one of frames_lost"),
        (None, "no such file"),
    ],
)
def test_bad_input_is_one_line_and_two(monkeypatch, capsys, tmp_path, text, said):
    path = tmp_path / "bad.yaml"
    if text is not None:
        path.write_text(text)
    code, out, err = call(monkeypatch, capsys, "evaluate", "--faults", path)
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert said in err


def test_a_rig_in_which_nothing_can_be_broken(monkeypatch, capsys, tmp_path):
    path = tmp_path / "stuck.yaml"
    path.write_text("faults:\n  - {kind: ball_stuck}\n")
    code, _, err = call(monkeypatch, capsys, "evaluate", "--rig", "planar_rig:PlanarRig", "--faults", path)
    assert code == 2
    assert "mazeplan: ball_stuck: this rig has no `inject`; a simulated rig has" in err.splitlines()


def test_runs_with_faults_are_kept_and_not_done_again(monkeypatch, capsys, few, tmp_path):
    arguments = ("evaluate", "--rig", "ideal", "--from", "ring3", "--faults", few, "--json", "--no-deadline")
    kept = ("--store", tmp_path / "kept")
    code, out, err = call(monkeypatch, capsys, *arguments, "--runs", "1", *kept)
    assert (code, "already" in err) == (0, False)
    first = json.loads(out)
    monkeypatch.setattr("mazeplan.faultcampaign.run_trial", lambda *task: pytest.fail("was there already"))
    code, out, err = call(monkeypatch, capsys, *arguments, "--runs", "1", *kept)
    assert code == 0
    assert f"2 of 2 runs are in {tmp_path / 'kept'} already" in err
    assert json.loads(out) == first  # times of the processor, too: they are those of then
    monkeypatch.undo()
    few.write_text(FEW + "  - {kind: ball_pushed, at_s: 0.3}\n")  # one more, and one run more of each
    code, out, err = call(monkeypatch, capsys, *arguments, "--runs", "2", *kept)
    assert code == 0
    assert "2 of 6 runs are in" in err
    more = json.loads(out)
    assert [more["results"][k] for k in (0, 2)] == first["results"]
    assert {row["fault"]: row["runs"] for row in more["faults"]} == {
        "opening_closed": 2,
        "cable out": 2,
        "ball_pushed": 2,
    }


def test_each_fault_is_a_campaign_of_its_own_in_the_folder(monkeypatch, capsys, few, tmp_path):
    folder = tmp_path / "kept"
    plain = ("evaluate", "--rig", "ideal", "--from", "ring3", "--runs", "1", "--store", folder)
    assert call(monkeypatch, capsys, *plain)[0] == 0
    code, _, err = call(monkeypatch, capsys, *plain, "--faults", few)
    assert code == 0
    assert err.count("another campaign") == 1
    assert "(other fault)" in err
    table = pd.read_parquet(folder)
    assert sorted(table["fault"].fillna("-")) == ["-", "cable out", "opening_closed"]
    assert table["campaign"].nunique() == 3
    by = table.set_index("fault")
    assert by.loc["cable out", "reason"] == "rig_failed"
    assert json.loads(by.loc["opening_closed", "result"])["noticed_as"] == "opening_closed"
