"""Radial walls in the view: where the map has them, and on the page."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
from fake_scene import FakeServer

from mazeplan.maze.mapfile import load_map
from mazeplan.view.meshes import radial_mesh
from mazeplan.view.scene import Scene


def test_radial_walls_are_solid_and_in_their_places():
    maze = load_map("detour")
    for wall in maze.radial_walls:
        vertices, faces = radial_mesh(maze, wall, 0.02)
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        ring = maze.ring(wall.ring)
        volume = wall.thickness * (ring.outer_radius - ring.inner_radius) * 0.02
        floor = vertices[np.abs(vertices[:, 2]) < 1e-12]
        assert np.sum(a * np.cross(b, c)) / 6.0 == pytest.approx(volume, rel=0.02)
        x, y = floor.mean(axis=0)[:2]
        assert math.remainder(math.atan2(y, x) - wall.angle, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_the_page_shows_the_radial_walls_of_a_map():
    server: Any = FakeServer()
    maze = load_map("detour")
    Scene(server, maze)
    drawn = sorted(name for name in server.nodes if "/radial" in name)
    assert [name.rsplit("/", 1)[1] for name in drawn] == [f"radial{i}" for i in range(len(maze.radial_walls))]
    assert len([name for name in server.nodes if re.search(r"/ring\d$", name)]) == 4
