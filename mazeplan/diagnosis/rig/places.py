"""Places and frequencies at which the innovations of a record suggest an effect. The search starts there.

Examples: the middle of a bump, the frequency of a rocking table, the dirty sector of a ring.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mazeplan.control.estimation.rigid_body_filter import BodyFilter, Filtered
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze
from mazeplan.physics.effect import Term
from mazeplan.physics.effects.local_forces import (
    WIDTH,
    drag_drift,
    floor_bump,
    floor_dirt,
    floor_kerb,
    floor_ripple,
    floor_warp,
    lean_drift,
    moving_friction,
    ring_push,
    swing_along,
    table_beat,
    table_swing,
)

GRID, FINE, WIDTHS = 0.008, 0.002, (0.01, 0.015, 0.022)  # m; places and widths that are tried for a bump
MEMORY = 8  # pictures over which an acceleration shows in the innovations
SLOWEST, FASTEST, BIN = 0.05, 8.0, 1.0 / 120.0  # Hz, range for a rocking table; s, resolution of times
HARMONICS, STRONG = (3, 2), 0.35  # of a repeated push; minimum power at its frequency, over the highest power
SECTORS, HALVES = 48, (0.2, 0.35, 0.6)  # tried middles of dirt in each ring; tried half widths, rad
BESIDE, WAVES = 0.07, range(4, 10)  # rad, half width of a kerb; tried numbers of waves around a ring
SLOW = 0.01  # m/s; a slower ball does not show which way friction acts


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
    beats = max(HARMONICS, key=lambda n: _power(t, implied, n * swings)) * swings
    return (
        Term(floor_warp, (0.0, 0.0, 0.0)),
        Term(floor_bump, (x, y, 0.0, width)),
        Term(floor_dirt, (centre - half, centre + half, inner, outer, 0.0)),
        Term(floor_kerb, _kerb(filtered, implied, maze)),
        Term(floor_ripple, (_waves(place, along), 0.0, 0.0)),
        Term(table_swing, (_frequency(t, implied), 0.0, 0.0, 0.0, 0.0)),
        Term(table_beat, (beats, 0.0, 0.0, 0.0, 0.0)),
        Term(swing_along, (_frequency(t, along[:, None]), 0.0, 0.0)),
        Term(drag_drift, (0.0, 0.0)),
        Term(lean_drift, (0.0, 0.0)),
        Term(moving_friction, (0.0,)),
        Term(ring_push, (0.0, 0.0)),
    )


def _kerb(filtered: Filtered, implied: Array, maze: Maze) -> tuple[float, float, float, float]:
    """Numbers of a kerb of size zero, where the ball loses most speed."""
    centre, _, inner, outer = _slowing_sector(filtered, implied, maze, (BESIDE,))
    return centre, inner, outer, 0.0


def _waves(place: Array, along: Array) -> float:
    """The number of waves around a ring that explains most of the force along the rings."""
    theta = np.arctan2(place[:, 1], place[:, 0])
    powers = [abs(np.sum(along * np.exp(-1j * n * theta))) for n in WAVES]
    return float(WAVES[int(np.argmax(powers))])


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
    coarse = ((float(x), float(y), WIDTH) for x in ticks for y in ticks if math.hypot(x, y) < reach)
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


def _power(t: Array, implied: Array, frequency: float) -> float:
    """The spectrum of the suggested accelerations at one frequency, Hz."""
    turn = np.exp(-2j * math.pi * frequency * t)
    return float(np.sum(np.abs(turn @ implied) ** 2))
