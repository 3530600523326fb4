"""Geometry of a circular maze: rings are channels between concentric walls, openings are gaps in those walls.

All lengths in m, angles in rad, in the plate frame (origin in the centre, theta = atan2(y, x)). Ring 1 is the
outermost; the last ring is a disc around the centre (inner radius 0). The wall between ring i and i+1 reaches from the
outer radius of ring i+1 to the inner radius of ring i. An opening is a gap with parallel sides, `width` apart, whose
middle line is the radius at `angle`. A radial wall blocks the channel of a ring at its `angle`. Two neighbouring walls
bound a sector of the ring; inside a sector there is only one way between two places.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field

from mazeplan.core.maths.angles import difference

CLEARANCE = 2e-4  # m between a placed ball and a radial wall
MIN_DISC_RADII = 2.2  # smallest radius of a centre for two balls, radii of a ball: they fit into 2 without any play
_TURN = 2.0 * math.pi


@dataclass(frozen=True, slots=True)
class Ball:
    """A solid sphere."""

    radius: float
    mass: float


@dataclass(frozen=True, slots=True)
class Ring:
    """The channel between two walls: clear floor from inner to outer radius. The centre is a disc."""

    number: int
    inner_radius: float
    outer_radius: float

    @property
    def track_radius(self) -> float:
        """Mean radius of the ball's centre: the middle of the channel, 0 for the disc."""
        return 0.0 if self.inner_radius == 0.0 else 0.5 * (self.inner_radius + self.outer_radius)

    @property
    def is_disc(self) -> bool:
        """Whether this is the centre, without an inner wall."""
        return self.inner_radius == 0.0


@dataclass(frozen=True, slots=True)
class Opening:
    """A gap in the wall between ring `outer` and ring `inner` = outer + 1.

    name: unique, for users and logs, such as "1-2@45"
    angle: of its middle line, rad
    width: distance of its parallel sides, m
    closed: excluded from routes
    extra_cost: time that the user adds to its expected passage, s
    """

    name: str
    outer: int
    inner: int
    angle: float
    width: float
    closed: bool = False
    extra_cost: float = 0.0

    def leads_to(self, ring: int) -> int:
        """The ring on the other side, seen from `ring`."""
        return self.inner if ring == self.outer else self.outer


@dataclass(frozen=True, slots=True)
class RadialWall:
    """A wall across the channel of a ring, from the ring's inner to its outer wall.

    name: unique among radial walls, such as "wall2@100"
    angle: of its middle line, rad
    thickness: distance of its parallel sides, m
    """

    name: str
    ring: int
    angle: float
    thickness: float

    def half_angle(self, radius: float, more: float = 0.0) -> float:
        """Half of the angle that the wall takes at a radius, rad. more: added on either side, m."""
        return math.asin(min(1.0, (0.5 * self.thickness + more) / radius))


@dataclass(frozen=True, slots=True)
class Wall:
    """A circular wall: solid from inner to outer radius except at its openings. outer_ring: the ring outside it (0 for
    the rim around ring 1)."""

    inner_radius: float
    outer_radius: float
    outer_ring: int
    openings: tuple[Opening, ...]


@dataclass(frozen=True)
class Maze:
    """A whole maze. tilt_limit: rad per axis; balls: number of balls on the plate; source: file it was read from."""

    name: str
    ball: Ball
    rings: tuple[Ring, ...]
    openings: tuple[Opening, ...]
    tilt_limit: float
    wall_height: float
    rim_thickness: float = 0.005
    radial_walls: tuple[RadialWall, ...] = ()
    balls: int = 1
    source: str = field(default="", compare=False)

    def ring(self, number: int) -> Ring:
        """The ring of that number (1 = outermost)."""
        if not 1 <= number <= len(self.rings):
            raise IndexError(f"ring {number}: this maze has rings 1 to {len(self.rings)}")
        return self.rings[number - 1]

    def opening(self, name: str) -> Opening:
        """The opening of that name."""
        found = next((opening for opening in self.openings if opening.name == name), None)
        if found is None:
            raise KeyError(f"no opening {name!r}; there are {', '.join(o.name for o in self.openings)}")
        return found

    def openings_between(self, a: int, b: int) -> tuple[Opening, ...]:
        """All openings that join two rings, closed ones too."""
        return tuple(o for o in self.openings if {o.outer, o.inner} == {a, b})

    def openings_of(self, ring: int) -> tuple[Opening, ...]:
        """All openings in the walls of a ring, closed ones too."""
        return tuple(o for o in self.openings if ring in (o.outer, o.inner))

    @property
    def walls(self) -> tuple[Wall, ...]:
        """Walls from the rim inwards."""
        rim = self.rings[0].outer_radius
        walls = [Wall(rim, rim + self.rim_thickness, 0, ())]
        for outer, inner in zip(self.rings, self.rings[1:], strict=False):
            gaps = self.openings_between(outer.number, inner.number)
            walls.append(Wall(inner.outer_radius, outer.inner_radius, outer.number, gaps))
        return tuple(walls)

    def ring_at(self, r: float) -> int:
        """The ring whose floor, widened to the middle of its walls, holds radius r."""
        for outer, inner in zip(self.rings, self.rings[1:], strict=False):
            if r > 0.5 * (outer.inner_radius + inner.outer_radius):
                return outer.number
        return self.rings[-1].number

    def track_radius(self, ring: int) -> float:
        """Radius at which the ball's centre travels in a ring, m."""
        return self.ring(ring).track_radius

    def threshold_radius(self, opening: Opening) -> float:
        """Middle of the wall that the opening breaks, m: past it the ball is in the other ring."""
        return 0.5 * (self.ring(opening.outer).inner_radius + self.ring(opening.inner).outer_radius)

    def radial_walls_of(self, ring: int) -> tuple[RadialWall, ...]:
        """The radial walls in a ring by angle, from 0 upwards."""
        walls = (wall for wall in self.radial_walls if wall.ring == ring)
        return tuple(sorted(walls, key=lambda wall: wall.angle % _TURN))

    def sector(self, ring: int, theta: float) -> int:
        """Sector of a ring at an angle. Sector n begins at wall n of `radial_walls_of`, from 0; 0 in a ring without
        radial walls."""
        walls = self.radial_walls_of(ring)
        return min(range(len(walls)), key=lambda n: (theta - walls[n].angle) % _TURN, default=0)

    def turn(self, ring: int, start: float, end: float) -> float | None:
        """Signed angle of the ball's way from one angle of a ring to another; None if radial walls leave no way.

        Without radial walls it is the shorter way. With them it is the only open way, perhaps more than half a turn."""
        walls = self.radial_walls_of(ring)
        if not walls:
            return difference(end, start)
        n = self.sector(ring, start)
        begin, span = walls[n].angle, (walls[(n + 1) % len(walls)].angle - walls[n].angle) % _TURN or _TURN
        there = (end - begin) % _TURN
        return there - (start - begin) % _TURN if there < span else None

    def has_room(self, ring: int, theta: float) -> bool:
        """Whether the ball has room in the middle of a ring at an angle, beside its radial walls."""
        return self.clear_angle(ring, theta) == theta

    def clear_angle(self, ring: int, theta: float) -> float:
        """The angle nearest to theta at which the ball has room in the middle of a ring, beside its radial walls."""
        walls = self.radial_walls_of(ring)
        if not walls:
            return theta
        halves = [w.half_angle(self.track_radius(ring), self.ball.radius + CLEARANCE) for w in walls]
        places = [theta]
        for wall, half in zip(walls, halves, strict=True):
            places += [theta + difference(wall.angle + side * half, theta) for side in (-1.0, 1.0)]
        free = (
            place
            for place in sorted(places, key=lambda place: abs(place - theta))
            if all(abs(difference(w.angle, place)) > h - 1e-9 for w, h in zip(walls, halves, strict=True))
        )
        return next(free, theta)


Region = tuple[int, int]  # ring, sector; a ring with at most one radial wall is one region


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
