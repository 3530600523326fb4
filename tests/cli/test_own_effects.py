"""Your own effects, as the documentation shows them."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from plant import play
from ring_record import write_csv

from mazeplan.core.logs.table import Table
from mazeplan.learning.modelfile import load_model, save_model
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.registry import EFFECTS, make_term, own_effects

DOCS = Path(__file__).resolve().parents[2] / "docs" / "effects.md"
KNOWN = ("--radius", "0.0925", "--declare", "rolling_inertia.factor=0.7142857", "--declare",
         "viscous_friction.coefficient=0.35")  # fmt: skip


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("logs") / "log.csv"
    write_csv(Table(play(seed=3, seconds=90.0, wave=(0.0, -0.3, 0.0, 0.0))), path)
    return path


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (code,) = re.findall("```python\n(.*?)```", DOCS.read_text(), re.S)
    (tmp_path / "mine.py").write_text(code)
    (tmp_path / "bad.py").write_text("def nothing():\n    return [1]\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def windy(folder):
    """The folder of a model with wind in ring 1."""
    packaged = load_model("ideal")
    own_effects("mine:effects")
    balls = {**packaged.balls, 1: BallModel((*packaged.ball(1).effects, make_term("wind", {"force": 2.0})))}
    save_model(replace(packaged, balls=balls), folder / "windy")
    return folder / "windy"


@pytest.mark.slow
def test_your_own_effect_is_found_and_added_to_the_model(call, folder, log):
    code, out, err = call("diagnose", log, *KNOWN, "--effects", "mine:effects", "-o", folder / "out", "--json")
    assert code == 0, err
    document = json.loads(out)
    assert [e["name"] for e in document["effects"]] == ["wind"]
    assert document["effects"][0]["planned"] is True
    assert document["effects"][0]["parameters"]["force"]["value"] == pytest.approx(0.3, abs=0.01)
    found = {e.name: e.values() for e in load_model(document["model"]).ball(1).effects}
    assert found["wind"]["force"] == pytest.approx(0.3, abs=0.01)


@pytest.mark.slow
def test_a_model_with_it_navigates_replays_and_evaluates(call, folder, windy):
    run = ("--rig", "ideal", "--from", "ring1", "--to", "ring2", "--seed", "1")
    own = ("--model", windy, "--effects", "mine:effects")
    code, out, err = call("navigate", *run, *own, "--log", folder / "run.mcap", "--json")
    assert code in (0, 1), err
    with_wind = json.loads(out)
    code, out, err = call("navigate", *run, "--json")
    assert code == 0, err
    assert json.loads(out)["time_s"] != with_wind["time_s"], "the plan knows the wind"
    del EFFECTS["wind"]  # as in a new process
    code, out, err = call("log", "replay", folder / "run.mcap", "--json")
    assert code == 0, err
    assert json.loads(out)["identical"] is True
    code, out, err = call("evaluate", *run, *own, "--runs", "2", "--workers", "2", "--json")
    assert code in (0, 1), err
    assert json.loads(out)["setup"]["effects"] == "mine:effects"
