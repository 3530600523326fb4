"""Edits of a map's text change what they mean and nothing else."""

from __future__ import annotations

import difflib
import json
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mazeplan.core import resources
from mazeplan.core.errors import MapError
from mazeplan.maze.mapedit import (
    add_opening,
    close_opening,
    move_opening,
    remove_opening,
    widen_opening,
    written_openings,
)
from mazeplan.maze.mapfile import check_text
from mazeplan.maze.yamltree import parse_yaml

LOPSIDED = (resources.share("maps") / "lopsided.yaml").read_text()
CME = (resources.share("maps") / "cme.yaml").read_text()
HEAD = LOPSIDED[: LOPSIDED.index("openings:")]
A = "rings: [1, 2], angle_deg: 17, width_mm: 14"
B = "rings: [2, 3], angle_deg: 62, width_mm: 14.5"
B_ON_LINES = "rings: [2, 3], # é\n   angle_deg: 62, width_mm: 14.5"
BLOCKS = """openings:
  # first
  - rings: [1, 2] # r
    # own
    angle_deg: 17
    width_mm: 14

  # last
  - rings: [2, 3]
    angle_deg: 62
    width_mm: 14.5 # w"""
BLOCKS_WITHOUT_INDENT = """openings:
- {rings: [1, 2], angle_deg: 17, width_mm: 14, name: 'a # b'}
-
  # why
  width_mm: 14.5
  rings: [3, 2]
  angle_deg: 62
# end"""
LISTS = {
    "no lines yet": "openings: []  # none – yet\n",
    "nothing": "openings:\n# nothing\n",
    "empty over two lines": "openings: [ # none\n  ] # yet\n",
    "on one line": f"openings: [{{{A}}}, {{{B}}}] # both # of them\n",
    "in brackets, on lines": f"openings: [\n  {{{A}}}, # a\n  # between\n  {{{B_ON_LINES}}} # b\n]\n",
    "on lines, in a bracket": f"openings:\n  - {{{A}}}\n  - {{{B_ON_LINES}}} # b\n",
    "blocks": BLOCKS,
    "blocks without indent": BLOCKS_WITHOUT_INDENT,
    "lines that end as on Windows": BLOCKS,
}


def whole(name: str) -> str:
    text = HEAD.replace("# ring 1", "# ring 1 – the outermost") + LISTS[name]
    return text.replace("\n", "\r\n") if "Windows" in name else text


def said(text: str) -> list[dict]:
    return parse_yaml(text, file="map").data["openings"] or []


def comments(text: str) -> list[str]:
    """Every comment of the maps above, without its #."""
    return sorted(row.split("# ", 1)[1] for row in text.replace("'a # b'", "").splitlines() if "# " in row)


def lines(before: str, after: str) -> list[str]:
    """What another text has other than the first."""
    return [row for row in difflib.ndiff(before.splitlines(True), after.splitlines(True)) if row[0] in "+-"]


def test_a_moved_opening_is_one_number_in_one_line():
    assert lines(CME, move_opening(CME, 1, 141.26)) == [
        "-   - {rings: [1, 2], angle_deg: 135, width_mm: 15.3}\n",
        "+   - {rings: [1, 2], angle_deg: 141.3, width_mm: 15.3}\n",
    ]


@pytest.mark.parametrize(
    ("angle", "written"), [(359.96, "0"), (-0.04, "0"), (-90, "270"), (720.1, "0.1"), (45, "45"), (0.3, "0.3")]
)
def test_angles_are_rounded_to_a_tenth_between_0_and_360(angle: float, written: str):
    assert f"angle_deg: {written}, width_mm: 14}}" in move_opening(LOPSIDED, 0, angle)


def test_what_is_no_number_is_refused():
    for edit in (move_opening, widen_opening):
        with pytest.raises(MapError, match="got nan, expected a finite number"):
            edit(LOPSIDED, 0, math.nan)


def test_width_and_closed_are_written_where_they_stand_or_behind_the_rest():
    assert "width_mm: 15.25, extra_cost_s: 0.2} # its edges are rough" in widen_opening(LOPSIDED, 4, 15.2501)
    shut = close_opening(LOPSIDED, 2, True)
    assert "name: wide, closed: true}" in shut
    assert "name: wide, closed: false}" in close_opening(shut, 2, False)


def test_a_new_one_stands_below_its_wall_written_as_its_neighbours():
    assert lines(CME, add_opening(CME, 2, 44.4, 15)) == ["+   - {rings: [2, 3], angle_deg: 44.4, width_mm: 15}\n"]
    added = add_opening(whole("blocks"), 1, 200, 15)
    assert "    width_mm: 14\n  - rings: [1, 2]\n    angle_deg: 200\n    width_mm: 15\n\n  # last" in added


def test_a_comment_of_what_is_removed_says_what_it_was_about():
    assert lines(LOPSIDED, remove_opening(LOPSIDED, 4)) == [
        "-   - {rings: [2, 3], angle_deg: 251, width_mm: 16, extra_cost_s: 0.2} # its edges are rough\n",
        "+   # removed 2-3@251: its edges are rough\n",
    ]


@pytest.mark.parametrize("name", LISTS)
def test_every_way_to_write_a_list_can_be_emptied_and_filled(name: str):
    text = whole(name)
    start, ends = comments(text), text.count("\r\n") / max(text.count("\n"), 1)
    for n in range(len(said(text)), 0, -1):
        text = remove_opening(text, n - 1)
        assert len(said(text)) == n - 1
    assert not said(text)
    text = add_opening(add_opening(add_opening(text, 1, 17, 14), 2, 62, 14.5), 1, 300, 14)
    assert sorted(said(text), key=str) == [
        {"rings": [1, 2], "angle_deg": 17, "width_mm": 14},
        {"rings": [1, 2], "angle_deg": 300, "width_mm": 14},
        {"rings": [2, 3], "angle_deg": 62, "width_mm": 14.5},
    ]
    assert check_text(text).maze is not None
    assert sorted(one.rsplit(": ", 1)[-1] for one in comments(text)) == sorted(one.rsplit(": ", 1)[-1] for one in start)
    assert text.count("\r\n") / text.count("\n") == ends


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (HEAD, "openings: missing"),
        (HEAD + "openings: 3\n", "got 3, expected a list of openings"),
        (HEAD + "openings: [{]\n", "not valid YAML"),
        (HEAD + "openings: [3]\n", "expected keys such as"),
        (HEAD + "openings: [{angle_deg: [3]}]\n", "angle_deg is no number"),
        (HEAD + "openings: []\n", "got the number 0, expected one of the 0"),
        (LOPSIDED.replace("\n", "\r"), "neither LF nor CRLF"),
    ],
)
def test_what_cannot_be_edited_is_refused_with_its_line(text: str, problem: str):
    with pytest.raises(MapError, match=problem):
        move_opening(text, 0, 10)


def test_openings_are_read_also_where_they_overlap():
    found = written_openings(move_opening(LOPSIDED, 1, 18))
    assert [(one.index, one.line, one.name, one.outer) for one in found] == [
        (0, 18, "1-2@17", 1),
        (1, 19, "1-2@18", 1),
        (2, 20, "wide", 1),
        (3, 22, "2-3@62", 2),
        (4, 23, "2-3@251", 2),
    ]
    assert written_openings("{[") == () == written_openings("openings: [{rings: [1, 2]}]")


def test_a_byte_order_mark_stays_in_front():
    assert move_opening("\ufeff" + LOPSIDED, 0, 5) == "\ufeff" + move_opening(LOPSIDED, 0, 5)


EDITS = st.one_of(
    st.tuples(st.just("move"), st.integers(0, 30), st.floats(-720, 720)),
    st.tuples(st.just("widen"), st.integers(0, 30), st.floats(2, 200)),
    st.tuples(st.just("close"), st.integers(0, 30), st.booleans()),
    st.tuples(st.just("remove"), st.integers(0, 30), st.none()),
    st.tuples(st.just("add"), st.integers(1, 2), st.tuples(st.floats(0, 360), st.floats(2, 200))),
)


@pytest.mark.slow
@given(st.sampled_from([CME, LOPSIDED, *map(whole, LISTS)]), st.lists(EDITS, max_size=12))
@settings(max_examples=120, deadline=None)
def test_any_edits_mean_what_they_say_and_keep_all_comments(text, edits):
    meant, before = said(text), comments(text)
    for kind, number, value in edits:
        if kind == "add":
            text = add_opening(text, number, *value)
            new = {"rings": [number, number + 1], "angle_deg": turned(value[0]), "width_mm": hundredth(value[1])}
            same = [i for i, one in enumerate(meant) if min(one["rings"]) == number]
            meant.insert(same[-1] + 1 if same else len(meant), new)
        elif not meant:
            continue
        elif kind == "remove":
            text = remove_opening(text, number % len(meant))
            del meant[number % len(meant)]
        else:
            at = number % len(meant)
            key, edit = {
                "move": ("angle_deg", move_opening),
                "widen": ("width_mm", widen_opening),
                "close": ("closed", close_opening),
            }[kind]
            text = edit(text, at, value)
            meant[at][key] = {"move": turned, "widen": hundredth, "close": bool}[kind](value)
        assert said(text) == meant
    data = parse_yaml(text, file="map").data
    document = {**data, "openings": meant or data["openings"]}
    check, expected = check_text(text), check_text(json.dumps(document))
    assert check.maze == expected.maze
    assert {error.problem for error in check.errors} == {error.problem for error in expected.errors}
    left = comments(text)
    for one in before:  # each is there once, at the end of one of those that stayed or were kept of what was removed
        found = next(row for row in left if row.endswith(one))
        left.remove(found)
    assert not left


def turned(degrees: float) -> float:
    """A tenth of a degree, in the circle."""
    return round(round(degrees / 0.1) % 3600 / 10, 1)


def hundredth(millimetres: float) -> float:
    return round(millimetres / 0.01) / 100
