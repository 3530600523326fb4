"""Rings and radial walls that are added to a map's text or removed from it."""

from __future__ import annotations

from itertools import pairwise

import pytest

from mazeplan.core import resources
from mazeplan.core.errors import MapError
from mazeplan.maze.mapedit import (
    add_ring,
    add_wall,
    move_wall,
    remove_ring,
    remove_wall,
    rename,
    thicken_wall,
    written,
)
from mazeplan.maze.mapfile import check_text, packaged_maps
from mazeplan.maze.yamltree import parse_yaml

TEXTS = {name: (resources.share("maps") / f"{name}.yaml").read_text() for name in packaged_maps()}
CME, DETOUR = TEXTS["cme"], TEXTS["detour"]
BLOCKS = """name: blocks
ball: {radius_mm: 6.35, mass_g: 8.4}
tilt_limit_deg: 5
wall_height_mm: 20
rings:
  - inner_radius_mm: 50.4 # inner
    outer_radius_mm: 65.8
  - inner_radius_mm: 31
    outer_radius_mm: 46.4
  - inner_radius_mm: 0
    outer_radius_mm: 26
openings: [{rings: [2, 1], angle_deg: 17, width_mm: 14}, {rings: [2, 3], angle_deg: 62, width_mm: 14.5}]
"""


def rings(text: str) -> int:
    return sum(piece.section == "rings" for piece in written(text))


def maze(text: str):
    check = check_text(text)
    assert check.errors == ()
    return check.maze


@pytest.mark.parametrize("name", [*TEXTS, "blocks", "as on Windows", "with a mark", "JSON"])
def test_a_ring_may_be_added_anywhere_and_removed_again(name: str):
    as_json = '{"name": "j", "ball": {"radius_mm": 6, "mass_g": 8}, "tilt_limit_deg": 5, "wall_height_mm": 20, ' + (
        '"rings": [{"inner_radius_mm": 30, "outer_radius_mm": 45}, {"inner_radius_mm": 0, "outer_radius_mm": 25}], '
        '"openings": [{"rings": [1, 2], "angle_deg": 3, "width_mm": 14}]}'
    )
    others = {"blocks": BLOCKS, "as on Windows": CME.replace("\n", "\r\n"), "with a mark": "\ufeff" + CME}
    text = {**TEXTS, **others, "JSON": as_json}[name]
    before = maze(text.removeprefix("\ufeff"))
    for number in range(1, rings(text) + 1):
        more = add_ring(text, number, 123.4, 15)
        assert rings(more) == rings(text) + 1
        assert more.startswith("\ufeff") == text.startswith("\ufeff")
        assert more.count("\r\n") == (more.count("\n") if "\r" in text else 0)
        after = check_text(more.removeprefix("\ufeff")).maze
        assert after is None or len(after.rings) == len(before.rings) + 1
        if number <= len(before.rings) - 1:
            assert maze(remove_ring(more, number).removeprefix("\ufeff")) == before


def test_an_added_ring_is_as_wide_as_its_neighbour_and_the_others_keep_their_widths():
    before, after = maze(CME), maze(add_ring(CME, 3, 30, 15))

    def widths(rings):
        return [round(1e6 * (ring.outer_radius - ring.inner_radius)) for ring in rings]

    def walls(rings):
        return [round(1e6 * (out.inner_radius - ring.outer_radius)) for out, ring in pairwise(rings)]

    old, new = widths(before.rings), walls(before.rings)
    assert widths(after.rings) == [*old[:2], old[2], *old[2:]]
    assert walls(after.rings) == [*new[:2], new[1], *new[2:]]
    assert after.rings[3:] == tuple(type(ring)(i, ring.inner_radius, ring.outer_radius)
                                    for i, ring in enumerate(before.rings[2:], start=4))  # fmt: skip
    assert [opening.name for opening in after.openings if opening.outer == 2] == ["2-3@30"]


def test_numbers_in_comments_of_rings_follow_and_comments_of_what_is_removed_stay():
    fewer = remove_ring(DETOUR, 1)
    assert "outer_radius_mm: 62.4} # ring 1\n" in fewer
    assert "outer_radius_mm: 22.4} # ring 3, the goal" in fewer
    assert "  # removed ring 1\n" in fewer
    assert "  # removed 1-2@60: the only one that leads on\n" in fewer
    assert "  # removed wall1@100: from 120 degrees on the way to 60 is the long one\n" in fewer
    assert fewer.startswith(DETOUR[: DETOUR.index("rings:")])
    assert {wall.ring for wall in maze(fewer).radial_walls} == {1, 2}
    more = add_ring(DETOUR, 2, 60, 15)
    assert "outer_radius_mm: 62.4} # ring 3\n" in more
    assert [row.count("#") for row in more.splitlines() if "#" in row] == [
        row.count("#") for row in DETOUR.splitlines() if "#" in row
    ]


@pytest.mark.parametrize(
    ("edit", "problem"),
    [
        (lambda: remove_ring(CME, 5), "got ring 5, expected one from 1 to 4: the last one is the goal"),
        (lambda: remove_ring(CME, 0), "got ring 0, expected one from 1 to 4"),
        (lambda: add_ring(CME, 6, 0, 15), "got ring 6, expected one from 1 to 5"),
        (lambda: remove_ring(remove_ring(BLOCKS, 1), 1), "got a map of 2 rings"),
        (lambda: add_ring(BLOCKS.replace("31", "wide"), 1, 0, 15), r"rings\[1\]: expected inner_radius_mm and outer"),
        (lambda: add_ring("rings: []\nopenings: []\n", 1, 0, 15), "got 0 rings"),
        (lambda: add_ring("name: a\n", 1, 0, 15), "rings: missing"),
        (lambda: rename("rings: []\n", "a"), "name: missing"),
        (lambda: move_wall(CME, 0, 10), "radial_walls: missing"),
        (lambda: remove_wall(DETOUR, 6), "got the number 6, expected one of the 6 radial_walls"),
    ],
)
def test_what_cannot_be_done_is_refused_in_one_line(edit, problem: str):
    with pytest.raises(MapError, match=problem) as told:
        edit()
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("text", [CME, BLOCKS, CME.replace("\n", "\r\n"), CME + "radial_walls: []\n"])
def test_the_first_radial_wall_makes_the_list_and_the_last_one_empties_it(text: str):
    one = add_wall(text, 2, 210, 5)
    two = add_wall(one, 1, 100.04, 4)
    assert [(wall.ring, wall.name) for wall in maze(two).radial_walls] == [(2, "wall2@210"), (1, "wall1@100")]
    assert [line for line in text.splitlines() if line and line not in one.splitlines()] in ([], ["radial_walls: []"])
    moved = thicken_wall(move_wall(two, 0, 250), 0, 3.217)
    assert [piece.name for piece in written(moved) if piece.section == "radial_walls"] == ["wall2@250", "wall1@100"]
    assert "thickness_mm: 3.22" in moved
    assert maze(remove_wall(remove_wall(moved, 1), 0)).radial_walls == ()
    assert two.count("\r\n") == (two.count("\n") if "\r" in text else 0)


def test_a_map_gets_another_name_and_keeps_the_rest():
    assert rename(CME, "my map") == CME.replace("name: cme", 'name: "my map"')
    assert parse_yaml(rename(BLOCKS, "7"), file="map").data["name"] == "7"
