"""Reports and the page for those who do not see them: names, titles, headings; and nothing is cut at any width.

The checks of our own always run. Those of axe-core (npm install axe-core) run where `MAZEPLAN_AXE` names its
axe.min.js.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from lxml import html
from report_documents import comparison
from watching import browser

from mazeplan.apps.report.inputs import Input
from mazeplan.apps.report.models import models_section
from mazeplan.apps.report.page import write_page
from mazeplan.apps.report.run import run_section
from mazeplan.core.logs.run_log import read_log
from mazeplan.maze.mapfile import load_map
from mazeplan.run.navigate import navigate

AXE = os.environ.get("MAZEPLAN_AXE", "")
LEVEL_A = "axe.run(document, {runOnly: ['wcag2a', 'wcag21a']})"
NAMELESS = """() => [...document.querySelectorAll('button, input, select, textarea, [role=button], [role=slider]')]
  .filter(e => e.checkVisibility() && e.type !== 'hidden' && !(e.ariaLabel || e.innerText || e.title
    || (e.labels && [...e.labels].some(l => l.innerText)))).map(e => e.outerHTML.slice(0, 200))"""
TOO_WIDE = "document.documentElement.scrollWidth - document.documentElement.clientWidth"


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """A report of a run and of a comparison: pictures, tables, contents."""
    folder = tmp_path_factory.mktemp("report")
    navigate(4, 5, map=load_map("cme"), rig="ideal", seed=1, log=folder / "run.mcap")
    sections = [
        run_section(read_log(folder / "run.mcap")),
        models_section(Input("comparison", Path("c.json"), "c", comparison((1, 2, 3, 4)))),
    ]
    write_page(folder / "page.html", "A run and a comparison", sections)
    return folder / "page.html"


@pytest.fixture(scope="module")
def chromium():
    with browser() as opened:
        yield opened


def faults(text):
    """What is wrong with a document, by its source."""
    tree, found = html.document_fromstring(text), []
    if not tree.get("lang"):
        found.append("no language")
    if not (tree.findtext(".//title") or "").strip():
        found.append("no title")
    found += [f"a picture without words: {img.get('src', '')[:40]}" for img in tree.iter("img") if not img.get("alt")]
    levels = [int(part.tag[1]) for part in tree.iter("h1", "h2", "h3", "h4")]
    if not levels or levels[0] != 1 or levels.count(1) != 1:
        found.append(f"headings: got {levels}, expected one h1, first")
    found += [f"h{b} after h{a}" for a, b in zip([0, *levels], levels, strict=False) if b > a + 1]
    found += ["a head of a table without scope" for th in tree.iter("th") if th.get("scope") not in ("col", "row")]
    found += ["a table without a name" for table in tree.iter("table") if not table.get("aria-label")]
    labelled = {label.get("for") for label in tree.iter("label")}
    fields = tree.iter("input", "select", "textarea")
    found += ["a field without a label" for f in fields if not f.get("aria-label") and f.get("id") not in labelled]
    ids = [part.get("id") for part in tree.iter() if isinstance(part.tag, str) and part.get("id")]
    return found + [f"id {name} twice" for name in sorted({name for name in ids if ids.count(name) > 1})]


@pytest.mark.slow
def test_a_report_says_in_words_what_it_shows(report):
    assert faults(report.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("spoiled", "by", "said"),
    [
        (' lang="en"', "", "no language"),
        ("<title>A run and a comparison</title>", "<title> </title>", "no title"),
        (' alt="', ' data-alt="', "a picture without words"),
        ("<h2", "<h4", "h4 after h1"),
        (' scope="col"', "", "without scope"),
    ],
)
def test_what_is_missing_in_a_report_is_noticed(report, spoiled, by, said):
    text = report.read_text(encoding="utf-8")
    assert spoiled in text
    assert any(said in fault for fault in faults(text.replace(spoiled, by)))


@pytest.mark.slow
@pytest.mark.parametrize("width", [1920, 1300, 800])
def test_nothing_of_a_report_is_cut_at_any_width(chromium, report, width):
    shown = chromium.new_page(viewport={"width": width, "height": 800})
    shown.goto(report.as_uri())
    assert shown.evaluate(TOO_WIDE) <= 0
    assert shown.evaluate(
        "[...document.querySelectorAll('img')].every(i => i.complete && i.getBoundingClientRect().right <= innerWidth)"
    )
    shown.close()


def axe_faults(shown):
    """Faults of level A, by axe-core."""
    if not Path(AXE).is_file():
        pytest.skip("needs axe-core: npm install axe-core; MAZEPLAN_AXE=node_modules/axe-core/axe.min.js")
    shown.evaluate(Path(AXE).read_text(encoding="utf-8"))
    return [(fault["id"], [node["html"] for node in fault["nodes"]]) for fault in shown.evaluate(LEVEL_A)["violations"]]


@pytest.mark.slow
def test_axe_finds_no_fault_of_level_a_in_a_report(chromium, report):
    context = chromium.new_context(bypass_csp=True)
    shown = context.new_page()
    shown.goto(report.as_uri())
    assert axe_faults(shown) == []
    context.close()


SLIDERS = """[...document.querySelectorAll('input')]
  .filter(e => /NumberInput/.test(e.className) && e.checkVisibility()).map(e => e.ariaLabel)"""
OVERLAPS = """() => {
  const boxes = [...document.querySelectorAll('button, input, [data-line], [data-errors], [data-trial]')]
    .filter(e => e.checkVisibility() && e.type !== 'hidden').map(e => [e, e.getBoundingClientRect()])
    .filter(([e, r]) => r.width && r.height);
  const clash = ([a, p], [b, q]) => !a.contains(b) && !b.contains(a)
    && Math.min(p.right, q.right) - Math.max(p.left, q.left) > 2
    && Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top) > 2;
  return boxes.flatMap((a, i) => boxes.slice(i + 1).filter(b => clash(a, b))
    .map(b => [a, b].map(([e]) => e.outerHTML.slice(0, 150))));
}"""
