"""Reports of comparisons: tables and pictures by a second route."""

from __future__ import annotations

from pathlib import Path

import pytest
from report_documents import comparison, kept

from mazeplan.apps.report.inputs import Input
from mazeplan.apps.report.models import models_section
from mazeplan.apps.report.page import PageTable


def section(document):
    return models_section(Input("comparison", Path("c.json"), "c", document))


def plain(table):
    return [[cell.replace("\u00a0", " ") for cell in row] for row in table.rows]


def test_tables_have_the_numbers_of_the_document():
    first, second = kept(section(comparison()).parts, PageTable)
    assert list(first.head) == ["", "bare equation (p)", "terms and process (sp)"]
    assert plain(first)[0] == ["ring 1: 400 rows, 100 to test", "0.910 / 0.910", "0.200 / 0.345\n[0.31, 0.37]"]
    assert first.strong == {(0, 2), (1, 2)}
    assert plain(second)[0] == ["ring 1: 7 windows (too few for ±), evenly spaced", "7.07 / 14.14"]
    late = comparison()
    late["ring1"]["rollout"] |= {"p": {"20": 0.1, "40": 0.3}, "np": {"20": 0.3, "40": 0.2}}
    table = kept(section(late).parts, PageTable)[1]
    assert [table.head[column] for row, column in table.strong if row == 0] == ["Gaussian process (np)"]


def test_the_lead_names_the_best_kind_on_average():
    lead = section(comparison()).lead
    assert "best on average: terms and process. " in lead
    assert "0.345 in ring 1, 0.345 in ring 2" in lead


@pytest.mark.parametrize(("blocks", "shown"), [(4, "too few"), (5, "[0.31, 0.37]"), (1, "too few")])
def test_an_interval_needs_enough_blocks_of_time(blocks, shown):
    document = comparison()
    document["ring1"]["blocks"] = {"test": blocks, "windows": blocks}
    assert plain(kept(section(document).parts, PageTable)[0])[0][2] == f"0.200 / 0.345\n{shown}"
