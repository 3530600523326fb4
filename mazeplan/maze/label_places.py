"""Where numbers of rings and the ball stand in the drawing of a maze: clear of walls, openings and paths."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mazeplan.core.maths.angles import difference
from mazeplan.maze.geometry import Maze

Array = NDArray[np.float64]
_NEAR = 1.6  # minimum distance of a ring's number from a path, in radii of the ball


def _label_radius(maze: Maze, ring: int) -> float:
    """Radius at which a ring's number stands, m: on the track; in the disc, beside the centre."""
    return maze.track_radius(ring) or 0.55 * maze.ring(ring).outer_radius


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
    common = max(rays, key=lambda ray: (round(sum(room(r, ray) for r in radii), 6), preference(ray)))

    def angle_of(radius: float) -> float:
        if room(radius, common) >= min(enough, _NEAR * maze.ball.radius):
            return common
        return max(rays, key=lambda ray: (room(radius, ray), -abs(difference(ray, common))))

    return [radius * _unit(angle_of(radius)) for radius in radii]


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


def _unit(angle: float) -> Array:
    return np.array([math.cos(angle), math.sin(angle)])
