"""Overlaps with walls, against points spread over the walls themselves."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numba import njit

from mazeplan.maze.geometry import RadialWall
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.dynamics.walls import (
    ROUNDING,
    gap_of,
    into_face,
    into_side,
    into_slab,
    near_wall,
    outside_rim,
    pack_walls,
    wall_core,
)

MAZE = load_map("cme")
GRID = 2e-4  # m between points of a wall


@njit
def overlaps(walls, places):
    """Largest overlap with a wall, m, (N,), of a ball at each of the places (N, 2); 0 for none."""
    core, out = wall_core(walls), np.zeros(len(places))
    for n in range(len(places)):
        x, y = places[n, 0], places[n, 1]
        most = outside_rim(core, x, y)[0]
        for i in range(core.n_walls):
            if near_wall(core, i, x, y):
                j = gap_of(core, i, x, y)
                if j < 0:
                    most = max(most, into_face(core, i, x, y)[0])
                else:
                    most = max(most, into_side(core, j, -1.0, x, y)[0], into_side(core, j, 1.0, x, y)[0])
        for b in range(core.n_slabs):
            most = max(most, into_slab(core, b, x, y)[0])
        out[n] = most
    return out


def core_points(wall):
    """Points of a wall that is smaller by the rounding of its edges, (K, 2)."""
    r = np.arange(wall.inner_radius + ROUNDING, wall.outer_radius - ROUNDING + 1e-9, GRID)
    r = np.append(r, wall.outer_radius - ROUNDING)
    angle = np.arange(0.0, 2.0 * math.pi, GRID / wall.outer_radius)
    r, angle = (part.ravel() for part in np.meshgrid(r, angle))
    solid = np.ones(len(r), dtype=bool)
    for opening in wall.openings:
        along, across = r * np.cos(angle - opening.angle), r * np.sin(angle - opening.angle)
        solid &= (along < 0.0) | (np.abs(across) > 0.5 * opening.width + ROUNDING)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle)])[solid]


def test_overlaps_are_those_with_all_points_of_the_walls():
    from scipy.spatial import KDTree

    tree = KDTree(np.vstack([core_points(wall) for wall in MAZE.walls[1:]]))
    rng = np.random.default_rng(1)
    r, angle = rng.uniform(0.0, 0.092, 4000), rng.uniform(-math.pi, math.pi, 4000)
    places = np.column_stack([r * np.cos(angle), r * np.sin(angle)])
    away = tree.query(places)[0]
    outside = away > 2.0 * GRID  # inside a wall the way out is another question
    wanted = np.maximum(MAZE.ball.radius + ROUNDING - away, r + MAZE.ball.radius - MAZE.rings[0].outer_radius)
    found = overlaps(pack_walls(MAZE), places)
    assert outside.sum() > 3000
    np.testing.assert_allclose(found[outside], np.maximum(wanted, 0.0)[outside], atol=GRID)


def test_a_radial_wall_is_flat():
    walled = load_map("cme")
    walled = replace(walled, radial_walls=(RadialWall("wall1@90", 1, math.pi / 2, 0.004),))
    walls, reach = pack_walls(walled), MAZE.ball.radius + 0.002
    beside = np.array([[reach - 1e-3, 0.0892], [-reach + 2e-3, 0.0892], [reach + 1e-4, 0.0892], [0.004, -0.0892]])
    np.testing.assert_allclose(overlaps(walls, beside), [1e-3, 2e-3, 0.0, 0.0], atol=1e-9)


def test_thin_walls_have_sharper_edges():
    inside = [*(ring.outer_radius + 1e-3 for ring in MAZE.rings[1:]), 0.0]
    thin = tuple(replace(ring, inner_radius=r) for ring, r in zip(MAZE.rings, inside, strict=True))
    walls = pack_walls(replace(MAZE, rings=thin))
    assert walls.rounding == pytest.approx(5e-4)
    np.testing.assert_allclose(walls.walls[:, 0], walls.walls[:, 1])
