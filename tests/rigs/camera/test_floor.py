"""The straightened floor, and what walls hide of it, against lines of sight followed step by step."""

from __future__ import annotations

import math

import numpy as np
import pytest
from emulator.render import TRUE
from scenes import MAZE

from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.camera.floor import Floor

FLOOR = Floor(MAZE)


def solid(maze, x, y):
    """Whether there is wall at a place, worked out from the map."""
    r = math.hypot(x, y)
    for wall in maze.walls:
        if wall.inner_radius <= r <= wall.outer_radius:
            for opening in wall.openings:
                c, s = math.cos(opening.angle), math.sin(opening.angle)
                if c * x + s * y > 0.0 and abs(c * y - s * x) < 0.5 * opening.width:
                    return False
            return True
    for wall in maze.radial_walls:
        ring, (c, s) = maze.ring(wall.ring), (math.cos(wall.angle), math.sin(wall.angle))
        across = abs(c * y - s * x) < 0.5 * wall.thickness
        if across and ring.inner_radius <= r <= ring.outer_radius and c * x + s * y > 0.0:
            return True
    return r > maze.walls[0].inner_radius


@pytest.mark.slow
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.085, -0.06), (-0.085, 0.085)])
def test_walls_hide_what_lines_of_sight_meet(tilt):
    eye = TRUE.centre(*tilt)
    mask = FLOOR.visible(eye)
    rng = np.random.default_rng(1)
    agree = hidden_by_height = known = 0
    places = rng.uniform(-0.097, 0.097, (1500, 2))
    for x, y in places:
        heights = np.linspace(0.0, MAZE.wall_height, 25)
        blocked = [solid(MAZE, *(np.array([x, y]) + (eye[:2] - np.array([x, y])) * z / eye[2])) for z in heights]
        column, row = np.round(FLOOR.pixels(np.array([[x, y]]))[0]).astype(int)
        agree += (mask[row, column] == 0) == any(blocked)
        if any(blocked) and not blocked[0]:
            hidden_by_height += 1
            known += mask[row, column] == 0
    assert hidden_by_height > 20
    assert known > 0.9 * hidden_by_height
    assert agree > 0.96 * len(places)  # all but the borders, where a pixel is half hidden


def test_the_straightened_floor_does_not_depend_on_the_tilt():
    rows, columns = np.mgrid[0:480, 0:640]
    picture = np.dstack([columns * 0.3, rows * 0.4, np.zeros((480, 640))]).astype(np.uint8)
    places = np.array([[0.05, 0.06], [-0.08, 0.01], [0.02, -0.09]])
    for beta, gamma in ((0.0, 0.0), (0.08, 0.03), (-0.05, -0.085)):
        straight = FLOOR.straighten(picture, TRUE, beta, gamma)
        expected = TRUE.project(np.column_stack([places, np.zeros(3)]), beta, gamma) * (0.3, 0.4)
        for (column, row), (blue, green) in zip(np.round(FLOOR.pixels(places)).astype(int), expected, strict=True):
            assert abs(float(straight[row, column, 0]) - blue) < 1.2
            assert abs(float(straight[row, column, 1]) - green) < 1.2


def test_radial_walls_are_solid():
    maze = load_map("detour")
    floor = Floor(maze)
    for wall in maze.radial_walls:
        r = maze.track_radius(wall.ring)
        for turn in np.radians([-12.0, 0.0, 12.0]):
            at = r * np.array([[math.cos(wall.angle + turn), math.sin(wall.angle + turn)]])
            x, y = np.round(floor.pixels(at)[0]).astype(int)
            assert (floor.solid[y, x] > 200) == solid(maze, *at[0]) == (turn == 0.0)
