"""What a map file may say of radial walls, and the line and words of what it may not."""

from __future__ import annotations

import pytest

from mazeplan.maze.mapfile import check_text, dump_map, load_map

CME = dump_map(load_map("cme"))
FIRST = CME.count("\n") + 2  # the line of the first wall below the key


def check(*walls: str, text: str = CME):
    return check_text(text + "radial_walls:\n" + "".join(f"  - {{{wall}}}\n" for wall in walls), file="m.yaml")


def wall(ring=1, angle=90.0, thickness=5.0, more=""):
    return f"ring: {ring}, angle_deg: {angle}, thickness_mm: {thickness}{more}"


def test_a_wall_has_a_name_of_its_own_or_one_by_ring_and_angle():
    maze = check(wall(), wall(2, 250.5, 3, ', name: "bar"')).maze
    assert maze is not None
    assert [(w.name, w.ring) for w in maze.radial_walls] == [("wall1@90", 1), ("bar", 2)]
    assert maze.radial_walls[1].thickness == pytest.approx(0.003)


@pytest.mark.parametrize(
    ("walls", "line", "words"),
    [
        ([wall(angle=400)], 0, "radial_walls[0].angle_deg: got 400"),
        ([wall(ring=0)], 0, "radial_walls[0].ring: got 0"),
        (["ring: 1, angle_deg: 90"], 0, "radial_walls[0].thickness_mm: is missing"),
        ([wall(more=", colour: red")], 0, "unknown key, expected one of ring, angle_deg, thickness_mm, name"),
        ([wall(), wall(ring=5)], 1, "radial_walls[1].ring: got ring 5"),
        ([wall(ring=7)], 0, "radial_walls[0].ring: got ring 7"),
        ([wall(ring=4, angle=90, thickness=50)], 0, "got 50"),
        (
            [wall(angle=46)],
            0,
            "stands in front of openings[0]: got 1 deg between their middles",
        ),
        ([wall(2, 352)], 0, "stands in front of openings[4]: got 8 deg"),
        ([wall(2, 127)], 0, "stands in front of openings[1]: got 8 deg"),  # of the wall outside the ring
        ([wall(), wall(1, 93)], 1, "overlaps radial_walls[0]: got 3 deg"),
        ([wall(1, 0), wall(1, 359)], 1, "overlaps radial_walls[0]"),
        ([wall(), wall(2, 20, more=", name: wall1@90")], 1, "got the name 'wall1@90', which radial_walls[0] has"),
    ],
)
def test_one_line_says_what_is_wrong_and_where(walls, line, words):
    found = check(*walls)
    assert found.maze is None
    assert any(str(error).startswith(f"m.yaml:{FIRST + line}: ") and words in str(error) for error in found.errors)


def test_flush_beside_an_opening_is_near_enough():
    assert check(wall(angle=52)).errors
    assert not check(wall(angle=52.2)).errors


def test_too_many():
    found = check(*(wall() for _ in range(2001)))
    assert "got 2001 entries" in str(found.errors[0])


def test_a_ring_that_walls_cut_off_is_an_error():
    one = CME.replace("  - {rings: [1, 2], angle_deg: 135, width_mm: 15.3}\n", "")
    one = one.replace("  - {rings: [1, 2], angle_deg: 225, width_mm: 15.3}\n", "")
    one = one.replace("  - {rings: [1, 2], angle_deg: 315, width_mm: 15.3}\n", "")
    for angle in (0, 90, 180, 270):  # only 2-3@90 is left
        one = one.replace(
            f"  - {{rings: [2, 3], angle_deg: {angle}, width_mm: 14.85}}\n",
            "" if angle != 90 else f"  - {{rings: [2, 3], angle_deg: {angle}, width_mm: 14.85}}\n",
        )
    assert not check(wall(2, 20), text=one).errors
    found = check(wall(2, 20), wall(2, 67), text=one)  # ring 1 leads between them, ring 3 lies beyond
    assert found.maze is None
    assert "rings[0]: no way leads from ring 1 to ring 5" in str(found.errors[0])
