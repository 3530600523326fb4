"""Openings learned from the ball's changes of ring.

A passage is a change between two rings that each held the ball for two samples, in one uninterrupted segment. Noise at
a boundary and a ball that turns back in the opening are not passages. A line from the last point before the change to
the first point after it crosses the middle radius of the wall: there is the place of the passage. DBSCAN (M. Ester et
al., KDD 1996) clusters the passages of a wall by arc length; each cluster is an opening.

The origin is the centre of the rings, not that of the camera's picture.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mazeplan.core.errors import TableError
from mazeplan.core.maths.angles import difference, place_deg, wrap
from mazeplan.core.records import Array
from mazeplan.maze.bands import Bands

Index = NDArray[np.intp]

MAX_SPEED = 1.0  # m/s; a ball that rolls down half the outermost ring at 5 degrees of tilt reaches .6
MAX_GAP = 4  # sample intervals; after a longer gap the place of a change is unknown
MIN_COUNT = 2  # minimum number of passages of an opening


@dataclass(frozen=True)
class BallTrack:
    """Positions of the ball, only samples with the ball; all arrays (N,).

    t: s
    x, y: m, finite
    segment: number of the uninterrupted stretch; motion between segments is not a passage
    """

    t: Array
    x: Array
    y: Array
    segment: Array


@dataclass(frozen=True)
class Passages:
    """All changes of ring, as arrays of N.

    wall: outer ring of the wall
    angle: place of the passage, rad
    skipped: number of changes that could not be placed (ball not seen, a jump)
    """

    wall: Index
    angle: Array
    skipped: int


@dataclass(frozen=True)
class LearnedOpening:
    """A cluster of passages of the wall between ring `outer` and the next one.

    angle, angle_stderr: rad in [0, 2 pi), and 1 sigma
    count: number of passages
    problem: why the cluster does not count as an opening, or ""
    """

    outer: int
    angle: float
    angle_stderr: float
    count: int
    problem: str = ""


def find_passages(track: BallTrack, bands: Bands) -> Passages:
    """All changes between neighbouring rings, from positions of the ball and the rings' bands."""
    t, segment = track.t, track.segment
    place = np.stack([track.x - bands.centre[0], track.y - bands.centre[1]], axis=1)
    r = np.hypot(place[:, 0], place[:, 1])
    held = _held(rings_of(r, bands), segment)
    steps = np.diff(t)[np.diff(segment) == 0.0]
    interval = float(np.median(steps)) if len(steps) else math.inf
    at = np.flatnonzero(held)
    change = (held[at[1:]] != held[at[:-1]]) & (segment[at[1:]] == segment[at[:-1]])
    rows, skipped = [], 0
    for first, last in zip(at[:-1][change], at[1:][change], strict=True):
        a, b = int(held[first]), int(held[last])
        middle = middle_radius(bands, min(a, b))
        side = r[first:last] > middle if b > a else r[first:last] <= middle
        before = first + int(np.max(np.flatnonzero(side), initial=0))
        gap, way = t[before + 1] - t[before], math.dist(place[before], place[before + 1])
        if abs(a - b) != 1 or gap > (MAX_GAP + 0.5) * interval or way > MAX_SPEED * gap + 6.0 * bands.noise:
            skipped += 1
            continue
        share = (r[before] - middle) / (r[before] - r[before + 1])
        x, y = place[before] + share * (place[before + 1] - place[before])
        rows.append((min(a, b), math.atan2(y, x)))
    found = np.array(rows, dtype=float).reshape(-1, 2)
    return Passages(found[:, 0].astype(np.intp), found[:, 1], skipped)


def middle_radius(bands: Bands, outer: int) -> float:
    """Middle of the wall inside ring `outer`, m."""
    return 0.5 * (bands.edges[outer - 1].low + bands.edges[outer].high)


def rings_of(r: Array, bands: Bands) -> Index:
    """Number of the ring at each radius (N,) in m; 0 inside a wall or outside all rings."""
    ring = np.zeros(len(r), dtype=np.intp)
    for number, edges in enumerate(bands.edges, start=1):
        room = [abs(edges.low - e.high) for e in bands.edges[number:][:1]]
        room += [abs(e.low - edges.high) for e in bands.edges[: number - 1][-1:]]
        slack = min(3.0 * bands.noise, 0.25 * min(room))
        ring[(r > edges.low - slack) & (r < edges.high + slack)] = number
    return ring


def _held(ring: Index, segment: Array) -> Index:
    """`ring` where it is the same for two samples in a row, else 0: a single sample may be an outlier."""
    same = (ring[1:] == ring[:-1]) & (segment[1:] == segment[:-1]) & (ring[1:] > 0)
    run = np.concatenate([[False], same]) | np.concatenate([same, [False]])
    return np.where(run, ring, 0)


def find_openings(
    passages: Passages, bands: Bands, ball_radius: float, widths: Sequence[float], *, min_count: int = MIN_COUNT
) -> tuple[LearnedOpening, ...]:
    """Openings, sorted by wall and angle; rejected ones have a `problem`.

    widths: likely width of an opening for each wall, m
    min_count: minimum number of passages of an opening

    Raises TableError for min_count < 1.
    """
    if min_count < 1:
        raise TableError(f"min_count: got {min_count}, expected at least 1")
    found: list[LearnedOpening] = []
    for wall, width in enumerate(widths, start=1):
        angles = passages.angle[passages.wall == wall]
        if not len(angles):
            continue
        radius = middle_radius(bands, wall)
        label = cluster(angles, radius, ball_radius)
        groups = [angles[label == number] for number in np.unique(label)]
        spread = _spread(groups, radius, width / 2.0 - ball_radius, bands.noise)
        openings = [
            LearnedOpening(wall, circular_mean(group), spread / math.sqrt(len(group)) / radius, len(group))
            for group in groups
        ]
        found += sorted(_judged(openings, width / radius, min_count), key=lambda opening: opening.angle)
    return tuple(found)


def _judged(openings: list[LearnedOpening], width: float, min_count: int) -> list[LearnedOpening]:
    """The openings of one wall with their problems: too few passages, or overlap with an opening that has more.

    width: angle that an opening takes, rad"""
    judged: list[LearnedOpening] = []
    for opening in sorted(openings, key=lambda opening: -opening.count):
        near = [o for o in judged if not o.problem and abs(difference(o.angle, opening.angle)) < width]
        problem = ""
        if opening.count < min_count:
            problem = f"{opening.count} passage{'s' * (opening.count != 1)}, fewer than {min_count}"
        elif near:
            problem = f"overlaps the opening at {place_deg(near[0].angle, 1):.1f} deg"
        judged.append(replace(opening, problem=problem))
    return judged


def cluster(angle: Array, radius: float, ball_radius: float) -> Index:
    """Number of the opening, from 0, of each passage of one wall at angles (N,) in rad; `radius` of the wall in m.

    Two openings do not share their sides. So the ball's centre in one opening is at least a ball's diameter away from
    its place in the other. Within one opening the play is smaller. Therefore passages that are nearer than the ball's
    radius along the wall belong to one opening.
    """
    from sklearn.cluster import DBSCAN

    apart = np.abs(difference(angle[:, None], angle[None, :]))
    return DBSCAN(eps=ball_radius, min_samples=1, metric="precomputed").fit(radius * apart).labels_


def circular_mean(angle: Array) -> float:
    """Mean direction, rad in [0, 2 pi)."""
    return math.atan2(np.sin(angle).sum(), np.cos(angle).sum()) % (2.0 * math.pi)


def _spread(groups: list[Array], radius: float, play: float, noise: float) -> float:
    """1 sigma of the place of one passage along the wall, m, from the angles of the passages of all openings of the
    wall, with a prior from play and noise."""
    free = sum(len(angles) - 1 for angles in groups)
    expected = play**2 / 3.0 + noise**2
    squares = sum(float(np.sum((radius * wrap(angles - circular_mean(angles))) ** 2)) for angles in groups)
    return math.sqrt((squares + 3.0 * expected) / (free + 3.0))  # the expectation counts as three passages
