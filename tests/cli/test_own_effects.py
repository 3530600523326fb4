"""Effects of one's own, as the documentation shows them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from commands import call
from plant import play
from ring_record import write_csv

from mazeplan.data.table import Table

DOCS = Path(__file__).resolve().parents[2] / "docs" / "effects.md"
KNOWN = ("--radius", "0.0925", "--declare", "rolling_inertia.factor=0.7142857", "--declare",
         "viscous_friction.coefficient=0.35")  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (code,) = re.findall("```python\n(.*?)```", DOCS.read_text(), re.S)
    (tmp_path / "mine.py").write_text(code)
    (tmp_path / "bad.py").write_text("def nothing():\n    return [1]\n")
    write_csv(Table(play(seed=3, seconds=90.0, wave=(0.0, -0.3, 0.0, 0.0))), tmp_path / "log.csv")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_an_effect_of_ones_own_is_found_beside_those_of_the_library(folder, monkeypatch, capsys):
    arguments = ("log.csv", *KNOWN, "--effects", "mine:effects", "-o", folder / "out", "--json")
    code, out, err = call(monkeypatch, capsys, "diagnose", *arguments)
    assert code == 0, err
    document = json.loads(out)
    assert [e["name"] for e in document["effects"]] == ["wind"]
    assert document["effects"][0]["parameters"]["force"]["value"] == pytest.approx(0.3, abs=0.01)
    assert "the new model lacks wind: a model file has no place for it" in document["notes"]


@pytest.mark.parametrize(
    ("spec", "words"),
    [("mine", "expected MODULE:FUNCTION"), ("nowhere:x", "'nowhere' cannot be imported"),
     ("mine:nothing", "gives no effects"),
     ("bad:nothing", "expected a Candidate with a term")],
)  # fmt: skip
def test_what_gives_none_is_one_line_and_two(folder, monkeypatch, capsys, spec, words):
    code, _, err = call(monkeypatch, capsys, "diagnose", "log.csv", *KNOWN, "--effects", spec)
    assert code == 2
    assert words in err
    assert len(err.strip().splitlines()) == 1
