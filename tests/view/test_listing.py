"""A map's text as the editor's page shows it, and where a pointer points."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from mazeplan.apps.view.editor.listing import changed_lines, listing
from mazeplan.apps.view.editor.mapeditor import MapEditor
from mazeplan.apps.view.editor.scene import about_z, pointed_angle
from mazeplan.apps.view.editor.tab import head_html, problems_html
from mazeplan.core import resources
from mazeplan.core.palette import TINTS
from mazeplan.maze.mapfile import check_text

LOPSIDED = (resources.share("maps") / "lopsided.yaml").read_text()


def words(html: str) -> str:
    return re.sub(r"<[^>]*>", "", html).replace("&#x27;", "'")


def row(html: str, line: int) -> str:
    return html.split(f'data-line="{line}"')[1].split("data-line")[0]


def test_each_line_has_its_number_and_each_problem_its_line():
    text = LOPSIDED.replace("angle_deg: 100.5", "angle_deg: 18").replace("width_mm: 14.5", "width_mm: -1")
    html = listing(text, check_text(text).errors, 20)
    for number, line in enumerate(text.splitlines(), start=1):
        assert re.match(rf"\S* *\S?\s*{number}  {re.escape(line)}", words(f"<{row(html, number)}"))
    assert html.count("data-problem") == 1  # a width that is none is told before what overlaps
    assert "openings[3].width_mm: got -1" in words(row(html, 22))
    text = LOPSIDED.replace("angle_deg: 100.5", "angle_deg: 18")
    html = listing(text, check_text(text).errors, 20)
    assert "overlaps openings[0]" in words(row(html, 19))
    assert TINTS["chosen"] in row(html, 20)
    assert TINTS["chosen"] not in html.replace(row(html, 20), "")


def test_what_is_typed_is_shown_and_not_run():
    text = "name: <script>alert(1)</script> # <b>\n"
    editor = MapEditor("lopsided")
    editor.write(text)
    for html in (listing(text, editor.check.errors, None), head_html(editor, "<i>", "<i>"), problems_html(editor)):
        assert "<script>" not in html
        assert "<b>" not in html.replace("<b>lopsided.yaml</b>", "").replace("<b>line 1</b>", "")
        assert "<i>" not in html
    assert "&lt;script&gt;" in listing(text, (), None)


def test_a_problem_beyond_the_text_or_without_a_line_is_told_all_the_same():
    assert "the file is empty" in words(listing("", check_text("").errors, None))
    text = "a: [\n"
    assert "data-problem" in listing(text, check_text(text).errors, None)


def test_lines_that_are_others_are_marked():
    editor = MapEditor("lopsided")
    editor.move(0, 33)
    editor.add(2, 150)
    assert changed_lines(editor.saved, editor.text) == {18, 24}
    editor.undo()
    editor.remove(1)
    assert changed_lines(editor.saved, editor.text) == {18}
    assert changed_lines(editor.saved, editor.saved) == set()
    assert "•" in words(row(listing(editor.text, (), None, frozenset({18})), 18))


def test_the_head_tells_how_things_stand():
    editor = MapEditor("lopsided")
    assert "as in the file" in head_html(editor, "", "")
    assert "no errors" in head_html(editor, "", "")
    editor.move(1, 18)
    html = head_html(editor, "cannot be written", "")
    assert 'data-changed="1" data-errors="1"' in html
    assert "1 error: see" in html
    assert "data-refused" in html
    assert "line 19" in words(problems_html(editor))


@pytest.mark.parametrize("angle", [0.0, 1.0, -2.5, math.pi])
@pytest.mark.parametrize("camera", [(0.0, -1.0, 4.0), (2.0, 2.0, 1.0)])
def test_a_pointer_is_at_the_angle_of_the_place_it_is_over(camera, angle):
    place = np.array([0.7 * math.cos(angle), 0.7 * math.sin(angle), 0.1])
    for along in (0.3, 1.0, 1.7):  # where on the ray the browser has it, is for the browser
        pointer = np.array(camera) + along * (place - np.array(camera))
        assert math.remainder(pointed_angle(camera, pointer, 0.1) - angle, 2.0 * math.pi) == pytest.approx(
            0.0, abs=1e-9
        )


def test_a_pointer_above_the_horizon_is_nowhere():
    assert pointed_angle((0.0, -1.0, 1.0), (0.0, 0.0, 2.0), 0.1) is None
    assert pointed_angle((0.0, -1.0, 1.0), (0.0, 0.0, 1.0), 0.1) is None
    assert pointed_angle((0.0, 0.0, 1.0), (0.0, 0.0, 0.5), 0.1) is None


def test_a_turn_about_the_vertical_brings_x_to_its_angle():
    w, x, y, z = about_z(0.7)
    assert (x, y) == (0.0, 0.0)
    assert (1 - 2 * z * z, 2 * w * z) == pytest.approx((math.cos(0.7), math.sin(0.7)))
