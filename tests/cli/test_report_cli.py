"""`report`."""

from __future__ import annotations

import json
import re
from functools import partial

import pytest
from report_documents import EVIL, a_log, comparison, diagnosis, drawn, evaluation, evidence
from standalone_page import alone

from mazeplan.apps.report.run import run_section
from mazeplan.core.logs.run_log import RunLogWriter, read_log
from mazeplan.core.records import Command, Observation


@pytest.fixture
def report(call):
    return partial(call, "report")


def written(path, document):
    path.write_text(json.dumps(document))
    return path


@pytest.mark.slow
def test_each_kind_in_one_page_that_stands_alone(report, tmp_path):
    folder = tmp_path / "diagnosed"
    folder.mkdir()
    written(folder / "report.json", diagnosis())
    written(folder / "evidence.json", evidence(EVIL))
    inputs = [
        a_log(tmp_path / "run.mcap", rig=EVIL, detail=EVIL),
        written(tmp_path / "e.json", evaluation(EVIL)),
        written(tmp_path / "c.json", comparison()),
        folder,
        written(tmp_path / "f.json", evaluation("other")),
    ]
    code, out, err = report(*inputs, "-o", tmp_path / "all.html")
    assert (code, out, err) == (0, "", f"wrote {tmp_path / 'all.html'}\n")
    page = alone(tmp_path / "all.html")
    assert EVIL not in page
    assert page.count("&lt;script&gt;") >= 4
    titles = re.findall(r"<h2[^>]*>(.*?)</h2>", page)
    assert [title.split()[0] for title in titles] == ["Run", "Evaluations:", "Models,", "Diagnosis"]
    numbers = (
        "2.97 s",
        "3.33 s",
        "0.200 / 0.345</b><br><small>[0.31, 0.37]",
        "16.782",
        "0.412 ± 0.020 rad/s²",
    )
    for number in numbers:
        assert number in page.replace("\u00a0", " "), number


def test_the_rounds_of_improve(report, tmp_path):
    part = {"runs": 16, "success": 12, "time_s": {"mean": 3.217, "best": 2.0, "worst": None}}
    entry = {"diagnosis": diagnosis(), "navigation": {"before": part, "after": {**part, "success": 16}}}
    code, _, err = report(written(tmp_path / "i.json", {"rounds": [entry, entry]}), "-o", tmp_path / "i.html")
    assert code == 0, err
    page = alone(tmp_path / "i.html")
    assert len(re.findall("<h2[^>]*>Diagnosis of i, round", page)) == 2
    assert "16 of 16" in page
    assert "3.22 s" in page


def spoilt(document, *path, value):
    inner = document
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return document


BAD = {
    "no file": (None, "x.json: no such file, expected a run log, or the JSON of evaluate"),
    "no json": ("{", "x.json:1: is no JSON: "),
    "a list": ([], "got a list, expected a run log, or the JSON"),
    "nothing": ({}, "got JSON with nothing in it, expected"),
    "other keys": ({"<b>": 1}, "got JSON with the keys '<b>', expected"),
    "one run": ({"success": True, "rings": []}, "expected its log (navigate --log FILE.mcap)"),
    "no runs": ({"results": []}, "results: got no runs"),
    "a run": ({"results": [1]}, "is not what the command printed"),
    "time": (spoilt(evaluation(), "results", 2, "time_s", value="x"), "is not what the command printed"),
    "place": (spoilt(evaluation(), "results", 0, "failures", 0, "x", value=[]), "is not what the command printed"),
    "map": (spoilt(evaluation(), "setup", "map", value="rings: 3"), "setup.map"),
    "score": (spoilt(comparison(), "ring2", "nrmse_test", "sp", value="low"), "is not what the command printed"),
    "ring": ({"ringx": comparison()["ring1"]}, "is not what the command printed"),
    "effect": (spoilt(diagnosis(), "effects", 0, "parameters", "coefficient", "value", value=None), "not what the"),
    "rounds": ({"rounds": [{"diagnosis": 3}]}, "is not what the command printed"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_documents(refused, tmp_path, name):
    document, words = BAD[name]
    path = tmp_path / "x.json"
    if document is not None:
        path.write_text(document if isinstance(document, str) else json.dumps(document))
    error = refused("report", path, "-o", tmp_path / "x.html")
    assert words in error
    assert str(path) in error
    assert not (tmp_path / "x.html").exists()


def test_dollars_in_a_name_are_no_formula(report, call, tmp_path):
    log = a_log(tmp_path / "run.mcap", rig="a_$5_$6")
    paid = written(tmp_path / "cost_$5_$6.json", evaluation("a_$5_$6"))
    code, _, err = report(paid, "-o", tmp_path / "x.html")
    assert code == 0, err
    assert call("map", "show", "cme", "--log", log, "-o", tmp_path / "x.png")[0] == 0
    axes_of_the_plate = drawn(run_section(read_log(log)).parts, "path").axes[0]
    assert [text.get_parse_math() for text in axes_of_the_plate.texts if text.get_text() == "$x$"] == [True]


def test_bad_outputs_and_other_inputs(refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    log = a_log(tmp_path / "run.mcap")
    (tmp_path / "folder.html").mkdir()
    (tmp_path / "file").write_text("")
    with RunLogWriter(tmp_path / "c.mcap", {"rig": "toy", "excitation": "multisine"}) as collected:
        collected.sample(Observation(0.0, 0.09, 0.0, 0.0, 0.0), Command(0.0, 0.0))
    for words, message in (
        ((log, "-o", "x.pdf"), "expected a file that ends in .html"),
        ((log, "-o", "folder.html"), "a folder, expected"),
        ((log, "-o", "file/x.html"), "is a file; expected a folder"),
        ((tmp_path, "-o", "x.html"), "got a folder without report.json"),
        (("none.mcap", "-o", "x.html"), "none.mcap: no such file"),
        (("c.mcap", "-o", "x.html"), "got a log of `collect`"),
    ):
        assert message in refused("report", *words)
    assert not (tmp_path / "x.html").exists()


def test_evidence_without_its_axes_is_refused(refused, tmp_path):
    written(tmp_path / "report.json", diagnosis())
    written(tmp_path / "evidence.json", spoilt(evidence(), "axes", value=["theta, rad"]))
    assert "cannot be drawn" in refused("report", tmp_path, "-o", tmp_path / "x.html")
