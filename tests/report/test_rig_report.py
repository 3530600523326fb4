"""The page of a whole rig's diagnosis: what is wrong, and what to do, in this order."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from commands import call

from mazeplan.apps.report.diagnosis import diagnosis_section, write_diagnosis
from mazeplan.apps.report.inputs import read_input
from mazeplan.core.errors import InputError
from mazeplan.maze.mapfile import load_map

SENTENCE = "The rig differs from the reference: dry friction (coefficient from 0.48 to 1.46 ± 0.01 rad/s²)."
MAP = Path(str(load_map("cme").source)).read_text()
CURVE = [0.01, 0.05, 0.2]
CELLS = [[None, 0.001, 0.004], [0.002, 0.009, 0.001]]
PLACES = {"ahead": 2, "rings": [[0.02, 0.03], [0.03, 0.04]], "before": CELLS, "after": CELLS}
SPOT = {"name": "surface_bump", "x": 0.04, "y": 0.06, "width": 0.01}
SECTOR = {"name": "local_friction", "centre": 1.0, "half": 0.3, "inner": 0.03, "outer": 0.04}
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


def evidence(**changes):
    both = {"before": CURVE, "after": CURVE}
    return {
        "kind": "rig", "title": "friday.mcap", "map": MAP, "ahead_s": [0.03, 0.07, 0.1], "error": both, "low": both,
        "high": both, "block_s": 10.0, "gain": [30.0, -2.0, 5.0], "gain_t": [5.0, 15.0, 25.0], "white": 0.02,
        "alike_from": 0.3, "places": PLACES,
        "marks": [SPOT, SECTOR], "correlation": both, "spectrum": None, "remaining": {"then": 1.02, "after": 1.08},
    } | changes  # fmt: skip


def written(folder, told=None, shown=None):
    write_diagnosis(told or document(), shown or evidence(), folder / "report.html")
    return (folder / "report.html").read_text()


def titles(page):
    return re.findall(r"<figcaption>(.*?)</figcaption>", page)


@pytest.fixture
def page(tmp_path):
    return written(tmp_path)


@pytest.mark.slow
def test_first_what_is_wrong_then_what_to_do_then_the_evidence(page):
    told = ("dry friction (coefficient from", "What to do", "Clean the ball", "What differs", "Mean error", "<img",
            "What remains")  # fmt: skip
    where = [page.index(text) for text in told]
    assert where == sorted(where)
    for riddle in ("-2 log L", "placebo", "innovation", "gates"):
        assert riddle not in page


@pytest.mark.slow
def test_a_size_stands_beside_what_it_was_and_its_ring_first(page):
    row = re.search(r"<tr>(?:(?!</tr>).)*dry friction.*?</tr>", page, re.S)
    assert row is not None
    for cell in (">0.480", ">1.460", ">2, 1<", ">yes<"):
        assert cell in row[0]


def test_people_read_degrees_mm_and_ms(tmp_path):
    delay = {
        "name": "sensor_delay", "known_before": {"delay": 0.02}, "rings": {"1": {}}, "planned": False,
        "why_not": "no plan has it", "parameters": {"delay": {"value": 0.05, "stderr": 0.001, "unit": "s"}},
    }  # fmt: skip
    page = written(tmp_path, document(effects=[delay]))
    for text in ("20.0\u00a0ms", "50.0\u00a0±\u00a01.0\u00a0ms", "no: no plan has it", ">24.1<", ">4.0<"):
        assert text in page


@pytest.mark.slow
def test_it_has_its_pictures_and_loads_nothing(page):
    assert page.count("data:image/svg+xml;base64,") == 2
    assert "http" not in re.sub(r"base64,[^\"]*", "", page).replace("http-equiv", "")
    assert "black outline" in titles(page)[1]


def test_a_record_too_short_for_the_map_has_none(tmp_path):
    empty = [[None] * 3, [None] * 3]
    page = written(tmp_path, None, evidence(places={**PLACES, "before": empty, "after": empty}))
    assert page.count("data:image/svg+xml;base64,") == 1
    assert not any("Where is the prediction off" in title for title in titles(page))


@pytest.mark.slow
@pytest.mark.parametrize("verdict", ["nothing_missing", "effect_found", "ambiguous", "unknown_effect"])
def test_every_verdict_has_a_page_in_words(tmp_path, verdict):
    page = written(tmp_path, document(verdict), evidence(marks=[]))
    assert page.count("data:image/svg+xml;base64,") == 2
    assert ("with what was found" in page) == (verdict != "nothing_missing")
    assert not any("outline" in title for title in titles(page))


def folder_of(path, told, shown):
    path.mkdir()
    (path / "report.json").write_text(json.dumps(told))
    if shown is not None:
        (path / "evidence.json").write_text(json.dumps(shown))
    return path


@pytest.mark.parametrize(("shown", "pictures"), [(evidence(), 2), (None, 0)])
def test_report_draws_a_folder_and_a_document_alone(monkeypatch, capsys, tmp_path, shown, pictures):
    folder = folder_of(tmp_path / "out", document(), shown)
    code, _, err = call(monkeypatch, capsys, "report", str(folder), "-o", str(tmp_path / "page.html"))
    assert code == 0, err
    page = (tmp_path / "page.html").read_text()
    assert "Clean the ball" in page
    assert page.count("data:image/svg+xml;base64,") == pictures


@pytest.mark.slow
def test_navigations_of_improve_are_in_it(tmp_path):
    runs = {"success": 3, "runs": 4, "time_s": {"mean": 7.0, "best": 6.0, "worst": 9.0}}
    page = written(tmp_path, document(navigation={"before": runs, "after": runs}))
    assert "3 of 4" in page


def test_evidence_of_another_diagnosis_is_refused(tmp_path):
    other = {name: value for name, value in document().items() if name != "reference"}
    with pytest.raises(InputError, match="belongs to another"):
        diagnosis_section(*read_input(folder_of(tmp_path / "out", other, evidence())))
