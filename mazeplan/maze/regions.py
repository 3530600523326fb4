"""Regions of a maze: the sectors of its rings, and which regions openings join.

A ring without radial walls is one region. A ring with a single radial wall is also one region, although the ball cannot
pass this wall.
"""

from __future__ import annotations

from collections.abc import Collection

from mazeplan.maze.geometry import Maze

Region = tuple[int, int]  # ring, sector


def regions(maze: Maze) -> list[Region]:
    """All regions, from ring 1 inwards."""
    return [(ring.number, n) for ring in maze.rings for n in range(max(1, len(maze.radial_walls_of(ring.number))))]


def leading_to(maze: Maze, goal: int, closed: Collection[str] = ()) -> set[Region]:
    """The regions from which a way leads to the ring `goal`, through openings that are not in `closed`."""
    beside: dict[Region, list[Region]] = {region: [] for region in regions(maze)}
    for o in maze.openings:
        if o.name not in closed:
            a, b = ((ring, maze.sector(ring, o.angle)) for ring in (o.outer, o.inner))
            beside[a].append(b)
            beside[b].append(a)
    found: set[Region] = set()
    waiting = [region for region in beside if region[0] == goal]
    while waiting:
        region = waiting.pop()
        if region not in found:
            found.add(region)
            waiting += beside[region]
    return found
