"""`effect list`, `effect show`, and the page of the documentation that they write."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from mazeplan.physics.registry import EFFECTS

DOCS = Path(__file__).resolve().parents[2] / "docs" / "effects.md"
NAMED = [name for name, effect in EFFECTS.items() if effect.named]


def test_the_document_has_the_keys_of_the_contract(call):
    code, out, err = call("effect", "list", "--json")
    assert code == 0, err
    effects = {entry["name"]: entry for entry in json.loads(out)}
    assert set(NAMED) <= set(effects)
    for entry in effects.values():
        assert set(entry) == {"name", "acts_on", "formula", "parameters", "planned", "why_not"}
        assert entry["formula"], entry["name"]
        assert entry["planned"] == (entry["why_not"] is None)
        for p in entry["parameters"].values():
            assert set(p) == {"unit", "default", "low", "high", "smallest"}
            assert p["low"] <= p["default"] <= p["high"]
    assert effects["servo_gain"]["acts_on"] == "stage"
    assert effects["quadratic_drag"]["parameters"]["coefficient"]["unit"] == "1/rad"
    assert effects["table_rocking"]["planned"] is False


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
def test_an_effect_is_shown_with_formula_bounds_and_model_entry(call, name, words):
    code, out, err = call("effect", "show", name)
    assert code == 0, err
    assert all(word in out for word in words)


def test_your_own_effect_is_shown(call, monkeypatch, tmp_path):
    (code,) = re.findall("```python\n(.*?)```", DOCS.read_text(), re.S)
    (tmp_path / "fans.py").write_text(code)
    monkeypatch.chdir(tmp_path)
    status, out, err = call("effect", "show", "wind", "--effects", "fans:effects", "--json")
    assert status == 0, err
    assert json.loads(out)["formula"] == "-force*sin(theta)"
