"""What is asked of the radial walls of a map file: where they may stand, and that they cut no ring off.

Lengths in mm and angles in degrees, as in the file.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapschema import MapFile, RadialWallSection
from mazeplan.maze.regions import described, holds_ball, leading_to, regions
from mazeplan.maze.yamltree import Key

Problem = tuple[Key, str]


def wall_name(wall: RadialWallSection) -> str:
    """The name given, or that of a wall without one: "wall2@100" (ring and angle)."""
    return wall.name or default_wall_name(wall.ring, wall.angle_deg)


def default_wall_name(ring: int, angle_deg: float) -> str:
    """What a radial wall without a name is called: ring and angle, such as "wall2@100"."""
    return f"wall{ring}@{angle_deg:.10g}"


def wall_problems(spec: MapFile) -> Iterator[Problem]:
    """Everything that is wrong with the radial walls, where rings and openings make sense."""
    problems = [problem for i in range(len(spec.radial_walls)) for problem in _one_wall(spec, i)]
    yield from problems
    if problems:
        return
    yield from _duplicate_names(spec)
    yield from _overlaps(spec)
    yield from _before_openings(spec)


def _one_wall(spec: MapFile, i: int) -> Iterator[Problem]:
    wall, last = spec.radial_walls[i], len(spec.rings)
    if wall.ring >= last:
        what = "the disc" if wall.ring == last else f"ring {wall.ring}"
        yield (
            ("radial_walls", i, "ring"),
            f"got {what}, expected a ring from 1 to {last - 1}: a wall joins two circular ones",
        )
        return
    inner = 2.0 * spec.rings[wall.ring - 1].inner_radius_mm
    if wall.thickness_mm >= inner:
        yield (
            ("radial_walls", i, "thickness_mm"),
            f"got {wall.thickness_mm:g}, expected less than {inner:g}, the diameter of the wall inside the ring",
        )


def _duplicate_names(spec: MapFile) -> Iterator[Problem]:
    seen: dict[str, int] = {}
    for i, wall in enumerate(spec.radial_walls):
        name = wall_name(wall)
        if name in seen:
            place = "name" if wall.name else "angle_deg"
            yield (
                ("radial_walls", i, place),
                f"got the name {name!r}, which radial_walls[{seen[name]}] has already",
            )
        else:
            seen[name] = i


def _half(width: float, radius: float) -> float:
    """Half of the angle, deg, that parallel sides so far apart take at a radius."""
    return math.degrees(math.asin(min(1.0, 0.5 * width / radius)))


def _apart(a: float, b: float) -> float:
    return abs((b - a + 180.0) % 360.0 - 180.0)


def _overlaps(spec: MapFile) -> Iterator[Problem]:
    """Two walls of a ring that meet, which they do first at its inner wall."""
    for number in range(1, len(spec.rings)):
        radius = spec.rings[number - 1].inner_radius_mm
        walls = sorted((w.angle_deg, i) for i, w in enumerate(spec.radial_walls) if w.ring == number)
        pairs = list(pairwise(walls))
        if len(walls) > 2:
            pairs.append((walls[-1], walls[0]))
        for (angle_a, a), (angle_b, b) in pairs:
            needed = sum(_half(spec.radial_walls[i].thickness_mm, radius) for i in (a, b))
            if (apart := _apart(angle_a, angle_b)) <= needed:
                first, second = min(a, b), max(a, b)
                yield (
                    ("radial_walls", second, "angle_deg"),
                    f"overlaps radial_walls[{first}] in the same ring: got {apart:g} deg between their middles, "
                    f"expected more than {needed:.4g}",
                )


def _before_openings(spec: MapFile) -> Iterator[Problem]:
    """Walls that reach in front of an opening: its sides, carried on across the channel, must stay free, or there is
    no room for the ball beside the wall."""
    for i, wall in enumerate(spec.radial_walls):
        radius = spec.rings[wall.ring - 1].inner_radius_mm
        for j, opening in enumerate(spec.openings):
            if wall.ring not in opening.rings:
                continue
            needed = _half(wall.thickness_mm, radius) + _half(opening.width_mm, radius)
            if (apart := _apart(wall.angle_deg, opening.angle_deg)) < needed:
                yield (
                    ("radial_walls", i, "angle_deg"),
                    f"stands in front of openings[{j}]: got {apart:g} deg between their middles, "
                    f"expected at least {needed:.4g}, room for the ball to pass",
                )


def cut_off(maze: Maze) -> Iterator[Problem]:
    """Rings that radial walls cut off from the centre or from ring 1."""
    last = len(maze.rings)
    leading = {ring for ring, _ in leading_to(maze, last)}
    for ring in range(1, last):
        if ring not in leading:
            where = f"ring {last}" if ring == 1 else f"ring {last} and what leads there"
            yield (
                ("rings", ring - 1),
                f"no way leads from ring {ring} to {where}: radial walls shut it; expected openings beside them",
            )


def dead_regions(maze: Maze) -> Iterator[Problem]:
    """Warnings: sectors with room for the ball from which no way leads to the centre, or by closed openings only."""
    last = len(maze.rings)
    leading = leading_to(maze, last)
    now = leading_to(maze, last, [o.name for o in maze.openings if o.closed])
    open_rings = {ring for ring, _ in now}
    for region in regions(maze):
        ring = region[0]
        if region in now or not maze.radial_walls_of(ring) or not holds_ball(maze, region):
            continue
        if region in leading and ring not in open_rings:
            continue  # a ring that only closed openings lead to is told of as a whole
        only = " but through closed openings" if region in leading else ""
        yield ("rings", ring - 1), f"warning: no way leads from {described(maze, region)} to ring {last}{only}"
