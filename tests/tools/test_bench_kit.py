"""What the sections of the benchmarks share: outcomes that resume, and the page that is made from all figures."""

from __future__ import annotations

import json

import bench
import pytest
from bench_kit import Section, Table, resumed


def double(number: int) -> dict[str, int]:
    return {"double": 2 * number}


def test_an_outcome_in_the_file_is_not_computed_again(tmp_path):
    path = tmp_path / "outcomes.jsonl"
    path.write_text(json.dumps({"job": "[1]", "outcome": {"double": 77}}) + "\n")
    assert resumed(path, double, [(1,), (2,)], 1) == [{"double": 77}, {"double": 4}]
    assert resumed(path, double, [(2,)], 1) == [{"double": 4}]
    assert len(path.read_text().splitlines()) == 2


def test_a_row_with_a_cell_too_few_is_refused():
    with pytest.raises(AssertionError):
        Table(("a", "b")).add(1)


def test_a_measured_section_replaces_its_figures_and_keeps_the_others(tmp_path):
    before = bench.load(tmp_path)
    bench.keep(tmp_path, "balls", Section("Two balls", ("note",), (Table(("rig", "arrived"), [["x", "1/1"]]),)))
    after = bench.load(tmp_path)
    assert after["balls"]["tables"][0]["rows"] == [["x", "1/1"]]
    assert {**after, "balls": 0} == {**before, "balls": 0}


def test_the_page_is_what_the_figures_say_and_short():
    lines = list(bench.page(bench.load(bench.ROOT)))
    assert (bench.ROOT / "BENCHMARKS.md").read_text(encoding="utf-8").splitlines() == lines
    assert len(lines) <= 200
    for name, picks in ((name, picks) for name, picks in bench.PAGE.items()):
        assert {pick.section for pick in picks} <= set(bench.SECTIONS), name
