"""Where a search starts: the camera by the channels of the map, places and frequencies by the innovations.

The ball is never inside a wall. So the camera that puts most positions into channels is near the true one, also if that
is off by several millimetres. The innovations show the middle of a bump, the frequency of a rocking table, the dirty
sector of a ring.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from mazeplan.control.estimation.rigid_body_filter import BodyFilter, CameraView, Filtered
from mazeplan.core.errors import TableError
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze
from mazeplan.physics.effect import Term
from mazeplan.physics.effects import local_forces as forces

FURTHEST, STEP = 0.01, 0.0005  # m, maximum and step of the camera's offset
SCALES = tuple(0.9 + 0.004 * i for i in range(51))
BLUR = 0.0012  # m, by which a position may lie in a wall
BETTER = 0.03  # minimum share of positions that a start brings into the channels in addition
MOST = 3000  # maximum number of positions
MIN_CHANNEL_SHARE = 0.72  # minimum share of positions in channels, for the right map; 0.86 and more were seen
FEWEST = 100  # minimum number of positions that say something about a map
NEAR_OPENING = 0.008  # m; positions so near an opening say nothing about the map: a ball may pass it, or lie in it
TICKS = np.arange(-FURTHEST, FURTHEST + STEP, STEP)
GRID, FINE, WIDTHS = 0.008, 0.002, (0.01, 0.015, 0.022)  # m; places and widths that are tried for a bump
MEMORY = 8  # pictures over which an acceleration shows in the innovations
SLOWEST, FASTEST, BIN = 0.05, 8.0, 1.0 / 120.0  # Hz, range for a rocking table; s, resolution of times
HARMONICS, STRONG = (3, 2), 0.35  # of a repeated push; minimum power at its frequency, over the highest power
SECTORS, HALVES = 48, (0.2, 0.35, 0.6)  # tried middles of dirt in each ring; tried half widths, rad
BESIDE, WAVES = 0.07, range(4, 10)  # rad, half width of a kerb; tried numbers of waves around a ring
SLOW = 0.01  # m/s; a slower ball does not show which way friction acts


Seen = tuple[float, float, float]  # offset of the camera x, y (m) and scale


class _Channels:
    """Measured positions (N, 2) of the ball, m, laid over the channels of a map."""

    def __init__(self, body: BodyFilter, maze: Maze) -> None:
        y = body.pictures.y[np.isfinite(body.pictures.y[:, 0])]
        self.y, self.maze, self.ball = y[:: max(len(y) // MOST, 1)], maze, body.walls.radius

    def share(self, camera: Seen) -> float:
        """Share of the positions in channels, for a camera. A ball that passes an opening is in no channel."""
        x, z, scale = camera
        r = np.hypot(self.y[:, 0] - x, self.y[:, 1] - z) / scale
        inside = np.zeros(len(r), dtype=bool)
        for ring in self.maze.rings:
            low = -math.inf if ring.is_disc else ring.inner_radius + self.ball - BLUR
            inside |= (r >= low) & (r <= ring.outer_radius - self.ball + BLUR)
        return float(inside.mean()) if len(r) else 0.0

    def best(self, tried: Iterable[Seen]) -> Seen:
        """The camera with most positions in channels. If several cameras are equally good, their mean."""
        scored = [(self.share(camera), camera) for camera in tried]
        most = max(share for share, _ in scored)
        x, z, scale = np.array([camera for share, camera in scored if share > most - 0.002]).mean(axis=0).tolist()
        return x, z, scale


def camera_starts(body: BodyFilter, view: CameraView, maze: Maze) -> dict[str, dict[str, float]]:
    """Numbers of the camera, by effect, that put more positions into channels than `view` does."""
    channels = _Channels(body, maze)
    least = channels.share((view.offset_x, view.offset_y, view.scale)) + BETTER
    x, z, _ = channels.best((float(x), float(z), view.scale) for x in TICKS[::4] for z in TICKS[::4])
    near = TICKS[np.abs(TICKS) <= 4.0 * STEP]
    moved = channels.best((x + float(dx), z + float(dz), view.scale) for dx in near for dz in near)
    scaled = channels.best((view.offset_x, view.offset_y, scale) for scale in SCALES)
    out = {}
    if channels.share(moved) > least:
        out["camera_offset"] = {"offset_x": moved[0], "offset_y": moved[1]}
    if channels.share(scaled) > least:
        out["camera_scale"] = {"scale": scaled[2]}
    return out


def check_map(body: BodyFilter, maze: Maze, file: str | None) -> None:
    """Raise TableError if no camera puts enough of the positions into the channels of the map.

    Positions near openings do not count: in quick runs, these are two thirds."""
    channels = _Channels(body, maze)
    for opening in maze.openings:
        middle = maze.threshold_radius(opening) * np.array([math.cos(opening.angle), math.sin(opening.angle)])
        channels.y = channels.y[np.hypot(*(channels.y - middle).T) > 0.5 * opening.width + NEAR_OPENING]
    if len(channels.y) < FEWEST:
        return
    ticks = np.arange(-FURTHEST, FURTHEST + STEP, 4.0 * STEP).tolist()
    share = max(channels.share((x, z, scale)) for x in ticks for z in ticks for scale in SCALES[::5])
    if share < MIN_CHANNEL_SHARE:
        problem = f"away from openings, the ball is in no ring of the map in {1.0 - share:.0%} of the samples"
        raise TableError(f"{problem}, wherever the camera is; expected --radius M, or another --map", file=file)


def started_terms(
    body: BodyFilter, filtered: Filtered, delay: float, maze: Maze, swings: float = 0.0
) -> tuple[Term, ...]:
    """All terms, without effect, at the places and frequencies that the innovations suggest.

    delay: of the camera, s
    swings: frequency of a rocking table, Hz, if it was found before"""
    implied, place = _implied_acceleration(filtered), filtered.state[:, :2]
    x, y, width = _bump_place(place, implied, maze)
    centre, half, inner, outer = _slowing_sector(filtered, implied, maze, HALVES)
    t = (body.pictures.t if body.pictures.clock is None else body.pictures.clock) - delay
    radial = place / np.maximum(np.hypot(*place.T), 1e-3)[:, None]
    along = radial[:, 0] * implied[:, 1] - radial[:, 1] * implied[:, 0]
    powers = {n: float(np.sum(np.abs(np.exp(-2j * math.pi * (n * swings) * t) @ implied) ** 2)) for n in HARMONICS}
    beats = max(powers, key=lambda n: powers[n]) * swings
    theta = np.arctan2(place[:, 1], place[:, 0])
    waves = max(WAVES, key=lambda n: abs(np.sum(along * np.exp(-1j * n * theta))))
    kerb, _, *kerb_ring = _slowing_sector(filtered, implied, maze, (BESIDE,))
    return (
        Term(forces.floor_warp, (0.0, 0.0, 0.0)),
        Term(forces.floor_bump, (x, y, 0.0, width)),
        Term(forces.floor_dirt, (centre - half, centre + half, inner, outer, 0.0)),
        Term(forces.floor_kerb, (kerb, *kerb_ring, 0.0)),
        Term(forces.floor_ripple, (float(waves), 0.0, 0.0)),
        Term(forces.table_swing, (_frequency(t, implied), 0.0, 0.0, 0.0, 0.0)),
        Term(forces.table_beat, (beats, 0.0, 0.0, 0.0, 0.0)),
        Term(forces.swing_along, (_frequency(t, along[:, None]), 0.0, 0.0)),
        Term(forces.drag_drift, (0.0, 0.0)),
        Term(forces.lean_drift, (0.0, 0.0)),
        Term(forces.moving_friction, (0.0,)),
        Term(forces.ring_push, (0.0, 0.0)),
    )


def _slowing_sector(
    filtered: Filtered, implied: Array, maze: Maze, halves: Sequence[float]
) -> tuple[float, float, float, float]:
    """(middle, half width, inner radius, outer radius), rad and m, of the sector where a deceleration explains most."""
    place, v = filtered.state[:, :2], filtered.state[:, 2:4]
    speed, r, theta = np.hypot(*v.T), np.hypot(*place.T), np.arctan2(place[:, 1], place[:, 0])
    slows = np.where(speed > SLOW, -np.sum(implied * v, axis=1) / np.maximum(speed, SLOW), 0.0)
    best, found = 0.0, (0.0, halves[0], 0.0, 0.0)
    for ring in maze.rings:
        if ring.is_disc:
            continue
        here = (r > ring.inner_radius) & (r < ring.outer_radius) & (speed > SLOW)
        for centre in np.linspace(-math.pi, math.pi, SECTORS, endpoint=False):
            away = np.abs((theta - centre + math.pi) % (2.0 * math.pi) - math.pi)
            for half in halves:
                inside = slows[here & (away < half)]
                score = float(inside.sum()) / math.sqrt(len(inside)) if len(inside) > 20 else 0.0
                if score > best:
                    best, found = score, (float(centre), half, ring.inner_radius, ring.outer_radius)
    return found


def _implied_acceleration(filtered: Filtered) -> Array:
    """Acceleration (N, 2) at each picture, as the next innovations suggest it, up to a scale."""
    (a, b), (xx, yy, xy) = filtered.nu.T, filtered.S.T
    det = xx * yy - xy * xy
    weighted = np.nan_to_num(np.column_stack([(yy * a - xy * b) / det, (xx * b - xy * a) / det]))
    out = np.zeros_like(weighted)
    for later in range(1, MEMORY + 1):
        out[:-later] += (later / MEMORY) * math.exp(-later / 3.0) * weighted[later:]
    return out


def _bump_place(place: Array, implied: Array, maze: Maze) -> tuple[float, float, float]:
    """(x, y, width), m, of the pull towards one place that explains most."""
    reach = maze.ring(1).outer_radius
    ticks = np.arange(-reach, reach + GRID, GRID)
    coarse = ((float(x), float(y), forces.BUMP_WIDTH_M) for x in ticks for y in ticks if math.hypot(x, y) < reach)
    x, y, _ = max(coarse, key=lambda at: _pulled(place, implied, at))
    ticks = np.arange(-GRID, GRID + FINE, FINE)
    fine = ((x + float(dx), y + float(dy), width) for dx in ticks for dy in ticks for width in WIDTHS)
    return max(fine, key=lambda at: _pulled(place, implied, at))


def _pulled(place: Array, implied: Array, at: tuple[float, float, float]) -> float:
    """How much of the suggested accelerations a pull towards a place explains. at: x, y, width, m"""
    x, y, width = at
    near = (np.abs(place[:, 0] - x) < 3.0 * width) & (np.abs(place[:, 1] - y) < 3.0 * width)
    away = (place[near] - (x, y)) / width
    pull = away * np.exp(-0.5 * np.sum(away * away, axis=1))[:, None]
    power = float(np.sum(pull * pull))
    return float(np.sum(pull * implied[near])) ** 2 / power if power > 5.0 else 0.0


def _frequency(t: Array, implied: Array) -> float:
    """The frequency at which the spectrum of the suggested accelerations is highest, Hz. Times are rounded to BIN s.

    The spectrum of a repeated push may be higher at a multiple of the push's frequency."""
    places = np.round((t - t[0]) / BIN).astype(int)
    size = 2 ** math.ceil(math.log2(2.5 * (places[-1] + 1)))
    binned = np.stack([np.bincount(places, weights=column, minlength=size) for column in implied.T])
    powers = np.sum(np.abs(np.fft.rfft(binned)) ** 2, axis=0)
    tried = np.fft.rfftfreq(size, BIN)
    powers[(tried < SLOWEST) | (tried > FASTEST)] = 0.0
    highest = int(np.argmax(powers))
    for n in HARMONICS:
        near = slice(max(highest // n - 2, 0), highest // n + 3)
        if powers[near].max() > STRONG * powers[highest]:
            return float(tried[near][np.argmax(powers[near])])
    return float(tried[highest])
