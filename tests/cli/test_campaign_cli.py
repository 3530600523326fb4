"""`evaluate --store`, `--dask` and `--no-deadline`."""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path

import pandas as pd
import pytest
from commands import start
from soon import soon

from mazeplan.run.campaign import store
from mazeplan.run.campaign.store import runs_table

ROOT = Path(__file__).resolve().parents[2]
COUNTING = """\
import os

from mazeplan.apps.testing.lightrig import LightRig


class Counting(LightRig):
    def reset(self, *, ring, theta, rng):
        super().reset(ring=ring, theta=theta, rng=rng)
        with open(os.environ["COUNT"], "a") as file:
            file.write(f"{theta:.5f}\\n")
"""
RUNS = 40  # of .08 s each: a busy machine has time to stop the command before the last
LIGHT = ("evaluate", "--rig", "mazeplan.apps.testing.lightrig:LightRig", "--from", "ring4")
FAST = (*LIGHT, "--no-deadline", "--runs", "2", "--json")


@pytest.mark.slow
def test_a_killed_command_continues_and_computes_nothing_twice(tmp_path, monkeypatch, call):
    count = tmp_path / "count"
    (tmp_path / "counting_rig.py").write_text(COUNTING)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setenv("COUNT", str(count))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))
    command = ("evaluate", "--rig", "counting_rig:Counting", "--from", "ring4", "--no-deadline", "--runs", RUNS)
    killed = start(*command, "--store", "kept")
    assert soon(lambda: sum(len(path.read_text().splitlines()) for path in tmp_path.glob("kept/*.jsonl")) > 2, 120.0)
    killed.kill()
    killed.communicate()
    assert killed.returncode == -signal.SIGKILL
    kept = len(runs_table(Path("kept")))
    before = len(count.read_text().splitlines())
    assert 2 <= kept < RUNS
    assert kept <= before <= kept + 1

    code, out, err = call(*command, "--store", "kept", "--json")
    assert code == 0
    assert f"{kept} of {RUNS} runs are in kept already" in err
    assert list(pd.read_parquet("kept/runs.parquet")["index"]) == list(range(RUNS))
    results = json.loads(out)["results"]
    assert [result["seed"] for result in results] == list(range(RUNS))
    assert json.loads(call(*command, "--store", "kept", "--json")[1])["results"] == results
    assert len(count.read_text().splitlines()) == before + RUNS - kept
    sys.modules.pop("counting_rig")


def test_ctrl_c_keeps_runs_and_names_the_way_to_continue(tmp_path, monkeypatch, call):
    keep = store.Store.keep

    def interrupted(self, index, ran):
        if index == 1:
            raise KeyboardInterrupt
        keep(self, index, ran)

    monkeypatch.setattr(store.Store, "keep", interrupted)
    code, out, err = call(*FAST, "--store", tmp_path)
    assert (code, out) == (130, "")
    assert f"1 of 2 runs are kept in {tmp_path}; the same command continues with the others" in err
    assert "Traceback" not in err
