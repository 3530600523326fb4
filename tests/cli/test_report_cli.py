"""`report`."""

from __future__ import annotations

import json
import re
from functools import partial

import pytest
from report_documents import EVIL, a_log, comparison, diagnosis, evaluation, evidence
from standalone_page import alone


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
    assert [title.split()[0] for title in titles] == ["Run", "Evaluation", "Models,", "Diagnosis", "Evaluation"]
    numbers = (
        "2.97 s",
        "3.33 s",
        "0.200 / 0.345</b><br><small>[0.31, 0.37]",
        "16.782",
        "0.412 ± 0.020 rad/s²",
    )
    for number in numbers:
        assert number in page.replace("\u00a0", " "), number


def test_the_folder_of_a_stored_campaign(call, report, tmp_path):
    fast = ("evaluate", "--rig", "ideal", "--from", "ring4", "--runs", 2, "--seed", 5, "--no-deadline", "--json")
    _, out, _ = call(*fast, "--store", tmp_path / "kept")
    mean = json.loads(out)["time_s"]["mean"]
    code, _, err = report(tmp_path / "kept", "-o", tmp_path / "kept.html")
    assert code == 0, err
    page = alone(tmp_path / "kept.html")
    assert f"2 of 2 arrived, on average after {mean:.2f} ± " in page
    assert "first seed</dt><dd>5</dd>" in page


def test_the_rounds_of_improve(report, tmp_path):
    part = {"runs": 16, "success": 12, "time_s": {"mean": 3.217, "best": 2.0, "worst": None}}
    entry = {"diagnosis": diagnosis(), "navigation": {"before": part, "after": {**part, "success": 16}}}
    code, _, err = report(written(tmp_path / "i.json", {"rounds": [entry, entry]}), "-o", tmp_path / "i.html")
    assert code == 0, err
    page = alone(tmp_path / "i.html")
    assert len(re.findall("<h2[^>]*>Diagnosis of i, round", page)) == 2
    assert "16 of 16" in page
    assert "3.22 s" in page
