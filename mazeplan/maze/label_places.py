"""Where words and numbers stand in the drawing of a maze: clear of walls, of paths and of each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mazeplan.core.maths.angles import difference
from mazeplan.maze.geometry import Maze, Opening

Array = NDArray[np.float64]
SHOWN = 1.27  # a picture with labels shows this many radii of the rim to each side
WORD = (0.066, 0.02)  # half width and half height of "ring 1", as a share of what the picture shows to each side
_NEAR = 1.6  # minimum distance of a ring's number from a path, in radii of the ball
SIZES = (6.5, 5.5, 4.5)  # pt, the most readable first
MARGIN = 0.7e-3  # m around a name
FAR = 0.28  # maximum distance from the middle of an opening to its name, in radii of the rim
STEP = 1e-3  # m from point to point of a line, less than the height of a name


def _label_radius(maze: Maze, ring: int) -> float:
    """Radius at which a ring's number stands, m: on the track; in the disc, beside the centre."""
    return maze.track_radius(ring) or 0.55 * maze.ring(ring).outer_radius


def word_fits(maze: Maze, place: Array) -> bool:
    """Whether "ring 1" touches no circular wall at a place (2,) in m."""
    half = maze.walls[0].outer_radius * SHOWN * np.array(WORD)
    far = np.linalg.norm(place + half * [[-1, -1], [-1, 1], [1, 1], [1, -1], [0, 1], [0, -1]], axis=1)
    return bool(maze.ring(1).inner_radius < far.min() and far.max() < maze.ring(1).outer_radius)


def number_places(maze: Maze, path: Array | None = None) -> list[Array]:
    """Places of the rings' numbers, (2,) in m each, far from openings, radial walls and path.

    All numbers stand on one ray. If a ring has no room there, its number stands at another angle."""
    radii = [_label_radius(maze, ring.number) for ring in maze.rings]
    taken = [maze.threshold_radius(opening) * _unit(opening.angle) for opening in maze.openings]
    taken += [maze.track_radius(wall.ring) * _unit(wall.angle) for wall in maze.radial_walls]
    crowd = np.vstack([np.empty((0, 2)), *taken, *([] if path is None else [path])])
    enough = 3.0 * maze.ball.radius

    def room(radius: float, angle: float) -> float:
        """The distance from a place to what a number must not touch, at most `enough`, m."""
        gap = float(np.linalg.norm(radius * _unit(angle) - crowd, axis=1).min(initial=enough))
        return round(gap, 6)

    def preference(angle: float) -> float:
        """Decides ties, of which symmetric mazes have many: the upper left is best."""
        return math.cos(angle - 2.0)

    rays = np.radians(np.arange(0.0, 360.0, 2.5)).tolist()
    worded = [ray for ray in rays if word_fits(maze, radii[0] * _unit(ray))] or rays
    common = max(worded, key=lambda ray: (round(sum(room(r, ray) for r in radii), 6), preference(ray)))

    def angle_of(ring: int, radius: float) -> float:
        if room(radius, common) >= min(enough, _NEAR * maze.ball.radius):
            return common
        free = worded if ring == 1 else rays
        return max(free, key=lambda ray: (room(radius, ray), -abs(difference(ray, common))))

    return [r * _unit(angle_of(ring.number, r)) for ring, r in zip(maze.rings, radii, strict=True)]


def ball_place(maze: Maze, number: Array) -> Array:
    """Place of the ball in ring 1 if there is no path, (2,) in m: far from openings, radial walls and the number of
    this ring."""
    first = math.atan2(number[1], number[0])
    taken = [opening.angle for opening in maze.openings if opening.outer == 1] + [first - 0.2, first, first + 0.2]
    taken += [wall.angle for wall in maze.radial_walls_of(1)]
    rays = np.radians(np.arange(0.0, 360.0, 2.5)).tolist()
    ray = max(
        rays, key=lambda ray: (round(min(abs(difference(ray, angle)) for angle in taken), 6), math.cos(ray - 2.0))
    )
    return maze.track_radius(1) * _unit(ray)


@dataclass(frozen=True)
class Name:
    """The name of an opening in a drawing.

    place: middle of the name (2,), m
    size: of the type, pt
    box: half of its width and height (2,), m
    """

    text: str
    place: Array
    size: float
    box: Array


def name_places(
    maze: Maze, lines: Sequence[Array], taken: Sequence[tuple[Array, Array]], m_per_pt: float
) -> list[Name]:
    """Names of the openings that have room, from the outermost.

    lines: walls and paths, (N, 2) in m each
    taken: places (2,) and half sizes (2,) of other things in the drawing, m
    m_per_pt: length of a point of type in the drawing
    """
    from matplotlib.textpath import TextPath

    drawn = np.vstack([np.empty((0, 2)), *(dense(line) for line in lines)])
    boxes, found, far = list(taken), list[Name](), FAR * maze.walls[0].outer_radius
    for opening in sorted(maze.openings, key=lambda opening: (opening.outer, opening.angle)):
        middle = maze.threshold_radius(opening) * _unit(opening.angle)
        near = drawn[np.linalg.norm(drawn - middle, axis=1) < 2.0 * far]
        for size in SIZES:
            extent = TextPath((0.0, 0.0), opening.name, size=size).get_extents()
            box = 0.5 * m_per_pt * np.array([extent.width, 1.2 * size])
            place = next((at for at in _candidates(maze, opening, middle, far) if _free(at, box, near, boxes)), None)
            if place is not None:
                found.append(Name(opening.name, place, size, box))
                boxes.append((place, box))
                break
    return found


def dense(line: Array) -> Array:
    """A line (N, 2) in m with points at most `STEP` apart; NaN breaks it."""
    line = line[np.isfinite(line).all(axis=1)]
    if len(line) < 2:
        return line
    long = np.linalg.norm(np.diff(line, axis=0), axis=1)
    pieces = [
        np.linspace(a, b, max(1, math.ceil(length / STEP)), endpoint=False)
        for a, b, length in zip(line[:-1], line[1:], long, strict=True)
    ]
    return np.vstack([*pieces, line[-1:]])


def _candidates(maze: Maze, opening: Opening, middle: Array, far: float) -> Array:
    """Places (N, 2) in m for a name, in the opening and in the two rings beside it, the nearest first."""
    places = [] if opening.closed else [middle]
    for number in (opening.outer, opening.inner):
        ring = maze.ring(number)
        inside = np.linspace(ring.inner_radius, ring.outer_radius, 9)[1:-1]
        for radius in inside:
            turn = np.linspace(-1.0, 1.0, 41) * min(math.pi, far / max(radius, 1e-3))
            angles = opening.angle + turn
            places += list(radius * np.column_stack([np.cos(angles), np.sin(angles)]))
    found = np.array(places)
    away = np.linalg.norm(found - middle, axis=1)
    return found[np.argsort(away, kind="stable")][: int((away <= far).sum())]


def _free(place: Array, box: Array, drawn: Array, boxes: Sequence[tuple[Array, Array]]) -> bool:
    """Whether a box touches neither a point that is drawn nor another box."""
    if (np.abs(drawn - place) < box + MARGIN).all(axis=1).any():
        return False
    return not any((np.abs(there - place) < box + half + MARGIN).all() for there, half in boxes)


def _unit(angle: float) -> Array:
    return np.array([math.cos(angle), math.sin(angle)])
