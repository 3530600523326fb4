"""Rules for the radial walls of a map file, and rules that they share with openings.

Lengths in mm and angles in degrees, as in the file.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapschema import MapFile, RadialWallSection
from mazeplan.maze.regions import leading_to
from mazeplan.maze.yamltree import Key

Problem = tuple[Key, str]


def wall_name(wall: RadialWallSection) -> str:
    """The name of a radial wall in the file, or its default name."""
    return wall.name or default_wall_name(wall.ring, wall.angle_deg)


def default_wall_name(ring: int, angle_deg: float) -> str:
    """Default name of a radial wall: ring and angle, such as "wall2@100"."""
    return f"wall{ring}@{angle_deg:.10g}"


def wall_problems(spec: MapFile) -> Iterator[Problem]:
    """All errors of the radial walls; rings and openings must be valid."""
    problems = [problem for i in range(len(spec.radial_walls)) for problem in _one_wall(spec, i)]
    yield from problems
    if problems:
        return
    yield from duplicate_names("radial_walls", [(wall_name(w), bool(w.name)) for w in spec.radial_walls])
    for number in range(1, len(spec.rings)):  # radial walls are nearest to each other at the inner wall of their ring
        walls = ((w.angle_deg, i, w.thickness_mm) for i, w in enumerate(spec.radial_walls) if w.ring == number)
        yield from overlaps("radial_walls", "ring", spec.rings[number - 1].inner_radius_mm, walls)
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


def duplicate_names(section: str, names: Sequence[tuple[str, bool]]) -> Iterator[Problem]:
    """Problems: entries of a section that have the name of an earlier entry.

    names: (name, whether the file gives it) of all entries"""
    seen: dict[str, int] = {}
    for i, (name, given) in enumerate(names):
        if name in seen:
            place = "name" if given else "angle_deg"
            yield (section, i, place), f"got the name {name!r}, which {section}[{seen[name]}] has already"
        else:
            seen[name] = i


def half_angle(width: float, radius: float) -> float:
    """Half of the angle, deg, between parallel sides at a distance `width`, at a radius."""
    return math.degrees(math.asin(min(1.0, 0.5 * width / radius)))


def _apart(a: float, b: float) -> float:
    return abs((b - a + 180.0) % 360.0 - 180.0)


def overlaps(section: str, where: str, radius: float, entries: Iterable[tuple[float, int, float]]) -> Iterator[Problem]:
    """Problems: neighbours that overlap at a radius, mm.

    entries: (angle in degrees, index in the section, width in mm)"""
    found = sorted(entries)
    pairs = list(pairwise(found))
    in_radians = "; the unit is deg: are the angles in radians?" if found and found[-1][0] <= 2.0 * math.pi else ""
    if len(found) > 2:
        pairs.append((found[-1], found[0]))
    for (angle_a, a, width_a), (angle_b, b, width_b) in pairs:
        needed = half_angle(width_a, radius) + half_angle(width_b, radius)
        if (apart := _apart(angle_a, angle_b)) <= needed:
            first, second = min(a, b), max(a, b)
            yield (
                (section, second, "angle_deg"),
                f"overlaps {section}[{first}] in the same {where}: got {apart:g} deg between their middles, "
                f"expected more than {needed:.4g}{in_radians}",
            )


def _before_openings(spec: MapFile) -> Iterator[Problem]:
    """Problems: radial walls in front of an opening. The space between the opening's extended sides must be free."""
    for i, wall in enumerate(spec.radial_walls):
        radius = spec.rings[wall.ring - 1].inner_radius_mm
        for j, opening in enumerate(spec.openings):
            if wall.ring not in opening.rings:
                continue
            needed = half_angle(wall.thickness_mm, radius) + half_angle(opening.width_mm, radius)
            if (apart := _apart(wall.angle_deg, opening.angle_deg)) < needed:
                yield (
                    ("radial_walls", i, "angle_deg"),
                    f"stands in front of openings[{j}]: got {apart:g} deg between their middles, "
                    f"expected at least {needed:.4g}, room for the ball to pass",
                )


def cut_off(maze: Maze) -> Iterator[Problem]:
    """Problems: rings from which radial walls leave no way to the centre."""
    last = len(maze.rings)
    leading = {ring for ring, _ in leading_to(maze, last)}
    for ring in range(1, last):
        if ring not in leading:
            where = f"ring {last}" if ring == 1 else f"ring {last} and what leads there"
            yield (
                ("rings", ring - 1),
                f"no way leads from ring {ring} to {where}: radial walls shut it; expected openings beside them",
            )
