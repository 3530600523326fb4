from __future__ import annotations

import dataclasses
import math

import pytest

from mazeplan.core import resources
from mazeplan.core.errors import MapError
from mazeplan.maze.geometry import Ring
from mazeplan.maze.mapfile import MapCheck, check_map, check_text, dump_map, load_map, packaged_maps
from mazeplan.maze.mapschema import default_name

CME = resources.find("maps", "cme", ".yaml").read_text()


def changed(old: str, new: str) -> MapCheck:
    assert old in CME
    return check_text(CME.replace(old, new, 1), file="a.yaml")


def line_of(text: str) -> int:
    return CME[: CME.index(text)].count("\n") + 1


def test_cme_has_the_published_geometry():
    maze = load_map("cme")
    tracks = [ring.track_radius * 1000 for ring in maze.rings]
    assert tracks == pytest.approx([89.19, 68.92, 48.79, 28.67, 0.0], abs=0.006)
    assert [(wall.outer_radius - wall.inner_radius) * 1000 for wall in maze.walls] == pytest.approx([5.0] * 5, abs=0.03)
    assert [len(maze.openings_between(i, i + 1)) for i in range(1, 5)] == [4, 4, 4, 1]
    angles = {round(math.degrees(o.angle)) for o in maze.openings_between(2, 3)}
    assert angles == {0, 90, 180, 270}
    assert maze.opening("4-5@180").width == pytest.approx(0.0155)
    assert (maze.ball.radius, maze.ball.mass) == pytest.approx((0.00635, 0.0084))
    assert maze.tilt_limit == math.radians(5)
    assert maze.wall_height == 0.02


def test_second_map_is_playable_with_the_same_ball():
    cme, maze = load_map("cme"), load_map("lopsided")
    assert len(maze.rings) == 3
    assert maze.ball == cme.ball
    for ring in maze.rings[:-1]:
        room = ring.outer_radius - ring.inner_radius - 2 * maze.ball.radius
        assert 2.3e-3 < room < 3.1e-3
    widths = [opening.width for opening in maze.openings]
    assert len(set(widths)) == len(widths)
    assert 0.014 <= min(widths) < max(widths) <= 0.017


@pytest.mark.parametrize("name", packaged_maps())
def test_packaged_maps_survive_a_round_trip(name):
    result = check_map(name)
    assert result.errors == ()
    assert result.warnings == ()
    assert result.maze is not None
    again = check_text(dump_map(result.maze)).maze
    assert again == result.maze


def test_load_map_takes_a_path_and_remembers_it(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(CME)
    for source in (path, str(path)):
        assert load_map(source) == load_map("cme")
        assert load_map(source).source == str(path)


def test_defaults_and_optional_keys():
    line = "  - {rings: [2, 1], angle_deg: 45, width_mm: 15.3, name: north-east, closed: true, extra_cost_s: 2}"
    maze = changed("  - {rings: [1, 2], angle_deg: 45, width_mm: 15.3}", line).maze
    assert maze is not None
    opening = maze.opening("north-east")
    assert (opening.outer, opening.inner, opening.closed, opening.extra_cost) == (1, 2, True, 2.0)
    assert maze.openings[1].name == "1-2@135"
    assert default_name(1, 2, 100.5) == "1-2@100.5"


ANGLE = "angle_deg: 45, width_mm: 15.3"
OPENING = "  - {rings: [1, 2], angle_deg: 45, width_mm: 15.3}"


@pytest.mark.parametrize(
    ("old", "new", "key", "problem"),
    [
        (ANGLE, "angle_deg: 400, width_mm: 15", "openings[0].angle_deg", "got 400"),
        (ANGLE, "angle_deg: 360, width_mm: 15", "openings[0].angle_deg", "got 360"),
        (ANGLE, "angle_deg: .nan, width_mm: 15", "openings[0].angle_deg", "got nan"),
        (ANGLE, "angle_deg: 1e999, width_mm: 15", "openings[0].angle_deg", "got inf"),
        (ANGLE, "angle_deg: true, width_mm: 15", "openings[0].angle_deg", "got true"),
        (ANGLE, 'angle_deg: "45", width_mm: 15', "openings[0].angle_deg", "got '45'"),
        (ANGLE, "angle_deg: , width_mm: 15", "openings[0].angle_deg", "got nothing"),
        (ANGLE, "angle_deg: 45, width_mm: 12.7", "openings[0].width_mm", "got 12.7"),
        (ANGLE, "angle_deg: 45, width_mm: 155", "openings[0].width_mm", "got 155"),
        (ANGLE, "angle_deg: 45", "openings[0].width_mm", "missing"),
        (ANGLE, "angel_deg: 45, width_mm: 15", "openings[0].angel_deg", "unknown key, expected one of"),
        (ANGLE, ANGLE + ", colour: red", "openings[0].colour", "unknown key, expected one of rings, angle_deg"),
        (ANGLE, ANGLE + ", closed: yes", "openings[0].closed", "got 'yes'"),
        (ANGLE, ANGLE + ", name: 5", "openings[0].name", "got 5"),
        (ANGLE, ANGLE + ', name: "a/b"', "openings[0].name", "got 'a/b'"),
        (ANGLE, ANGLE + ", extra_cost_s: -1", "openings[0].extra_cost_s", "got -1"),
        (OPENING, OPENING.replace("[1, 2]", "[1, 3]"), "openings[0].rings", "got [1, 3]"),
        (OPENING, OPENING.replace("[1, 2]", "[2, 2]"), "openings[0].rings", "got [2, 2]"),
        (OPENING, OPENING.replace("[1, 2]", "[5, 6]"), "openings[0].rings", "got ring 6"),
        (OPENING, OPENING.replace("[1, 2]", "[1.0, 2]"), "openings[0].rings[0]", "got 1.0"),
        (OPENING, OPENING.replace("[1, 2]", "[1]"), "openings[0].rings[1]", "is missing"),
        ("ball: {radius_mm: 6.35, mass_g: 8.4}", "ball: steel", "ball", "got 'steel'"),
        ("radius_mm: 6.35", "radius_mm: 0.00635", "ball.radius_mm", "got 0.00635"),
        ("radius_mm: 6.35", "radius_mm: 7.8", "rings[0].outer_radius_mm", "got a ring 15.4 mm wide"),
        ("tilt_limit_deg: 5", "tilt_limit_deg: 0", "tilt_limit_deg", "got 0"),
        ("wall_height_mm: 20", "wall_height_mm: 3", "wall_height_mm", "got 3"),
        ("outer_radius_mm: 76.49", "outer_radius_mm: 86.49", "rings[1].outer_radius_mm", "expected at most 80.49"),
        ("outer_radius_mm: 76.49", "outer_radius_mm: 81.4", "rings[1].outer_radius_mm", "a wall of at least 1 mm"),
        (
            "outer_radius_mm: 76.49",
            "outer_radius_mm: 60",
            "rings[1].outer_radius_mm",
            "expected more than inner_radius",
        ),
        ("inner_radius_mm: 0,", "inner_radius_mm: 1,", "rings[4].inner_radius_mm", "expected 0: the last ring"),
        ("inner_radius_mm: 21.11", "inner_radius_mm: 0", "rings[3].inner_radius_mm", "only the last ring is a disc"),
    ],
)
def test_each_mistake_is_named_with_its_line(old, new, key, problem):
    first = changed(old, new).errors[0]
    assert first.key == key
    assert problem in str(first)
    line = line_of(old)
    if key.startswith("rings") and not old.startswith(("inner", "outer")):
        line = line_of("inner_radius_mm: 81.49")
    assert str(first).startswith(f"a.yaml:{line}: {key}: ")
    assert "\n" not in str(first)


def test_overlap_counts_the_edges_of_both_openings():
    radius = 16.11 + 60.38  # outer radius of ring 2, where the gap is widest in angle
    needed = 2 * math.degrees(math.asin(0.5 * 15.3 / radius))
    bad = changed("angle_deg: 135", f"angle_deg: {45 + needed - 0.01:.6f}")
    assert [error.key for error in bad.errors] == ["openings[1].angle_deg"]
    assert "overlaps openings[0]" in str(bad.errors[0])
    assert changed("angle_deg: 135", f"angle_deg: {45 + needed + 0.01:.6f}").maze is not None


def test_ring_behind_closed_openings_is_a_warning():
    result = changed("width_mm: 15.5", "width_mm: 15.5, closed: true")
    assert result.maze is not None
    assert len(result.warnings) == 1
    assert "a.yaml:27: rings[4]: warning: ring 5 can be reached only through closed" in result.warnings[0]


def test_all_problems_are_reported_in_the_order_of_the_file():
    text = CME.replace("angle_deg: 45", "angle_deg: 400").replace("mass_g: 8.4", "mass_g: -1")
    errors = check_text(text).errors
    assert [error.key for error in errors] == ["ball.mass_g", "openings[0].angle_deg", "openings[8].angle_deg"]
    lines = [error.line or 0 for error in errors]
    assert lines == sorted(lines)


@pytest.mark.parametrize("text", ["[]", "3", "text", "- a\n- b\n", "{}", "a: 1", "{1: 2}"])
def test_not_a_map_at_all(text):
    result = check_text(text, file="f")
    assert result.maze is None
    assert all(isinstance(error, MapError) for error in result.errors)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("nope", "not a packaged map, which are: cme, detour, lopsided, seven"),
        ("nope.yaml", "no such file"),
        ("nope/nope", "no such file"),
        ("/", "folder"),
        ("/dev/zero", "got a device or pipe"),
        ("a\0b", "not the name of a map"),
        ("a\nb", "not the name of a map"),
        ("x" * 5000, "not the name of a map"),
        ("x" * 300 + ".yaml", "not the name of a map"),
        ("", "folder"),
    ],
)
def test_sources_that_cannot_be_read(source, words):
    with pytest.raises(MapError, match=words) as caught:
        load_map(source)
    assert "\n" not in str(caught.value)


def test_dump_of_a_ring_that_was_never_in_a_file():
    maze = load_map("lopsided")
    third = 0.1 / 3
    rings = (Ring(1, maze.rings[0].inner_radius, third * 2), *maze.rings[1:])
    again = check_text(dump_map(dataclasses.replace(maze, rings=rings))).maze
    assert again is not None
    assert again.rings[0].outer_radius == pytest.approx(third * 2, rel=1e-15)
