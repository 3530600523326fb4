"""The page of a whole rig's diagnosis: what is wrong, and what to do, in this order."""

from __future__ import annotations

import json
import re

import pytest
from commands import call

from mazeplan.apps.report.diagnosis import diagnosis_section, write_diagnosis
from mazeplan.apps.report.inputs import read_input
from mazeplan.core.errors import InputError

SENTENCE = "The rig differs from the reference: dry friction (coefficient from 0.48 to 1.46 ± 0.01 rad/s²)."
CURVE = [0.01, 0.05, 0.2]
ADVICE = ["Clean the ball and the floor.", "Or plan with the new model: mazeplan navigate --rig RIG --model out/model."]


def document(verdict="effect_found", **changes):
    effect = {
        "name": "dry_friction", "known_before": {"coefficient": 0.48}, "rings": {"2": {}, "1": {}}, "planned": True,
        "parameters": {"coefficient": {"value": 1.46, "stderr": 0.01, "unit": "rad/s^2"}}, "before": 0.4, "after": 0.07,
    }  # fmt: skip
    found = verdict in ("effect_found", "ambiguous")
    return {
        "verdict": verdict, "sentence": SENTENCE, "effects": [effect] if found else [], "ambiguous_with": [],
        "unknown": {"description": "a force", "depends_on": []} if verdict == "unknown_effect" else None,
        "before": {"nrmse": None, "rollout20": 0.1, "rollout40": 0.42}, "after": {"nrmse": None, "rollout40": 0.07},
        "held_out": 0.5, "remaining": 1.08, "advice": ADVICE,
        "reference": "the reference", "notes": [], "model": "out/model", "report": "out/report.html", "rings": {},
    } | changes  # fmt: skip


def evidence():
    both = {"before": CURVE, "after": CURVE}
    ahead = {"ahead_s": [0.03, 0.07, 0.1], "error": both, "low": both, "high": both}
    return {"kind": "rig", "title": "friday.mcap", **ahead}


def written(folder, told=None, shown=None):
    write_diagnosis(told or document(), shown or evidence(), folder / "report.html")
    return (folder / "report.html").read_text()


def test_first_what_is_wrong_then_what_to_do_then_the_evidence(tmp_path):
    page = written(tmp_path)
    told = ("dry friction (coefficient from", "Clean the ball", "What was found", "On parts that", "<img")
    where = [page.index(text) for text in told]
    assert where == sorted(where)
    row = re.search(r"<tr>(?:(?!</tr>).)*dry friction.*?</tr>", page, re.S)
    assert row is not None
    for cell in (">0.48", ">1.460", ">yes<"):
        assert cell in row[0]
    assert page.count("data:image/svg+xml;base64,") == 1
    assert "http" not in re.sub(r"base64,[^\"]*", "", page).replace("http-equiv", "")


@pytest.mark.parametrize("verdict", ["nothing_missing", "ambiguous", "unknown_effect"])
def test_every_verdict_has_a_page(tmp_path, verdict):
    assert SENTENCE in written(tmp_path, document(verdict))


def folder_of(path, told, shown):
    path.mkdir()
    (path / "report.json").write_text(json.dumps(told))
    if shown is not None:
        (path / "evidence.json").write_text(json.dumps(shown))
    return path


@pytest.mark.parametrize(("shown", "pictures"), [(evidence(), 1), (None, 0)])
def test_report_draws_a_folder_and_a_document_alone(monkeypatch, capsys, tmp_path, shown, pictures):
    folder = folder_of(tmp_path / "out", document(), shown)
    code, _, err = call(monkeypatch, capsys, "report", str(folder), "-o", str(tmp_path / "page.html"))
    assert code == 0, err
    page = (tmp_path / "page.html").read_text()
    assert "Clean the ball" in page
    assert page.count("data:image/svg+xml;base64,") == pictures


def test_navigations_of_improve_are_in_it(tmp_path):
    runs = {"success": 3, "runs": 4, "time_s": {"mean": 7.0, "best": 6.0, "worst": 9.0}}
    page = written(tmp_path, document(navigation={"before": runs, "after": runs}))
    assert "3 of 4" in page


def test_evidence_of_another_diagnosis_is_refused(tmp_path):
    other = {name: value for name, value in document().items() if name != "reference"}
    with pytest.raises(InputError, match="belongs to another"):
        diagnosis_section(*read_input(folder_of(tmp_path / "out", other, evidence())))


def test_a_round_of_improve_is_read_as_the_whole_document_is(tmp_path):
    one = {"diagnosis": {"verdict": "effect_found"}, "navigation": None, "compared": None}
    (tmp_path / "round.json").write_text(json.dumps(one))
    (tmp_path / "all.json").write_text(json.dumps({"rounds": [one]}))
    (alone,), (inside,) = read_input(tmp_path / "round.json"), read_input(tmp_path / "all.json")
    assert (alone.kind, alone.document) == (inside.kind, inside.document)
    assert alone.kind == "diagnosis"
