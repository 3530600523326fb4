"""Parts of the maze as triangles: (V, 3) vertices in m and (F, 3) faces, counter-clockwise seen from outside.

Corners are not shared between faces that meet at an edge, so that edges stay sharp in the light.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from mazeplan.core.records import Array, IntArray
from mazeplan.maze.geometry import Maze, Opening, RadialWall, Wall

STEP = math.radians(3.0)  # maximum angle between points of an arc
Mesh = tuple[Array, IntArray]


def joined(meshes: Iterable[Mesh]) -> Mesh:
    """One mesh made of several meshes."""
    vertices, faces, count = [], [], 0
    for points, triangles in meshes:
        vertices.append(points)
        faces.append(triangles + count)
        count += len(points)
    return np.vstack(vertices), np.vstack(faces)


def strip(left: Array, right: Array) -> Mesh:
    """A band between two lines, (N, 3) each; its front is seen with `left` on the left, looking along it."""
    n = len(left)
    i = np.arange(n - 1)
    first = np.column_stack([i, i + n, i + 1])
    second = np.column_stack([i + 1, i + n, i + n + 1])
    return np.vstack([left, right]), np.vstack([first, second])


def arc(radius: float, angles: Array, z: float) -> Array:
    """Points on a circle, (N, 3)."""
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(len(angles), z)])


def sector(inner: tuple[float, Array], outer: tuple[float, Array], low: float, high: float, *, ends: bool) -> Mesh:
    """A piece of wall between two arcs (radius, angles) of as many points, from z = low to high."""
    r, a = inner
    big_r, b = outer
    parts = [
        strip(arc(r, a, high), arc(big_r, b, high)),
        strip(arc(big_r, b, high), arc(big_r, b, low)),
        strip(arc(r, a, low), arc(r, a, high)),
    ]
    if ends:
        for k, turned in ((0, False), (-1, True)):
            feet = np.vstack([arc(r, a[[k]], low), arc(big_r, b[[k]], low)])
            heads = feet + np.array([0.0, 0.0, high - low])
            parts.append(strip(feet, heads) if turned else strip(heads, feet))
    return joined(parts)


def wall_mesh(wall: Wall, height: float) -> Mesh:
    """The solid pieces of a wall between its openings, whose sides are parallel."""
    if not wall.openings:
        around = np.linspace(0.0, 2.0 * math.pi, 181)
        return sector((wall.inner_radius, around), (wall.outer_radius, around), 0.0, height, ends=False)
    gaps = sorted(wall.openings, key=lambda o: o.angle % (2.0 * math.pi))
    pieces = []
    for here, following in zip(gaps, gaps[1:] + gaps[:1], strict=True):
        start, end = here.angle % (2.0 * math.pi), following.angle % (2.0 * math.pi)
        end += 2.0 * math.pi if following is gaps[0] else 0.0
        count = max(3, math.ceil((end - start) / STEP))
        inner, outer = (
            (radius, np.linspace(start + _half(here, radius), end - _half(following, radius), count))
            for radius in (wall.inner_radius, wall.outer_radius)
        )
        pieces.append(sector(inner, outer, 0.0, height, ends=True))
    return joined(pieces)


def radial_mesh(maze: Maze, wall: RadialWall, height: float) -> Mesh:
    """A wall across a ring, whose sides are parallel."""
    ring = maze.ring(wall.ring)
    inner, outer = (
        (radius, wall.angle + wall.half_angle(radius) * np.linspace(-1.0, 1.0, 5))
        for radius in (ring.inner_radius, ring.outer_radius)
    )
    return sector(inner, outer, 0.0, height, ends=True)


def _half(opening: Opening, radius: float) -> float:
    """Half the angle, rad, that an opening with parallel sides takes at a radius."""
    return math.asin(0.5 * opening.width / radius)


def ring_floor(maze: Maze, ring: int) -> Mesh:
    """The floor of a ring. It reaches to the middle of the walls on both sides."""
    walls = maze.walls
    outer = 0.5 * (walls[ring - 1].inner_radius + walls[ring - 1].outer_radius)
    inner = 0.5 * (walls[ring].inner_radius + walls[ring].outer_radius) if ring < len(maze.rings) else 0.0
    around = np.linspace(0.0, 2.0 * math.pi, 121)
    return strip(arc(inner, around, 0.0), arc(outer, around, 0.0))


def prism(feet: Array, height: float) -> Mesh:
    """A block without a floor over four corners (4, 3), counter-clockwise."""
    heads = feet + np.array([0.0, 0.0, height])
    sides = [strip(heads[[i, (i + 1) % 4]], feet[[i, (i + 1) % 4]]) for i in range(4)]
    return joined([strip(heads[[0, 1]], heads[[3, 2]]), *sides])


def gap_box(maze: Maze, opening: Opening, low: float, high: float) -> Mesh:
    """A block that fills an opening from z = low to high, such as a mark on its floor or a plug."""
    inner, outer = maze.ring(opening.inner).outer_radius, maze.ring(opening.outer).inner_radius
    along = np.array([math.cos(opening.angle), math.sin(opening.angle), 0.0])
    across, half = np.array([-along[1], along[0], 0.0]), 0.5 * opening.width
    corners = [(inner, -half), (outer, -half), (outer, half), (inner, half)]
    feet = np.array([radius * along + side * across for radius, side in corners]) + np.array([0.0, 0.0, low])
    return prism(feet, high - low)
