"""`evaluate --store`, `--dask`, `--no-deadline`: commands that are killed, interrupted, given twice, or wrong."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from commands import call
from soon import soon

from mazeplan.resources import to_install

ROOT = Path(__file__).resolve().parents[2]
COUNTING = """\
import os

from mazeplan.testing.lightrig import LightRig


class Counting(LightRig):
    def reset(self, *, ring, theta, rng):
        super().reset(ring=ring, theta=theta, rng=rng)
        with open(os.environ["COUNT"], "a") as file:
            file.write(f"{theta:.5f}\\n")
"""
RUNS = 6
LIGHT = ("evaluate", "--rig", "mazeplan.testing.lightrig:LightRig", "--from", "ring4", "--no-deadline")
FAST = (*LIGHT, "--runs", "2", "--json")


def begun(count: Path) -> list[str]:
    return count.read_text().splitlines() if count.exists() else []


def test_a_killed_command_goes_on_and_computes_nothing_twice(tmp_path, monkeypatch, capsys):
    count = tmp_path / "count"
    (tmp_path / "counting_rig.py").write_text(COUNTING)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setenv("COUNT", str(count))
    command = ("evaluate", "--rig", "counting_rig:Counting", "--from", "ring4", "--no-deadline", "--runs", RUNS)
    paths = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    killed = subprocess.Popen(
        [sys.executable, "-m", "mazeplan", *map(str, command), "--store", "kept"],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env={**os.environ, "PYTHONPATH": paths},
    )  # fmt: skip
    assert soon(lambda: len(list(tmp_path.glob("kept/*.run-*.parquet"))) >= 2, 120.0)
    killed.kill()
    assert killed.wait() == -signal.SIGKILL
    kept = len(pd.read_parquet("kept"))
    before = len(begun(count))
    assert 2 <= kept < RUNS
    assert kept <= before <= kept + 1

    code, out, err = call(monkeypatch, capsys, *command, "--store", "kept", "--json")
    assert code == 0
    assert f"{kept} of {RUNS} runs are in kept already" in err
    assert len(begun(count)) == before + RUNS - kept
    assert list(pd.read_parquet("kept")["index"]) == list(range(RUNS))
    results = json.loads(out)["results"]
    assert [result["seed"] for result in results] == list(range(RUNS))

    code, out, err = call(monkeypatch, capsys, *command, "--store", "kept", "--json")
    assert json.loads(out)["results"] == results
    assert len(begun(count)) == before + RUNS - kept
    monkeypatch.delenv("COUNT")
    sys.modules.pop("counting_rig")


def test_an_interrupted_command_says_what_is_kept_and_how_to_go_on(tmp_path, monkeypatch, capsys):
    from mazeplan.campaign import store

    keep = store.Store.keep

    def interrupted(self, index, ran):
        if index == 1:
            raise KeyboardInterrupt
        keep(self, index, ran)

    monkeypatch.setattr(store.Store, "keep", interrupted)
    code, out, err = call(monkeypatch, capsys, *FAST, "--store", tmp_path)
    assert (code, out) == (130, "")
    assert f"1 of 2 runs are kept in {tmp_path}; the same command goes on with the others" in err
    assert "Traceback" not in err


def test_another_campaign_in_the_folder_is_said_in_one_line(tmp_path, monkeypatch, capsys):
    assert call(monkeypatch, capsys, *FAST, "--store", tmp_path)[0] == 0
    code, out, err = call(monkeypatch, capsys, *FAST, "--store", tmp_path, "--seed", "5")
    assert code == 0
    assert f"{tmp_path} has runs of another campaign, too, which stay apart: " in err
    assert "(other seed)" in err
    assert [result["seed"] for result in json.loads(out)["results"]] == [5, 6]
    table = pd.read_parquet(tmp_path)
    assert sorted(zip(table["seed"], table["campaign"] == table["campaign"].iloc[0], strict=True)) in (
        [(0, True), (1, True), (5, False), (6, False)],
        [(0, False), (1, False), (5, True), (6, True)],
    )


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--dask", "nowhere"), "--dask: got 'nowhere', expected local or an address such as tcp://scheduler:8786"),
        (("--dask", "tcp://h:1", "--workers", "2"), "--workers: got 2 with --dask tcp://h:1"),
        (("--store", "file"), "--store: got file: File exists; expected a folder that can be made"),
    ],
)
def test_wrong_words_are_one_line(words, told, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    code, out, err = call(monkeypatch, capsys, *FAST, *words)
    assert (code, out) == (2, "")
    assert told in err.splitlines()[-1]


@pytest.mark.parametrize(("package", "option"), [("pyarrow", "--store"), ("distributed", "--dask")])
def test_a_missing_extra_is_named(package, option, monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, package, None)
    code, _, err = call(monkeypatch, capsys, *FAST, option, tmp_path / "x" if option == "--store" else "local")
    assert code == 2
    assert err.splitlines()[-1].endswith(to_install("campaign"))


def test_a_broken_tree_is_named_as_it_lies_here_before_any_worker_sees_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("mine.xml").write_text("<root BTCPP_format='4'>\n<BehaviorTree ID='a'>\n<Fly/></BehaviorTree></root>")
    code, _, err = call(monkeypatch, capsys, *FAST, "--behavior", "mine.xml", "--workers", "2")
    assert code == 2
    assert err.splitlines()[-1].startswith("mazeplan: mine.xml:3:")


def test_no_deadline_lets_plans_take_as_long_as_they_do(monkeypatch, capsys, tmp_path):
    seen = []
    from mazeplan.campaign import single

    attempt = single.attempt_job
    monkeypatch.setattr(
        single, "attempt_job", lambda rig, setup, job, **more: seen.append(setup) or attempt(rig, setup, job)
    )
    call(monkeypatch, capsys, *LIGHT, "--runs", "1")
    call(monkeypatch, capsys, *[word for word in LIGHT if word != "--no-deadline"], "--runs", "1")
    with_none, usual = (setup.settings.leaves.travel.deadline_ms for setup in seen)
    assert with_none == 1e6 > usual
