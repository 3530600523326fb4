"""`effect list`, `effect show`, and the page about effects that is written by them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from commands import call

from mazeplan.physics.registry import EFFECTS

DOCS = Path(__file__).resolve().parents[2] / "docs" / "effects.md"


def test_the_list_tells_of_every_effect_what_contract_and_reader_need(monkeypatch, capsys):
    code, out, err = call(monkeypatch, capsys, "effect", "list", "--json")
    assert code == 0, err
    told = {entry["name"]: entry for entry in json.loads(out)}
    assert {name for name, e in EFFECTS.items() if e.named} <= set(told)
    for entry in told.values():
        assert set(entry) == {"name", "acts_on", "formula", "parameters", "planned", "why_not"}
        assert entry["formula"], entry["name"]
        assert entry["planned"] == (entry["why_not"] is None)
        for p in entry["parameters"].values():
            assert set(p) == {"unit", "default", "low", "high", "smallest"}
            assert p["low"] <= p["default"] <= p["high"]
    assert told["servo_gain"]["acts_on"] == "stage"
    assert told["quadratic_drag"]["parameters"]["coefficient"]["unit"] == "1/rad"
    assert told["table_rocking"]["planned"] is False


def test_the_list_for_people_has_a_line_for_each_and_says_what_no_plan_can_use(monkeypatch, capsys):
    _, out, _ = call(monkeypatch, capsys, "effect", "list")
    lines = {line.split()[0]: line for line in out.splitlines()}
    assert set(lines) >= {name for name, e in EFFECTS.items() if e.named}
    assert "not planned with: " in lines["table_rocking"]
    assert "not planned with" not in lines["dry_friction"]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("quadratic_drag", ["-coefficient*size(theta_dot) * theta_dot", "1/rad; 0; 0 to 5; 0.01",
                            "{type: quadratic_drag, coefficient: 0}"]),
        ("tilt_offset", ["beta + (beta), gamma + (gamma)", "down at +x"]),
        ("axis_coupling", ["acts on    stage", "stage.beta.coupling: beta_from_gamma"]),
        ("friction_drift", ["planned    no: a plan does not know the time"]),
    ],
)  # fmt: skip
def test_one_effect_is_shown_with_formula_bounds_and_its_place_in_a_model(monkeypatch, capsys, name, words):
    code, out, err = call(monkeypatch, capsys, "effect", "show", name)
    assert code == 0, err
    for word in words:
        assert word in out


def test_an_unknown_effect_is_one_line_and_two(monkeypatch, capsys):
    code, out, err = call(monkeypatch, capsys, "effect", "show", "magic")
    assert (code, out) == (2, "")
    assert "got effect 'magic', expected one of rolling_inertia" in err
    assert len(err.strip().splitlines()) == 1


def test_an_effect_of_ones_own_is_in_the_list(monkeypatch, capsys, tmp_path):
    (code,) = re.findall("```python\n(.*?)```", DOCS.read_text(), re.S)
    (tmp_path / "fans.py").write_text(code)
    monkeypatch.chdir(tmp_path)
    status, out, err = call(monkeypatch, capsys, "effect", "show", "wind", "--effects", "fans:effects", "--json")
    assert status == 0, err
    assert json.loads(out)["formula"] == "-force*sin(theta)"


def test_the_page_about_effects_is_the_registry(monkeypatch, capsys):
    _, out, _ = call(monkeypatch, capsys, "effect", "list", "--markdown")
    table = [line for line in out.splitlines() if line.startswith("|")]
    (shown,) = re.findall(r"^\| name \|.*?\n(?=\n)", DOCS.read_text(), re.S | re.M)
    named = ("| name |", "|---|", *(f"| {name} |" for name, e in EFFECTS.items() if e.named))
    expected = [line for line in table if line.startswith(named)]
    assert shown.splitlines() == expected
    assert all(line.count("|") == 6 for line in expected), "no formula with a bar in it"
