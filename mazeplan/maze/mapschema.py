"""What a map file may have: its keys with types and ranges, as pydantic models; and rings, openings and radial walls
must fit together. Lengths in mm and angles in degrees, as in the file.

Ranges are wide enough for any maze on a table; they catch a length in the wrong unit and an angle in radians times 100.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Annotated

from pydantic import Field

from mazeplan.maze.geometry import MIN_DISC_RADII, Maze, leading_to
from mazeplan.maze.sections import Section
from mazeplan.maze.yamltree import Key

Problem = tuple[Key, str]

MIN_WALL_MM = 1.0  # thinner walls break in print and let a fast ball through in simulation
NAME_PATTERN = r"^[A-Za-z0-9_.@+-][A-Za-z0-9_.@+ -]{0,39}$"
MAX_RINGS = 60
MAX_OPENINGS = 2000
MAX_RADIAL_WALLS = 2000
MAX_BALLS = 2

Name = Annotated[str, Field(pattern=NAME_PATTERN)]
RingNumber = Annotated[int, Field(ge=1, le=MAX_RINGS)]


def default_name(outer: int, inner: int, angle_deg: float) -> str:
    """Default name of an opening."""
    return f"{outer}-{inner}@{angle_deg:.10g}"


def default_wall_name(ring: int, angle_deg: float) -> str:
    """Default name of a radial wall."""
    return f"wall{ring}@{angle_deg:.10g}"


class BallSection(Section):
    """The ball."""

    radius_mm: float = Field(ge=1, le=50)
    mass_g: float = Field(gt=0, le=5000)


class RingSection(Section):
    """One channel: clear floor between two radii."""

    inner_radius_mm: float = Field(ge=0, le=1000)
    outer_radius_mm: float = Field(ge=1, le=1000)


class OpeningSection(Section):
    """One gap in the wall between two neighbouring rings."""

    rings: tuple[RingNumber, RingNumber]
    angle_deg: float = Field(ge=0, lt=360)
    width_mm: float = Field(ge=2, le=1000)
    name: Name | None = None
    closed: bool = False
    extra_cost_s: float = Field(default=0.0, ge=0, le=3600)

    @property
    def label(self) -> str:
        """Name in the file, or the default name: rings and angle, such as "1-2@45"."""
        return self.name or default_name(min(self.rings), max(self.rings), self.angle_deg)


class RadialWallSection(Section):
    """One wall across the channel of a ring."""

    ring: RingNumber
    angle_deg: float = Field(ge=0, lt=360)
    thickness_mm: float = Field(ge=1, le=100)
    name: Name | None = None

    @property
    def label(self) -> str:
        """Name in the file, or the default name: ring and angle, such as "wall2@100"."""
        return self.name or default_wall_name(self.ring, self.angle_deg)


class MapFile(Section):
    """A whole map file."""

    name: Name
    ball: BallSection
    tilt_limit_deg: float = Field(ge=0.5, le=30)
    wall_height_mm: float = Field(ge=1, le=200)
    rim_thickness_mm: float = Field(default=5.0, ge=1, le=100)
    balls: int = Field(default=1, ge=1, le=MAX_BALLS)
    rings: tuple[RingSection, ...] = Field(min_length=2, max_length=MAX_RINGS)
    openings: tuple[OpeningSection, ...] = Field(max_length=MAX_OPENINGS)
    radial_walls: tuple[RadialWallSection, ...] = Field(default=(), max_length=MAX_RADIAL_WALLS)


# Rules beyond types and ranges. A rule yields problems (key path, message).


def ring_problems(spec: MapFile) -> Iterator[Problem]:
    """Problems: rings, and walls that are lower than the ball's middle."""
    diameter, last = 2.0 * spec.ball.radius_mm, len(spec.rings) - 1
    if spec.wall_height_mm < spec.ball.radius_mm:
        yield ("wall_height_mm",), f"got {spec.wall_height_mm:g}, expected at least the ball's radius"
    for i, ring in enumerate(spec.rings):
        inner, outer = ("rings", i, "inner_radius_mm"), ("rings", i, "outer_radius_mm")
        if (ring.inner_radius_mm == 0.0) != (i == last):
            expected = (
                "0: the last ring is the disc in the centre" if i == last else "more: only the last ring is a disc"
            )
            yield inner, f"got {ring.inner_radius_mm:g}, expected {expected}"
        if ring.outer_radius_mm <= ring.inner_radius_mm:
            yield outer, f"got {ring.outer_radius_mm:g}, expected more than inner_radius_mm {ring.inner_radius_mm:g}"
            continue
        room = ring.outer_radius_mm - ring.inner_radius_mm if i < last else 2.0 * ring.outer_radius_mm
        if room <= diameter:
            yield outer, f"got a ring {room:g} mm wide, expected more than the ball's diameter {diameter:g}"
        limit = spec.rings[i - 1].inner_radius_mm - MIN_WALL_MM if i else math.inf
        if ring.outer_radius_mm > limit:
            yield (
                outer,
                f"got {ring.outer_radius_mm:g}, expected at most {limit:g}: rings are listed from the outermost, "
                f"with a wall of at least {MIN_WALL_MM:g} mm between them",
            )


def opening_problems(spec: MapFile) -> Iterator[Problem]:
    """Problems: openings; rings must be valid."""
    wrong = [problem for i, opening in enumerate(spec.openings) for problem in _one_opening(spec, i, opening)]
    yield from wrong
    if wrong:
        return
    yield from _duplicate_names("openings", [opening.label for opening in spec.openings])
    for wall in range(1, len(spec.rings)):  # an opening is widest in angle at the inner face of its wall
        here = ((o.angle_deg, i, o.width_mm) for i, o in enumerate(spec.openings) if min(o.rings) == wall)
        yield from _overlaps("openings", spec.rings[wall].outer_radius_mm, here)
    for ring in _unreachable(spec, spec.openings):
        yield ("rings", ring - 1), f"ring {ring} cannot be reached from ring 1, expected openings that lead to it"


def _one_opening(spec: MapFile, i: int, opening: OpeningSection) -> Iterator[Problem]:
    outer, inner = sorted(opening.rings)
    if inner > len(spec.rings):
        yield ("openings", i, "rings"), f"got ring {inner}, expected 1 to {len(spec.rings)}"
    elif inner != outer + 1:
        yield ("openings", i, "rings"), f"got {list(opening.rings)}, expected two neighbours, such as [1, 2]"
    else:
        low, high = 2.0 * spec.ball.radius_mm, 2.0 * spec.rings[outer].outer_radius_mm
        if not low < opening.width_mm < high:
            expected = f"more than the ball's diameter {low:g} and less than the wall's {high:g}"
            yield ("openings", i, "width_mm"), f"got {opening.width_mm:g}, expected {expected}"


def wall_problems(spec: MapFile) -> Iterator[Problem]:
    """Problems: radial walls; rings and openings must be valid."""
    wrong = False
    for i, wall in enumerate(spec.radial_walls):
        last = len(spec.rings)
        diameter = 0.0 if wall.ring >= last else 2.0 * spec.rings[wall.ring - 1].inner_radius_mm
        if wall.ring >= last:
            yield ("radial_walls", i, "ring"), f"got ring {wall.ring}, expected 1 to {last - 1}: not the disc"
        elif wall.thickness_mm >= diameter:
            expected = f"less than {diameter:g}, the diameter of the wall inside the ring"
            yield ("radial_walls", i, "thickness_mm"), f"got {wall.thickness_mm:g}, expected {expected}"
        wrong |= wall.ring >= last or wall.thickness_mm >= diameter
    if wrong:
        return
    yield from _duplicate_names("radial_walls", [wall.label for wall in spec.radial_walls])
    for number in range(1, len(spec.rings)):  # radial walls are nearest to each other at the inner wall of their ring
        here = ((w.angle_deg, i, w.thickness_mm) for i, w in enumerate(spec.radial_walls) if w.ring == number)
        yield from _overlaps("radial_walls", spec.rings[number - 1].inner_radius_mm, here)
    for i, wall in enumerate(spec.radial_walls):  # the space between the extended sides of an opening must be free
        radius = spec.rings[wall.ring - 1].inner_radius_mm
        for j, opening in enumerate(spec.openings):
            apart = _apart(wall.angle_deg, opening.angle_deg)
            needed = _half_angle(wall.thickness_mm, radius) + _half_angle(opening.width_mm, radius)
            if wall.ring in opening.rings and apart < needed:
                yield (
                    ("radial_walls", i, "angle_deg"),
                    f"stands in front of openings[{j}]: got {apart:g} deg between their middles, "
                    f"expected at least {needed:.4g}, room for the ball to pass",
                )


def _duplicate_names(section: str, names: Sequence[str]) -> Iterator[Problem]:
    for i, name in enumerate(names):
        if (first := names.index(name)) < i:
            yield (section, i), f"got the name {name!r}, which {section}[{first}] has already"


def _half_angle(width: float, radius: float) -> float:
    """Half of the angle, deg, between parallel sides at a distance `width`, at a radius."""
    return math.degrees(math.asin(min(1.0, 0.5 * width / radius)))


def _apart(a: float, b: float) -> float:
    return abs((b - a + 180.0) % 360.0 - 180.0)


def _overlaps(section: str, radius: float, entries: Iterable[tuple[float, int, float]]) -> Iterator[Problem]:
    """Problems: neighbours that overlap at a radius.

    entries: (angle, index in the section, width) of what is in one wall or ring"""
    found = sorted(entries)
    pairs = [*pairwise(found), *([(found[-1], found[0])] if len(found) > 2 else [])]
    for (angle_a, a, width_a), (angle_b, b, width_b) in pairs:
        needed = _half_angle(width_a, radius) + _half_angle(width_b, radius)
        if (apart := _apart(angle_a, angle_b)) <= needed:
            yield (
                (section, max(a, b), "angle_deg"),
                f"overlaps {section}[{min(a, b)}]: got {apart:g} deg between their middles, "
                f"expected more than {needed:.4g}",
            )


def cut_off(maze: Maze) -> Iterator[Problem]:
    """Problems: rings from which radial walls leave no way to the centre."""
    last = len(maze.rings)
    leading = {ring for ring, _ in leading_to(maze, last)}
    for ring in range(1, last):
        if ring not in leading:
            yield ("rings", ring - 1), f"no way leads from ring {ring} to ring {last}: radial walls shut it"


def crowded(balls: int, ball_mm: float, centre_mm: float) -> str | None:
    """A sentence if so many balls do not fit into the centre, else None. Radii in mm."""
    if balls == 1 or centre_mm >= MIN_DISC_RADII * ball_mm - 1e-6:  # 2.2 times 5 is more than 11 in binary numbers
        return None
    least = f"at least {MIN_DISC_RADII * ball_mm:.4g} mm, {MIN_DISC_RADII:g} times the ball's"
    return f"{balls} balls need a centre with a radius of {least}, not {centre_mm:.4g} mm"


def doubts(spec: MapFile) -> Iterator[Problem]:
    """Warnings about a valid map."""
    for ring in _unreachable(spec, [opening for opening in spec.openings if not opening.closed]):
        yield ("rings", ring - 1), f"warning: ring {ring} can be reached only through closed openings"
    if problem := crowded(spec.balls, spec.ball.radius_mm, spec.rings[-1].outer_radius_mm):
        yield ("balls",), f"warning: {problem}"


def _unreachable(spec: MapFile, openings: Sequence[OpeningSection]) -> range:
    """Rings cut off from ring 1. Openings join neighbouring rings, so a wall without openings cuts off all rings inside
    it."""
    passable, rings = {min(opening.rings) for opening in openings}, len(spec.rings)
    first = next((ring for ring in range(2, rings + 1) if ring - 1 not in passable), rings + 1)
    return range(first, rings + 1)
