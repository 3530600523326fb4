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
from mazeplan.core.maths.angles import difference, place_deg
from mazeplan.core.records import Array
from mazeplan.maze.bands import Bands, Edges, fit_edges, sharpness

Index = NDArray[np.intp]

MAX_SPEED = 1.0  # m/s; a ball that rolls down half the outermost ring at 5 degrees of tilt reaches .6
MAX_GAP = 4  # sample intervals; after a longer gap the place of a change is unknown
MIN_COUNT = 2  # minimum number of passages of an opening
LEAST_IN_THROAT = 40  # minimum number of samples inside an opening to find its sides ...
LEAST_AT_SIDE = 5  # ... of which at least this many touched each side ...
SHARP = 5.0  # ... and minimum log likelihood by which two sides explain them better than one normal distribution
SIDE_ERROR = 2e-4  # m, of a side, besides its noise: few samples touch it; seen in simulated logs of known maps


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
    width, width_stderr: m, and 1 sigma; None: not measured
    count: number of passages
    width_from: source of the width, in words
    problem: why the cluster does not count as an opening, or ""
    """

    outer: int
    angle: float
    angle_stderr: float
    width: float | None
    width_stderr: float | None
    count: int
    width_from: str = "its sides"
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
    passages: Passages, track: BallTrack, bands: Bands, ball_radius: float, widths: Sequence[float], *,
    min_count: int = MIN_COUNT,
) -> tuple[LearnedOpening, ...]:  # fmt: skip
    """Openings, sorted by wall and angle; rejected ones have a `problem`.

    widths: likely width of an opening for each wall, m
    min_count: minimum number of passages of an opening

    Raises TableError for min_count < 1.
    """
    if min_count < 1:
        raise TableError(f"min_count: got {min_count}, expected at least 1")
    found: list[LearnedOpening] = []
    for wall in range(1, len(bands.edges)):
        here = np.flatnonzero(passages.wall == wall)
        if not len(here):
            continue
        radius = middle_radius(bands, wall)
        label = cluster(passages.angle[here], radius, ball_radius)
        groups = [here[label == number] for number in np.unique(label)]
        spread = _spread(passages.angle, groups, radius, widths[wall - 1] / 2.0 - ball_radius, bands.noise)
        openings = [_opening(passages, rows, track, bands, wall, ball_radius, spread) for rows in groups]
        openings = _judged(openings, radius, widths[wall - 1], min_count)
        found += sorted(openings, key=lambda opening: opening.angle)
    return tuple(found)


def _judged(openings: list[LearnedOpening], radius: float, width: float, min_count: int) -> list[LearnedOpening]:
    """The openings of one wall with their problems: too few passages, or overlap with an opening that has more."""
    accepted: list[LearnedOpening] = []
    judged: list[LearnedOpening] = []
    for opening in sorted(openings, key=lambda opening: -opening.count):
        near = [o for o in accepted if radius * abs(difference(o.angle, opening.angle)) < max(width, o.width or 0.0)]
        problem = ""
        if opening.count < min_count:
            problem = f"{opening.count} passage{'s' * (opening.count != 1)}, fewer than {min_count}"
        elif near:
            problem = f"overlaps the opening at {place_deg(near[0].angle, 1):.1f} deg"
        else:
            accepted.append(opening)
        judged.append(replace(opening, problem=problem))
    return judged


def cluster(angle: Array, radius: float, ball_radius: float) -> Index:
    """Number of the opening, from 0, of each passage of one wall at angles (N,) in rad; `radius` of the wall in m.

    Two openings do not share their sides. So the ball's centre in one opening is at least a ball's diameter away from
    its place in the other. Within one opening the play is smaller. Therefore passages that are nearer than the ball's
    radius along the wall belong to one opening.
    """
    from sklearn.cluster import DBSCAN

    apart = np.abs((angle[:, None] - angle[None, :] + math.pi) % (2.0 * math.pi) - math.pi)
    return DBSCAN(eps=ball_radius, min_samples=1, metric="precomputed").fit(radius * apart).labels_


def circular_mean(angle: Array) -> float:
    """Mean direction, rad in [0, 2 pi)."""
    return math.atan2(np.sin(angle).sum(), np.cos(angle).sum()) % (2.0 * math.pi)


def _turns(angle: Array, reference: float) -> Array:
    """Shortest signed turns from `reference`, rad."""
    return (angle - reference + math.pi) % (2.0 * math.pi) - math.pi


def _spread(angle: Array, groups: list[Index], radius: float, play: float, noise: float) -> float:
    """1 sigma of the place of one passage along the wall, m, from all openings of the wall, with a prior from play and
    noise."""
    free = sum(len(rows) - 1 for rows in groups)
    expected = play**2 / 3.0 + noise**2
    squares = sum(float(np.sum((radius * _turns(angle[rows], circular_mean(angle[rows]))) ** 2)) for rows in groups)
    return math.sqrt((squares + 3.0 * expected) / (free + 3.0))  # the expectation counts as three passages


def _opening(
    passages: Passages, rows: Index, track: BallTrack, bands: Bands, outer: int, ball_radius: float, spread: float
) -> LearnedOpening:
    """The opening of one cluster of passages. rows: indices of its passages; spread: 1 sigma of one passage, m."""
    angle, radius = circular_mean(passages.angle[rows]), middle_radius(bands, outer)
    stderr, width, width_stderr = spread / math.sqrt(len(rows)), None, None
    if sides := _sides(track, bands, outer, angle, ball_radius):
        # the middle between both sides does not depend on which side the ball touched more often
        errors = [bands.noise**2 / touches + SIDE_ERROR**2 for touches in (sides.low_touches, sides.high_touches)]
        angle = (angle + 0.5 * (sides.low + sides.high) / radius) % (2.0 * math.pi)
        stderr, width_stderr = 0.5 * math.sqrt(sum(errors)), math.sqrt(sum(errors))
        width = sides.high - sides.low + 2.0 * ball_radius
    return LearnedOpening(outer, angle, stderr / radius, width, width_stderr, len(rows))


def _sides(track: BallTrack, bands: Bands, outer: int, angle: float, ball_radius: float) -> Edges | None:
    """Places of the ball's centre when the ball touches the two sides of an opening, m along the wall from `angle`.

    None if there are too few samples, or the sides do not show clearly. The parallel sides bound the centre as the
    walls of a ring do."""
    x, y = track.x - bands.centre[0], track.y - bands.centre[1]
    along, across = x * math.cos(angle) + y * math.sin(angle), y * math.cos(angle) - x * math.sin(angle)
    inner, outer_face = bands.edges[outer].high + ball_radius, bands.edges[outer - 1].low - ball_radius
    throat = across[(along > inner) & (along < outer_face) & (np.abs(across) < ball_radius)]
    if len(throat) < LEAST_IN_THROAT:
        return None
    low, high = np.quantile(throat, [0.1, 0.9])
    sides = fit_edges(throat, float(low), float(high), bands.noise)
    enough = min(sides.low_touches, sides.high_touches) >= LEAST_AT_SIDE
    enough = enough and sides.high - sides.low > 2.0 * bands.noise
    return sides if enough and sharpness(throat, sides, bands.noise) > SHARP else None
