"""Learns a map from positions of the ball: rings from `bands`, openings from `transitions`, the rest from a prior map.

Logs never show ball, tilt limit, height of the walls, thickness of the rim, width of openings, and radial walls: these
come from the prior map.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from mazeplan.core.maths.angles import place_deg
from mazeplan.core.progress import Words, no_words
from mazeplan.maze.bands import MODEL_ERROR, Bands, Edges, fit_bands
from mazeplan.maze.geometry import Maze, Opening, Ring
from mazeplan.maze.mapfile import MapCheck, check_text, dump_map
from mazeplan.maze.mapschema import default_name
from mazeplan.maze.transitions import MIN_COUNT, BallTrack, LearnedOpening, find_openings, find_passages
from mazeplan.maze.yamltree import shown

TOUCHES = 20  # minimum number of samples at a wall for which its place counts as measured
PLACES_MM, PLACES_DEG = 2, 2  # decimals in the file: below what a camera resolves


@dataclass(frozen=True)
class LearnedRing:
    """A learned ring: clear floor between two radii.

    inner_radius, outer_radius: m; inner_radius is 0 for the disc
    inner_stderr, outer_stderr: 1 sigma, m; None: the ball hardly touched this wall, so the radius is a guess
    inner_touches, outer_touches: number of samples in which the ball touched this wall
    """

    number: int
    inner_radius: float
    outer_radius: float
    inner_stderr: float | None
    outer_stderr: float | None
    inner_touches: int
    outer_touches: int


@dataclass(frozen=True)
class LearnedMap:
    """The learned maze and the source of each number.

    maze: None if the maze is incomplete, see `problems`
    centre: of the circles in the camera's frame, m; it is the origin of rings and openings
    noise: 1 sigma of the camera per axis, m
    samples: number of samples with the ball
    passages: number of changes of ring
    skipped: number of changes of ring that could not be placed
    prior: name of the prior map
    """

    maze: Maze | None
    rings: tuple[LearnedRing, ...]
    openings: tuple[LearnedOpening, ...]
    centre: tuple[float, float]
    noise: float
    samples: int
    passages: int
    skipped: int
    prior: str
    warnings: tuple[str, ...]
    problems: tuple[str, ...]


def learn_map(
    track: BallTrack, prior: Maze, *, prior_name: str, min_count: int = MIN_COUNT, progress: Words = no_words
) -> LearnedMap:
    """The map with rings and openings from a track, and the rest from the prior map.

    prior_name: name of the prior map in messages
    min_count: minimum number of passages through an opening

    Raises TableError if the track does not show two rings.
    """
    radius = prior.ball.radius
    progress("rings")
    bands = _completed(fit_bands(track.x, track.y, radius), prior)
    rings = tuple(_ring(i, edges, bands.noise, radius) for i, edges in enumerate(bands.edges))
    progress("changes of ring")
    passages = find_passages(track, bands)
    widths = [_likely_width(prior, wall, len(rings)) for wall in range(1, len(rings))]
    progress("openings")
    openings = find_openings(passages, bands, radius, widths, min_count=min_count)
    maze = Maze(
        "learned",
        prior.ball,
        tuple(Ring(ring.number, _rounded(ring.inner_radius), _rounded(ring.outer_radius)) for ring in rings),
        tuple(_opening(o, widths[o.outer - 1]) for o in openings if not o.problem),
        prior.tilt_limit,
        prior.wall_height,
        prior.rim_thickness,
    )
    maze, check, dropped = _with_radial_walls(maze, prior, prior_name)
    problems = _never_passed(maze, openings) or tuple(error.problem for error in check.errors)
    return LearnedMap(
        None if problems else maze, rings, openings, bands.centre, bands.noise, len(track.t), len(passages.wall),
        passages.skipped, prior_name, (*_warnings(rings, prior), *dropped), problems,
    )  # fmt: skip


def _with_radial_walls(maze: Maze, prior: Maze, prior_name: str) -> tuple[Maze, MapCheck, tuple[str, ...]]:
    """The maze with the radial walls of the prior map, if they fit; the result of `check_text`; warnings."""
    check, note = check_text(dump_map(maze)), f"radial walls, which no log shows, are those of {prior_name}"
    if not prior.radial_walls:
        return maze, check, ()
    if len(prior.rings) != len(maze.rings):
        return maze, check, (f"{note}, but left out: it has {len(prior.rings)} rings",)
    walled = replace(maze, radial_walls=prior.radial_walls)
    again = check_text(dump_map(walled))
    if again.errors and not check.errors:
        return maze, check, (f"{note}, but left out: {again.errors[0].problem}",)
    return walled, again, (note,)


def map_text(learned: LearnedMap, sources: Sequence[str] = ()) -> str:
    """The learned map as YAML that `load_map` reads.

    sources: names of the files from which the map was learned

    Raises ValueError if no maze was learned."""
    if learned.maze is None:
        raise ValueError(f"no map was learned: {'; '.join(learned.problems)}")
    files = ", ".join(name if name.isprintable() else shown(name) for name in sources)
    x, y = (1e3 * value for value in learned.centre)
    return (
        f"# Learned from where the ball was{': ' * bool(files)}{files}\n"
        f"# The circles' centre was at x {x:.2f}, y {y:.2f} mm in the camera's picture. It is the origin here.\n"
        f"# What no log shows (ball, tilt limit, walls' height, rim, openings' widths) is from {learned.prior}.\n"
        + dump_map(learned.maze)
    )


# Rings.


def _completed(bands: Bands, prior: Maze) -> Bands:
    """The bands with a place for each edge that the ball hardly touched: by the other side of its wall, provided that
    the ball touched that side, else as far as the ball was seen. A band with only one visible edge gets the width of
    the other ones."""
    edges, reach = list(bands.edges), 2.0 * prior.ball.radius
    touched = [(e.low_touches >= TOUCHES, e.high_touches >= TOUCHES) for e in edges]
    walls = [
        outer.low - inner.high - reach
        for (outer, inner), (a, b) in zip(pairwise(edges), pairwise(touched), strict=True)
        if a[0] and b[1]
    ]
    thickness = float(np.median(walls or [w.outer_radius - w.inner_radius for w in prior.walls[1:]]))
    for i, (low, high) in enumerate(touched):
        if not low and edges[i].low > 0.0 and i + 1 < len(edges) and touched[i + 1][1]:
            edges[i] = replace(edges[i], low=min(edges[i + 1].high + reach + thickness, edges[i].high))
        if not high and i > 0 and touched[i - 1][0]:
            edges[i] = replace(edges[i], high=max(edges[i - 1].low - reach - thickness, edges[i].low))
    play = [e.high - e.low for e in edges if e.low > 0.0 and e.high - e.low > 2.0 * bands.noise]
    nominal = [r.outer_radius - r.inner_radius - reach for r in prior.rings if not r.is_disc]
    half = 0.5 * float(np.median(play or nominal))
    for i, e in enumerate(edges):
        if e.low > 0.0 and e.high - e.low <= 2.0 * bands.noise:
            middle = 0.5 * (e.low + e.high)
            edges[i] = Edges(middle - half, middle + half, 0.0, 0.0)
    return replace(bands, edges=tuple(edges))


def _ring(i: int, edges: Edges, noise: float, ball_radius: float) -> LearnedRing:
    low, high = (
        math.hypot(noise / math.sqrt(touches), MODEL_ERROR) if touches >= TOUCHES else None
        for touches in (edges.low_touches, edges.high_touches)
    )
    inner, low = (0.0, 0.0) if edges.low == 0.0 else (edges.low - ball_radius, low)
    touches = round(edges.low_touches), round(edges.high_touches)
    return LearnedRing(i + 1, inner, edges.high + ball_radius, low, high, *touches)


# Openings.


def _likely_width(prior: Maze, wall: int, rings: int) -> float:
    """Median width of openings in the prior map, m: of the same wall if it has as many rings, else of all."""
    same = [o.width for o in prior.openings_between(wall, wall + 1)] if len(prior.rings) == rings else []
    return float(np.median(same or [o.width for o in prior.openings]))


def _opening(o: LearnedOpening, width: float) -> Opening:
    angle = place_deg(o.angle, PLACES_DEG)
    label = default_name(o.outer, o.outer + 1, angle)
    return Opening(label, o.outer, o.outer + 1, math.radians(angle), _rounded(width))


def _never_passed(maze: Maze, openings: Sequence[LearnedOpening]) -> tuple[str, ...]:
    problems = []
    for outer in range(1, len(maze.rings)):
        if not maze.openings_between(outer, outer + 1):
            lone = [o for o in openings if o.outer == outer]
            seen = f"{len(lone)} were passed, too seldom (see min-count)" if lone else "none was passed"
            problems.append(f"no opening between ring {outer} and {outer + 1}: {seen}")
    return tuple(problems)


def _warnings(rings: Sequence[LearnedRing], prior: Maze) -> tuple[str, ...]:
    found = [
        f"ring {ring.number}: {side} wall hardly touched, its place is a guess"
        for ring in rings
        for side, error in (("inner", ring.inner_stderr), ("outer", ring.outer_stderr))
        if error is None
    ]
    usual = float(np.median([w.outer_radius - w.inner_radius for w in prior.walls[1:]]))
    for outer, inner in pairwise(rings):
        thickness = outer.inner_radius - inner.outer_radius
        if thickness > usual + 2.0 * prior.ball.radius:
            found.append(
                f"the wall between ring {outer.number} and {inner.number} would be {1e3 * thickness:.0f} mm thick: "
                "was there a ring in which the ball never was?"
            )
    return tuple(found)


def _rounded(length: float) -> float:
    return round(1e3 * length, PLACES_MM) / 1e3
