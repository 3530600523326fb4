"""The page of a whole rig's diagnosis: what is wrong, and what to do, in this order."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from commands import call

from mazeplan.errors import InputError
from mazeplan.maze.mapfile import load_map
from mazeplan.report.diagnosis import write_diagnosis
from mazeplan.report.inputs import read_input

SENTENCE = "The record differs from the reference: dry friction (coefficient from 0.48 to 1.46 ± 0.01 rad/s^2)."
MAP = Path(str(load_map("cme").source)).read_text()
CURVE = [0.01, 0.05, 0.2]
CELLS = [[None, 1.0], [2.4, 0.9]]


def document(verdict="effect_found"):
    effect = {
        "name": "dry_friction", "known_before": {"coefficient": 0.48}, "rings": {"1": {}, "2": {}}, "planned": True,
        "parameters": {"coefficient": {"value": 1.46, "stderr": 0.01, "unit": "rad/s^2"}}, "before": 0.4, "after": 0.07,
    }  # fmt: skip
    found = verdict in ("effect_found", "ambiguous")
    return {
        "verdict": verdict, "sentence": SENTENCE, "effects": [effect] if found else [], "ambiguous_with": [],
        "unknown": {"description": "a force", "depends_on": []} if verdict == "unknown_effect" else None,
        "before": {"nrmse": None, "rollout20": 0.1, "rollout40": 0.42}, "after": {"nrmse": None, "rollout40": 0.07},
        "held_out": 0.5, "remaining": 1.08, "advice": ["Clean the ball and the floor, or use --model out/model."],
        "reference": "the reference", "notes": [], "model": "out/model", "report": "out/report.html", "rings": {},
    }  # fmt: skip


def evidence():
    both = {"before": CURVE, "after": CURVE}
    return {
        "kind": "rig", "title": "today.mcap", "map": MAP, "reach": 0.097, "ahead_s": [0.03, 0.07, 0.1],
        "error": both, "quartile": both, "block_s": 10.0, "gain": [30.0, -2.0], "white": 0.02,
        "left": {"before": CELLS, "after": CELLS}, "correlation": both, "remaining": {"then": 1.0, "after": 1.08},
    }  # fmt: skip


@pytest.fixture
def page(tmp_path):
    write_diagnosis(document(), evidence(), tmp_path / "report.html")
    return (tmp_path / "report.html").read_text()


def test_first_what_is_wrong_then_what_to_do_then_the_evidence(page):
    where = [page.index(text) for text in ("dry friction (coefficient from", "Clean the ball", "What differs", "<img")]
    assert where == sorted(where)
    assert "1.1 times the noise of the camera" in page
    for riddle in ("-2 log L", "placebo", "innovation", "gates"):
        assert riddle not in page


def test_a_size_stands_beside_what_it_was(page):
    row = re.search(r"<tr>(?:(?!</tr>).)*dry friction.*?</tr>", page, re.S)
    assert row is not None
    for cell in ("0.48", "1.460", "1, 2", "yes"):
        assert cell in row[0]


def test_it_has_its_pictures_and_loads_nothing(page):
    assert page.count("data:image/svg+xml;base64,") == 4
    assert "http" not in re.sub(r"base64,[^\"]*", "", page).replace("http-equiv", "")


@pytest.mark.parametrize("verdict", ["nothing_missing", "effect_found", "ambiguous", "unknown_effect"])
def test_every_verdict_has_a_page_in_words(tmp_path, verdict):
    write_diagnosis(document(verdict), {**evidence(), "gain": []}, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert verdict not in page
    assert page.count("data:image/svg+xml;base64,") == 3


def test_a_map_that_is_gone_leaves_the_page(tmp_path):
    write_diagnosis(document(), {**evidence(), "map": "rings: nowhere"}, tmp_path / "report.html")
    assert (tmp_path / "report.html").stat().st_size > 20_000


def test_the_folder_is_read_again_by_report(tmp_path, monkeypatch, capsys):
    (tmp_path / "report.json").write_text(json.dumps(document()))
    (tmp_path / "evidence.json").write_text(json.dumps(evidence()))
    code, _, err = call(monkeypatch, capsys, "report", str(tmp_path), "-o", str(tmp_path / "all.html"))
    assert code == 0, err
    assert "Clean the ball" in (tmp_path / "all.html").read_text()


@pytest.mark.parametrize(
    ("change", "message"),
    [({"error": {"before": [1.0], "after": CURVE}}, "got 1 values, expected 3"), ({"gain": 3}, "gain")],
)
def test_evidence_that_is_wrong_is_told_with_its_key(tmp_path, change, message):
    (tmp_path / "report.json").write_text(json.dumps(document()))
    (tmp_path / "evidence.json").write_text(json.dumps({**evidence(), **change}))
    with pytest.raises(InputError, match=message):
        read_input(tmp_path)
