"""The functions of Python: what they return is what the command of the same name prints with --json."""

from __future__ import annotations

import json
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pandas as pd
import pytest
from commands import call
from planar_rig import PlanarRig
from plant import play
from ring_record import ring_table, write_csv

import mazeplan
from mazeplan.core.errors import InputError
from mazeplan.core.logs.table import Table, as_table, read_table
from mazeplan.learning import comparison

MAZE = mazeplan.load_map("cme")
LIGHT = "mazeplan.apps.testing.lightrig:LightRig"
FACTORS = {"t": ("time", "ms", 1e3), "theta": ("angle", "deg", 180.0 / np.pi), "x": ("east", "mm", 1e3),
           "y": ("north", "cm", 1e2), "beta": ("beta_deg", "", 180.0 / np.pi)}  # fmt: skip
TIMES = ("planner_ms", "tick_ms", "log", "sha256", "file", "data", "source", "report", "model", "reference", "advice")


@pytest.fixture
def printed(monkeypatch, capsys):
    """The document of a command."""
    return lambda *words: json.loads(call(monkeypatch, capsys, *words, "--json")[1])


def in_other_units(table):
    """The columns of a table by other names and in other units, and `columns=` for them."""
    named = {name: FACTORS[name] for name in FACTORS if name in table}
    columns = {column: factor * table[name] for name, (column, _, factor) in named.items()}
    others = {name: column for name, column in table.columns.items() if name not in named}
    given = {name: f"{column}:{unit}" for name, (column, unit, _) in named.items() if unit}
    return columns | others, given


def assert_same(found, expected, rel=1e-3):
    """Two documents are the same, but for times of computing and names of files; numbers nearly so."""
    if isinstance(expected, dict):
        assert list(found) == list(expected)
        for key in expected:
            if key not in TIMES:
                assert_same(found[key], expected[key], rel)
    elif isinstance(expected, list):
        assert len(found) == len(expected)
        for mine, other in zip(found, expected, strict=True):
            assert_same(mine, other, rel)
    elif isinstance(expected, float):
        assert found == pytest.approx(expected, rel=rel, abs=1e-6)
    elif not isinstance(expected, str):
        assert found == expected


def shown(result, tmp_path):
    """A result has a page, words for a notebook, and cannot be changed."""
    page = result.report(tmp_path / "page.html")
    assert page.read_text(encoding="utf-8").startswith("<!")
    words, _, picture = result._repr_html_().partition("<br>")
    assert 50 < len(words) < 3000
    assert not picture or picture.startswith('<img src="data:image/svg+xml;base64,')
    with pytest.raises((FrozenInstanceError, AttributeError)):
        result.document = {}


def test_a_navigation(printed, tmp_path):
    result = mazeplan.navigate("ring4", "ring5", rig=LIGHT, seed=3, log=tmp_path / "run.mcap")
    document = printed("navigate", "--from", "ring4", "--to", "ring5", "--rig", LIGHT, "--seed", "3")
    assert_same(result.json(), document)
    shown(result, tmp_path)
    with pytest.raises(InputError, match="without a log"):
        replace(result, log=None).report(tmp_path / "none.html")


def test_an_evaluation(printed, tmp_path):
    done = mazeplan.evaluate(2, rig=LIGHT, start="ring4", deadline=False)
    document = printed("evaluate", "--runs", "2", "--rig", LIGHT, "--from", "ring4", "--no-deadline")
    assert_same(done.json(), document, rel=0.0)
    assert [result.time_s for result in done.results] == [run["time_s"] for run in document["results"]]
    shown(done, tmp_path)
    again = mazeplan.evaluate(2, rig=PlanarRig(MAZE), map=MAZE, start=4, deadline=False)  # one object for all runs
    assert_same(again.json()["results"], document["results"], rel=0.0)
    assert done.compare(again).json()["time_s"]["difference"] == 0.0
    for given in ({"workers": 2}, {"store": tmp_path / "kept"}):
        with pytest.raises(InputError, match="rig that is an object"):
            mazeplan.evaluate(2, rig=PlanarRig(MAZE), **given)


def test_a_record(printed, tmp_path):
    done = mazeplan.collect(tmp_path / "a.mcap", 3.0, rig=PlanarRig(MAZE), ring=2, seed=1)
    document = printed("collect", "-o", tmp_path / "b.mcap", "--seconds", "3", "--rig", LIGHT, "--ring", "2",
                       "--seed", "1")  # fmt: skip
    assert_same(done.json(), document)
    tables = [read_table(log) for log in (done.log, tmp_path / "b.mcap")]
    assert np.array_equal(tables[0]["x"], tables[1]["x"])
    shown(done, tmp_path)


@pytest.mark.slow
def test_a_model_from_a_table_in_other_units(printed, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "mazeplan.run.commands.learn.why_not_whole", lambda tables: "a reference takes longer than the model"
    )
    record = mazeplan.collect(tmp_path / "log.mcap", 60.0, rig=PlanarRig(MAZE), ring=2, seed=2)
    table = read_table(record.log)
    kept = ("t", "x", "y", "beta", "gamma", "u_beta", "u_gamma")
    plain = Table({name: table[name] for name in kept})
    write_csv(plain, tmp_path / "plain.csv")
    document = printed("learn", tmp_path / "plain.csv", "-o", tmp_path / "model", "--kind", "pi")
    other, columns = in_other_units(plain)
    done = mazeplan.learn(pd.DataFrame(other), kind="pi", columns=columns)
    assert_same(done.json(), document, rel=0.02)
    assert done.model.kind == "pi"
    shown(done, tmp_path)


@pytest.mark.slow
def test_a_comparison_of_a_table_in_other_units(printed, tmp_path, monkeypatch):
    pytest.importorskip("torch").set_num_threads(1)
    quick = replace(comparison.THOROUGH, starts=1, iterations=10, refinement=4)
    monkeypatch.setattr(comparison, "THOROUGH", quick)
    whole = comparison.block_bootstrap
    monkeypatch.setattr(comparison, "block_bootstrap", lambda *a: whole(*a, draws=100))
    plain = ring_table((2,), 30.0)
    write_csv(plain, tmp_path / "plain.csv")
    document = printed("compare", tmp_path / "plain.csv", "--kinds", "p,pi", "--most", "60")
    other, columns = in_other_units(plain)
    done = mazeplan.compare(other, columns=columns, kinds=("p", "pi"), most=60)
    assert_same(done.json(), document)
    shown(done, tmp_path)


@pytest.mark.slow
def test_a_diagnosis_of_a_table_in_other_units(printed, tmp_path):
    plain = Table(play(seed=3, seconds=60.0, dry=0.4))
    write_csv(plain, tmp_path / "plain.csv")
    known = {"rolling_inertia.factor": 5 / 7, "viscous_friction.coefficient": 0.35}
    words = [word for name, value in known.items() for word in ("--declare", f"{name}={value!r}")]
    document = printed("diagnose", tmp_path / "plain.csv", "--radius", "0.0925", *words)
    other, columns = in_other_units(plain)
    done = mazeplan.diagnose(other, radius=0.0925, declare=known, columns=columns)
    assert_same(done.json(), document)
    assert (done.verdict, [effect["name"] for effect in done.json()["effects"]]) == ("effect_found", ["dry_friction"])
    shown(done, tmp_path)


def test_improvement(printed, tmp_path, monkeypatch):
    navigation = {"runs": 2, "success": 2, "time_s": {"mean": 3.0}, "failures": {}, "planner_ms": {}, "tick_ms": {}}
    diagnosis = {
        "verdict": "effect_found", "sentence": "The model lacks x.", "effects": [], "model": "here/model", "advice": [],
    }  # fmt: skip
    rounds = [{"diagnosis": diagnosis, "navigation": {"before": navigation, "after": navigation}}]
    asked = []
    monkeypatch.setattr(
        "mazeplan.run.commands.improve.do_rounds",
        lambda loop, model, references: asked.append((loop, len(references))) or rounds,
    )
    columns = play(seed=3, seconds=5.0)
    done = mazeplan.improve(PlanarRig, runs=2, seconds=40.0, reference=[columns, pd.DataFrame(columns)])
    document = printed("improve", "--rig", "toy", "--runs", "2", "--seconds", "40")
    assert_same(done.json(), document)
    assert (asked[0][0].usual.runs, asked[0][0].seconds, asked[0][1]) == (2, 40.0, 2)
    assert "The model lacks x." in done._repr_html_()


def test_tables_in_memory_are_as_good_as_files(tmp_path):
    plain = Table(play(seed=3, seconds=5.0))
    write_csv(plain, tmp_path / "plain.csv")
    other, columns = in_other_units(plain)
    assert as_table(plain) is plain
    frame = as_table(pd.DataFrame(other), mazeplan.core.logs.columns.parse_columns(columns))
    for name in ("t", "theta", "beta", "gamma"):
        assert frame[name] == pytest.approx(read_table(tmp_path / "plain.csv")[name])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (7, "got int, expected a path, a Table, a dict of columns or a DataFrame"),
        ({"t": [0.0, 0.1], "theta": [0.0]}, "columns of 2 lengths"),
        ({"t": [0.0, 0.1], "theta": [0.0, 0.0], "beta": [0.0, "up"], "gamma": [0.0, 0.0]}, "beta: got .* a number"),
        ({"t": [0.0, 0.1], "theta": [0.0, 0.0], "beta": [0.0, 0.0]}, "missing columns: gamma"),
    ],
)
def test_what_is_no_table(given, said):
    with pytest.raises(InputError, match=said):
        as_table(given)


@pytest.mark.parametrize(
    ("act", "words"),
    [
        (lambda: mazeplan.navigate(time_limit=-1), "time_limit: got -1, expected a number > 0"),
        (lambda: mazeplan.navigate(seed="a"), "seed: got 'a', expected a whole number"),
        (lambda: mazeplan.evaluate(-4), "runs: got -4, expected a number > 0"),
        (lambda: mazeplan.collect("never.mcap", seconds=-3), "seconds: got -3, expected a finite number > 0"),
        (lambda: mazeplan.collect("never.mcap", place=True), "--place needs --rings"),
        (lambda: mazeplan.learn([], kind="xx"), "kind: got 'xx', expected one of p, pi"),
    ],
)
def test_a_wrong_argument_is_an_input_error(act, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=words):
        act()


def test_a_class_is_a_rig(tmp_path):
    assert mazeplan.navigate("ring4", rig=PlanarRig, model="ideal").rig == PlanarRig.__name__
    assert mazeplan.collect(tmp_path / "log.mcap", seconds=2, rig=PlanarRig).json()["rig"] == PlanarRig.__name__
