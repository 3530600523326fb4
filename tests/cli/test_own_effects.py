"""Effects of one's own, as the documentation shows them."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest
from commands import call
from plant import play
from ring_record import write_csv

from mazeplan.cli.owneffects import own_effects
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


HEAD = """
import math
from numba import njit
from mazeplan.diagnosis.library import Candidate, Spec

def one(f, name="mine", **specs):
    return Candidate(name, specs or {"c": Spec("1/s", 0.0, -5.0, 5.0, 1e-3, 0.05)}, term=f)

@njit
def fine(x, v, t, w, p):
    return p[0] * v
"""


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("@njit\ndef f(x, v, t, w, p):\n    return p[0] * math.sqrt(v)\neffects = one(f)",
         "the term of mine gives .*ValueError: math domain error at x -2.5"),
        ("@njit\ndef f(x, v, t, w, p):\n    return p[0] / (x - x)\neffects = one(f)", "mine gives nan at"),
        ("@njit\ndef f(x, v, t, w, p):\n    return p[0] * math.inf\neffects = one(f)", "mine gives (nan|inf) at"),
        ("@njit\ndef f(x, v, t, w, p):\n    return p[7] * v\neffects = one(f)", "IndexError"),
        ("@njit\ndef f(x, v, t, w, p):\n    return w[9] * v\neffects = one(f)", "IndexError"),
        ("@njit\ndef f(x, v, t, w, p):\n    return (v, v)\neffects = one(f)", "the term of mine gives .*TypeError"),
        ("@njit\ndef f(x, v, t, w):\n    return v\neffects = one(f)", "the term of mine gives .*TypeError"),
        ("@njit\ndef f(x, v, t, w, p):\n    return p[0] * float(f'{v:.3f}')\neffects = one(f)", "cannot be compiled"),
        ("effects = Candidate('mine', {}, term=fine)", "got no parameters of mine"),
        ("effects = one(fine, c=Spec('', 0.0, 5.0, -5.0, 1e-3))", r"mine\.c: got 5 to -5, default 0"),
        ("def effects():\n    raise RuntimeError('no fan')", r"effects: .*strange\.py:\d+: RuntimeError: no fan"),
        ("def effects():\n    return [one(fine), one(fine)]", "got the name 'mine' twice"),
        ("effects = one(fine, 'quadratic_drag')", "which the library has"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_an_effect_is_one_line_before_it_is_tried(folder, monkeypatch, capsys, code, said):
    (folder / "strange.py").write_text(HEAD + code)
    monkeypatch.delitem(sys.modules, "strange", raising=False)
    monkeypatch.syspath_prepend(str(folder))
    status, out, err = call(monkeypatch, capsys, "diagnose", "log.csv", *KNOWN, "--effects", "strange:effects")
    assert (status, out) == (2, "")
    assert re.search(said, err), err
    assert len(err.strip().splitlines()) == 1


def test_a_candidate_alone_is_an_effect(folder, monkeypatch):
    (folder / "single.py").write_text(HEAD + "effects = one(fine)")
    monkeypatch.syspath_prepend(str(folder))
    assert [c.name for c in own_effects("single:effects", ())] == ["mine"]
