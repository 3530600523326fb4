from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from mazeplan.maze.drawing import (
    draw_maze,
    draw_trail,
    radial_outline,
    route_points,
    save_drawing,
    wall_outlines,
)
from mazeplan.maze.graph import Route, RouteGraph
from mazeplan.maze.mapfile import load_map

CME, LOPSIDED, DETOUR = load_map("cme"), load_map("lopsided"), load_map("detour")
MAZES = pytest.mark.parametrize("maze", [CME, LOPSIDED], ids=lambda maze: maze.name)
START = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}


def polygon_area(points: np.ndarray) -> float:
    x, y = points.T
    return 0.5 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))


@MAZES
def test_openings_are_cut_with_parallel_sides(maze):
    for wall in maze.walls[1:]:
        outlines = wall_outlines(wall)
        assert len(outlines) == len(wall.openings)
        corners = np.vstack(outlines)
        for opening in wall.openings:
            along = np.array([math.cos(opening.angle), math.sin(opening.angle)])
            across = np.array([-along[1], along[0]])
            front = corners[(corners @ along) > 0]
            assert np.abs(front @ across).min() == pytest.approx(opening.width / 2)
            sides = front[np.abs(np.abs(front @ across) - opening.width / 2) < 1e-9]
            assert len(sides) == 4


@MAZES
def test_area_of_the_walls_is_the_annulus_less_the_gaps(maze):
    for wall in maze.walls[1:]:
        inner, outer = wall.inner_radius, wall.outer_radius
        radii = np.linspace(inner, outer, 2001)
        gaps = sum(np.trapezoid(2 * np.arcsin(o.width / (2 * radii)) * radii, radii) for o in wall.openings)
        solid = sum(polygon_area(outline) for outline in wall_outlines(wall))
        assert solid == pytest.approx(math.pi * (outer**2 - inner**2) - gaps, rel=1e-4)


@MAZES
def test_route_polyline_goes_through_its_openings(maze):
    route = RouteGraph(maze).route(1, len(maze.rings), 0.5)
    assert route is not None
    points = route_points(maze, route)
    assert math.atan2(points[0, 1], points[0, 0]) == pytest.approx(0.5)
    assert np.hypot(*points[0]) == pytest.approx(maze.track_radius(1))
    assert np.hypot(*points[-1]) == pytest.approx(0.0)
    for leg in route.legs:
        there = maze.track_radius(leg.ring) * np.array([math.cos(leg.opening.angle), math.sin(leg.opening.angle)])
        assert np.linalg.norm(points - there, axis=1).min() < 1e-9
    assert route_points(maze, Route((), 0.0)).shape == (0, 2)


@pytest.mark.parametrize("suffix", START)
def test_files_in_three_formats(tmp_path, suffix):
    route = RouteGraph(CME).route(5, 1, 0.0)
    time = np.linspace(0, 3, 60)
    trail = np.column_stack([0.08 * np.cos(time), 0.08 * np.sin(time), time])
    path = tmp_path / f"maze{suffix}"
    save_drawing(CME, path, route, trail)
    content = path.read_bytes()
    assert content.startswith(START[suffix])
    assert len(content) > 5000


def test_labels_name_rings_angles_axes_and_scale():
    texts = [text.get_text() for text in draw_maze(CME).texts]
    assert {"1", "2", "5", "20 mm", "$x$", "$y$", "315°", "0°"} <= set(texts)
    assert texts.count("180°") == 2
    assert any("beta > 0$ lowers" in text for text in texts)
    assert any("gamma > 0$ lifts" in text for text in texts)
    assert len(draw_maze(CME, labels=False).texts) == 0


def test_ball_is_to_scale_and_lies_where_the_path_starts():
    from matplotlib.patches import Circle

    place = np.array([[0.0, -0.0892], [0.01, -0.0892]])
    circles = [patch for patch in draw_maze(CME, path=place).patches if isinstance(patch, Circle)]
    balls = [circle for circle in circles if circle.get_radius() == pytest.approx(6.35)]
    assert [ball.get_center() for ball in balls] == [pytest.approx((0.0, -89.2))]


def test_closed_openings_are_hatched():
    maze = dataclasses.replace(CME, openings=(dataclasses.replace(CME.openings[0], closed=True), *CME.openings[1:]))
    assert sum(patch.get_hatch() is not None for patch in draw_maze(maze).patches) == 1
    assert not any(patch.get_hatch() for patch in draw_maze(CME).patches)


def test_trail_breaks_where_the_ball_was_not_seen():
    trail = np.column_stack([np.linspace(0, 0.05, 6), np.zeros(6), np.arange(6)])
    trail[3] = np.nan
    ax = draw_maze(CME)
    draw_trail(ax, trail)
    assert len(ax.collections[-1].get_paths()) == 3  # 0-1, 1-2, 4-5
    before = len(ax.collections)
    draw_trail(ax, np.full((4, 3), np.nan))
    draw_trail(ax, np.zeros((1, 3)))
    assert len(ax.collections) == before


@pytest.mark.parametrize("wall", DETOUR.radial_walls, ids=lambda wall: wall.name)
def test_a_radial_wall_has_parallel_sides_from_circle_to_circle(wall):
    outline, ring = radial_outline(DETOUR, wall), DETOUR.ring(wall.ring)
    along, across = (
        outline @ np.array([math.cos(wall.angle + turn), math.sin(wall.angle + turn)]) for turn in (0.0, math.pi / 2)
    )
    assert np.abs(across).max() == pytest.approx(0.5 * wall.thickness)
    r = np.hypot(*outline.T)
    assert (r.min(), r.max()) == (pytest.approx(ring.inner_radius), pytest.approx(ring.outer_radius))
    assert along.min() > 0.0
    assert polygon_area(outline) == pytest.approx(wall.thickness * (ring.outer_radius - ring.inner_radius), rel=0.01)


def test_radial_walls_are_drawn_and_the_route_goes_around_them():
    pieces = [len(draw_maze(maze).patches) for maze in (DETOUR, dataclasses.replace(DETOUR, radial_walls=()))]
    assert pieces[0] - pieces[1] == len(DETOUR.radial_walls)
    route = RouteGraph(DETOUR).route(1, 4, math.radians(120.0))
    assert route is not None
    points = route_points(DETOUR, route)
    for wall in DETOUR.radial_walls:
        ring = DETOUR.ring(wall.ring)
        inside = points[(np.hypot(*points.T) > ring.inner_radius) & (np.hypot(*points.T) < ring.outer_radius)]
        aside = inside @ np.array([-math.sin(wall.angle), math.cos(wall.angle)])
        before = inside @ np.array([math.cos(wall.angle), math.sin(wall.angle)]) > 0.0
        assert np.abs(aside[before]).min(initial=1.0) > 0.5 * wall.thickness
