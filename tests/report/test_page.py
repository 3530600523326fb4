"""The page: nothing from elsewhere, everything escaped, pictures as files."""

from __future__ import annotations

import html
import re

import pytest
from report_documents import EVIL
from standalone_page import alone, svgs

from mazeplan.apps.report.page import Note, PagePicture, PageSection, PageTable, write_page
from mazeplan.apps.report.words import MISSING
from mazeplan.core.errors import InputError


def plot(figure):
    axes = figure.add_subplot()
    axes.plot([0, 1], [0, 1], label=EVIL)
    axes.set_title(EVIL)
    axes.legend()


PICTURE = PagePicture("One & only", EVIL, f'"{EVIL}', plot, (3.0, 2.0))


def section(title="A title", parts=()):
    table = PageTable(EVIL, ("", EVIL), [[EVIL, "1.50 s"], ["b", "2 s"]], frozenset({(1, 0)}))
    return PageSection(title, EVIL, [(EVIL, EVIL)], [table, Note(EVIL, EVIL), PICTURE, *parts])


def test_everything_is_escaped_and_nothing_is_loaded(tmp_path):
    write_page(tmp_path / "page.html", EVIL, [section(EVIL), section(EVIL)])
    plain = alone(tmp_path / "page.html")
    assert EVIL not in plain
    escaped = html.escape(EVIL, quote=False)
    assert escaped.replace("'", "&#39;") in plain
    assert len(svgs((tmp_path / "page.html").read_text())) == 2


def test_the_same_report_is_the_same_file(tmp_path):
    for name in ("a", "b"):
        write_page(tmp_path / name, "t", [section()])
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_columns_of_numbers_stand_to_the_right():
    rows = [["a", "1", "1.5 s", MISSING], ["b", "-2.5", MISSING, MISSING]]
    assert PageTable("", ("", "", "", ""), rows).numeric == {1, 2, 3}
    assert PageTable("", ("", ""), [["1", "1 of 2"]]).numeric == {0}
    assert PageTable("", ("",), []).numeric == set()


def test_a_place_that_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"^.*file/page.html: cannot be written: "):
        write_page(tmp_path / "file" / "page.html", "t", [])


def test_a_page_of_several_parts_has_contents(tmp_path):
    write_page(tmp_path / "page.html", "t", [section("one"), section("two")])
    text = (tmp_path / "page.html").read_text()
    assert re.findall(r'<li><a href="#(\w+)">(\w+)</a>', text) == [("part1", "one"), ("part2", "two")]
    assert re.findall(r'<h2 id="(\w+)">(\w+)</h2>', text) == [("part1", "one"), ("part2", "two")]
    write_page(tmp_path / "page.html", "t", [section("one")])
    assert "<nav" not in (tmp_path / "page.html").read_text()
