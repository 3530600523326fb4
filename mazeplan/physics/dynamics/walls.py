"""Walls of a maze for compiled code, and their overlap with a ball.

A wall is an annulus cut by openings with parallel sides. Its edges at an opening are rounded by `ROUNDING`:

    wall = all points within ROUNDING of the core,   core = the wall made smaller by ROUNDING on every side

So the centre of a ball of radius R stays R + ROUNDING away from the core, or R away from a wall without edges. The
nearest point of the core lies at the ball's angle. If that point falls into an opening, the nearest point lies on one
of the two sides of the opening.
"""

from __future__ import annotations

import math
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from mazeplan.core.maths.compiled import CALLEE, pointer_to
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze

ROUNDING = 1e-3  # m, radius of the edges at an opening
# columns of a row, and their number: of `Walls.walls`, of `Walls.gaps`, and of `Walls.slabs`, which begin as gaps do
LOW, HIGH, GAPS_FROM, GAPS_TO, WALL = range(5)
COS, SIN, HALF, SIDES_FROM, SIDES_TO, GAP = range(6)
RING_INNER, RING_OUTER, SLAB = range(3, 6)
NEAREST = 1e-12  # m; two points that are closer define no direction


class Walls(NamedTuple):
    """All walls of a maze.

    walls:    (W, 4) per wall between rings: inner and outer radius of its core, index of its first gap, index after
              its last gap
    gaps:     (G, 5) per opening: cos(angle), sin(angle), half width of the gap in the core, and where on the middle
              line of the gap its sides begin and end"""

    walls: Array
    gaps: Array
    slabs: Array  # (B, 5) per radial wall: cos(angle), sin(angle), half thickness, inner and outer radius of its ring
    rim: float  # radius of the rim, m
    radius: float  # radius of the ball, m
    rounding: float  # radius of the edges, m


def pack_walls(maze: Maze) -> Walls:
    """The walls of a maze for compiled code. Edges are rounded by ROUNDING, or less if a wall is too thin for it."""
    thinnest = min((wall.outer_radius - wall.inner_radius for wall in maze.walls[1:]), default=1.0)
    rounding = min(ROUNDING, 0.5 * thinnest)
    walls, gaps = [], []
    for wall in maze.walls[1:]:
        low, high = wall.inner_radius + rounding, wall.outer_radius - rounding
        walls.append([low, high, float(len(gaps)), float(len(gaps) + len(wall.openings))])
        for opening in wall.openings:
            half = 0.5 * opening.width + rounding
            ends = (math.sqrt(max(end * end - half * half, 0.0)) for end in (low, high))
            gaps.append([math.cos(opening.angle), math.sin(opening.angle), half, *ends])
    slabs = []
    for across in maze.radial_walls:
        ring = maze.ring(across.ring)
        place = math.cos(across.angle), math.sin(across.angle)
        slabs.append([*place, 0.5 * across.thickness, ring.inner_radius, ring.outer_radius])
    rows = (np.array(part, dtype=float).reshape(-1, n) for part, n in ((walls, WALL), (gaps, GAP), (slabs, SLAB)))
    return Walls(*rows, rim=maze.rings[0].outer_radius, radius=maze.ball.radius, rounding=rounding)


def corners(walls: Walls) -> Array:
    """The corners of the cores at the openings, (4 G, 2), m. The centre of a ball that touches an edge is `radius +
    rounding` away from one of them."""
    places = [np.empty((0, 2))]
    for low, high, first, last in walls.walls:
        for cos, sin, half, *_ in walls.gaps[int(first) : int(last)]:
            for r, across in product((low, high), (-half, half)):
                along = math.sqrt(max(r * r - across * across, 0.0))
                places.append(np.array([[cos * along - sin * across, sin * along + cos * across]]))
    return np.concatenate(places)


class WallCore(NamedTuple):
    """Pointers into `Walls`, and its numbers. Functions pass it on without counting references to arrays."""

    walls: Any
    gaps: Any
    slabs: Any
    n_walls: int
    n_slabs: int
    rim: float
    radius: float
    reach: float


@njit(**CALLEE)
def wall_core(walls):
    """The pointers and numbers of packed walls; the caller keeps the walls alive."""
    return WallCore(
        pointer_to(walls.walls, 0), pointer_to(walls.gaps, 0), pointer_to(walls.slabs, 0), len(walls.walls),
        len(walls.slabs), walls.rim, walls.radius, walls.radius + walls.rounding,
    )  # fmt: skip


@njit(**CALLEE)
def outside_rim(core, x, y):
    """(depth, nx, ny): overlap of the ball with the rim, m, 0 for none, and the normal away from the rim."""
    r2, most = x * x + y * y, core.rim - core.radius
    if r2 <= most * most:
        return 0.0, 0.0, 0.0
    r = math.sqrt(r2)
    return r - most, -x / r, -y / r


@njit(**CALLEE)
def near_wall(core, i, x, y):
    """Whether wall i can touch a ball at (x, y)."""
    r2 = x * x + y * y
    inner, outer = core.walls[WALL * i + LOW] - core.reach, core.walls[WALL * i + HIGH] + core.reach
    return inner < 0.0 or inner * inner < r2 < outer * outer


@njit(**CALLEE)
def gap_of(core, i, x, y):
    """Index of the gap of wall i that holds the point nearest to (x, y) between the radii of the core; -1 for none."""
    low, high = core.walls[WALL * i + LOW], core.walls[WALL * i + HIGH]
    r = math.sqrt(x * x + y * y)
    if r < NEAREST:
        return -1
    shrink = min(max(r, low), high) / r
    for j in range(int(core.walls[WALL * i + GAPS_FROM]), int(core.walls[WALL * i + GAPS_TO])):
        c, s = core.gaps[GAP * j + COS], core.gaps[GAP * j + SIN]
        if c * x + s * y > 0.0 and abs(c * y - s * x) * shrink < core.gaps[GAP * j + HALF]:
            return j
    return -1


@njit(**CALLEE)
def into_face(core, i, x, y):
    """(depth, nx, ny) as `outside_rim`, for the round faces of wall i and a ball that is not in front of a gap."""
    low, high = core.walls[WALL * i + LOW], core.walls[WALL * i + HIGH]
    r = math.sqrt(x * x + y * y)
    if r < NEAREST:
        return 0.0, 0.0, 0.0
    if r > 0.5 * (low + high):
        return high + core.reach - r, x / r, y / r
    return r - (low - core.reach), -x / r, -y / r


@njit(**CALLEE)
def into_side(core, j, side, x, y):
    """(depth, nx, ny) as `outside_rim`, for one side (-1.0, 1.0) of gap j: its face and its two edges."""
    c, s, half = core.gaps[GAP * j + COS], core.gaps[GAP * j + SIN], core.gaps[GAP * j + HALF]
    along, across = c * x + s * y, c * y - s * x
    da = along - min(max(along, core.gaps[GAP * j + SIDES_FROM]), core.gaps[GAP * j + SIDES_TO])
    db = across - side * half
    d2 = da * da + db * db
    if d2 >= core.reach * core.reach or d2 < NEAREST * NEAREST:
        return 0.0, 0.0, 0.0
    d = math.sqrt(d2)
    return core.reach - d, (c * da - s * db) / d, (s * da + c * db) / d


@njit(**CALLEE)
def into_slab(core, b, x, y):
    """(depth, nx, ny) as `outside_rim`, for radial wall b."""
    c, s, reach = core.slabs[SLAB * b + COS], core.slabs[SLAB * b + SIN], core.slabs[SLAB * b + HALF] + core.radius
    across, r = c * y - s * x, math.sqrt(x * x + y * y)
    inside = core.slabs[SLAB * b + RING_INNER] < r < core.slabs[SLAB * b + RING_OUTER]
    if not inside or abs(across) >= reach or c * x + s * y <= 0.0:
        return 0.0, 0.0, 0.0
    side = 1.0 if across > 0.0 else -1.0
    return reach - abs(across), -s * side, c * side
