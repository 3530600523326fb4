"""Your own effects, as the documentation shows them."""

from __future__ import annotations

import json
import re
import sys
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


def test_a_model_with_it_needs_it(refused, windy, monkeypatch):
    monkeypatch.delitem(EFFECTS, "wind")
    error = refused("navigate", "--rig", "ideal", "--model", windy)
    assert "got effect 'wind'" in error
    assert "an effect of your own needs --effects MODULE:FUNCTION" in error


@pytest.mark.parametrize("command", [("diagnose",), ("navigate",), ("evaluate",)])
@pytest.mark.parametrize(
    ("spec", "words"),
    [("mine", "expected MODULE:FUNCTION"), ("mine.py", "expected MODULE:FUNCTION, without .py"),
     ("mine.py:x", "expected the module's name without .py: mine"), ("nowhere:x", "'nowhere' cannot be imported"),
     ("mine:nothing", "gives no effects"),
     ("bad:nothing", "got 1, expected an Effect with a formula that acts on the ball")],
)  # fmt: skip
def test_modules_without_effects(refused, folder, log, command, spec, words):
    given = (log, *KNOWN) if command == ("diagnose",) else ()
    assert words in refused(*command, *given, "--effects", spec)


HEAD = """
from mazeplan.physics import Effect, Parameter, exp, sin, sqrt

def one(f, name="mine", **parameters):
    return Effect(name, parameters or {"c": Parameter("1/s", 0.0, -5.0, 5.0, 0.05)}, formula=f)

def fine(s, p):
    return p.c * s.theta_dot
"""


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("effects = one(lambda s, p: p.c * sqrt(s.theta_dot))", "formula of mine gives .*math domain error at theta"),
        ("effects = one(lambda s, p: p.c * s.theta_dot / s.t)", "the formula of mine gives .* t 0.0"),
        ("effects = one(lambda s, p: p.c * s.windspeed)", "formula of mine cannot be compiled: .*windspeed"),
        ("effects = one(lambda s: s.theta_dot)", "formula of mine cannot be compiled: .*TypeError"),
        ("effects = Effect('mine', {'c': 3.0}, formula=fine)", "got parameters .* of mine, expected a dictionary"),
        ("def effects():\n    raise RuntimeError('no fan')", r"effects: .*strange\.py:\d+: RuntimeError: no fan"),
        ("effects = one(fine, 'quadratic_drag')", "which the library has"),
        ("effects = Effect('mine', {'c': Parameter('', 0.0, -1.0, 1.0, 0.1)}, 'camera', fine)", "acts on the ball"),
    ],
)
def test_bad_effects_are_refused_before_the_search(refused, folder, log, monkeypatch, code, said):
    (folder / "strange.py").write_text(HEAD + code)
    monkeypatch.delitem(sys.modules, "strange", raising=False)
    monkeypatch.syspath_prepend(str(folder))
    assert re.search(said, refused("diagnose", log, *KNOWN, "--effects", "strange:effects"))


def test_one_effect_without_a_list_is_enough(folder, monkeypatch):
    (folder / "single.py").write_text(HEAD + "effects = one(fine)")
    monkeypatch.syspath_prepend(str(folder))
    assert [effect.name for effect in own_effects("single:effects")] == ["mine"]
