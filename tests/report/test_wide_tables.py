"""Tables of a comparison are no wider than the page, on a screen of 1024 pixels and on paper: seen in a browser."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from report_documents import comparison
from watching import browser

from mazeplan.apps.report.inputs import Input
from mazeplan.apps.report.models import models_section
from mazeplan.apps.report.page import PageSection, PageTable, write_page
from mazeplan.apps.report.words import KINDS

PAPER = 680  # pixels of 1/96 inch: the width of A4 less two margins of 15 mm
WIDER = "[...document.querySelectorAll('.scroll')].map(d => d.firstElementChild.offsetWidth - d.clientWidth)"


def full():
    """All kinds in four rings, with everything that `compare` tells, and long numbers."""
    document = comparison((1, 2, 3, 4))
    predicted = [kind for kind in KINDS if kind not in ("npd", "model")]
    for scores in document.values():
        scores |= {"n_train": 12345, "n_test": 34567, "windows": 400, "windows_chosen": "before openings"}
        scores["nrmse_train"] = dict.fromkeys(predicted, 10.123)
        scores["nrmse_test"] = dict.fromkeys(predicted, 10.123)
        rolled = ("pi", "np", "npd", "sp")
        scores["rollout"] = {kind: {"20": 1.2345, "40": 2.3456} for kind in rolled}
        scores["interval95"] = {"nrmse_test": dict.fromkeys(predicted, (10.01, 11.23))}
        scores["interval95"] |= {n: dict.fromkeys(rolled, (1.1, 2.9)) for n in ("20", "40")}
    return document


@pytest.mark.slow
@pytest.mark.parametrize(("media", "width"), [("screen", 1024), ("print", PAPER)])
def test_tables_fit(tmp_path, media, width):
    section = models_section(Input("comparison", Path("c.json"), "c", full()))
    write_page(tmp_path / "page.html", section.title, [section])
    tables = [part for part in section.parts if isinstance(part, PageTable)]
    with browser() as opened:
        shown = opened.new_page(viewport={"width": width, "height": 800})
        shown.emulate_media(media=media)
        shown.goto((tmp_path / "page.html").as_uri())
        wider = shown.evaluate(WIDER)
        shown.close()
    assert len(wider) == len(tables) == 2
    assert max(wider) <= 0


def test_a_second_line_of_a_cell_is_a_line_of_its_own(tmp_path):
    table = PageTable("c", ("", "a", "b"), [["x", "1.0 / 2.0\n[1, 3]", "a <b>\nword"]], frozenset({(0, 1)}))
    write_page(tmp_path / "page.html", "t", [PageSection("t", "", [], [table])])
    text = (tmp_path / "page.html").read_text()
    assert '<td class="v"><b>1.0 / 2.0</b><br><small>[1, 3]</small></td>' in text
    assert "<td>a &lt;b&gt;<br><small>word</small></td>" in text
    assert not re.search(r"<small>\s*</small>", text)
