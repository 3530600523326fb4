"""Where the innovations of a record ask for an effect at a place of the plate or at a moment of time.

A search begins there: at the middle of a bump, the frequency of a table that rocks, the sector of a ring that is dirty.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mazeplan.estimation.bodyfilter import BodyFilter, Filtered
from mazeplan.maze.geometry import Maze
from mazeplan.physics.effect import Term
from mazeplan.physics.planeterms import (
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
    table_swing,
)
from mazeplan.records import Array

GRID, FINE, WIDTHS = 0.008, 0.002, (0.01, 0.015, 0.022)  # m; places and widths that are tried for a bump
MEMORY = 8  # pictures over which an acceleration shows in the innovations
SLOWEST, FASTEST = 0.05, 8.0  # Hz, of a table that rocks
SECTORS, HALVES = 48, (0.2, 0.35, 0.6)  # middles of dirt that are tried in each ring, and half widths, rad
BESIDE, WAVES = 0.07, range(4, 10)  # rad on both sides of a kerb; waves around that are tried
SLOW = 0.01  # m/s; a slower ball does not show which way friction acts


def started_terms(body: BodyFilter, filtered: Filtered, delay: float, maze: Maze) -> tuple[Term, ...]:
    """Every term without any size yet, at the place and frequency that these innovations speak for."""
    asked, place = _asked(filtered), filtered.state[:, :2]
    x, y, width = _bump_place(place, asked, maze)
    t = (body.pictures.t if body.pictures.clock is None else body.pictures.clock) - delay
    radial = place / np.maximum(np.hypot(*place.T), 1e-3)[:, None]
    along = radial[:, 0] * asked[:, 1] - radial[:, 1] * asked[:, 0]
    return (
        Term(floor_warp, (0.0, 0.0, 0.0)),
        Term(floor_bump, (x, y, 0.0, width)),
        Term(floor_dirt, (*_slowing_sector(filtered, asked, maze, HALVES), 0.0)),
        Term(floor_kerb, _kerb(filtered, asked, maze)),
        Term(floor_ripple, (_waves(place, along), 0.0, 0.0)),
        Term(table_swing, (_frequency(t, asked), 0.0, 0.0, 0.0, 0.0)),
        Term(swing_along, (_frequency(t, along[:, None]), 0.0, 0.0)),
        Term(drag_drift, (0.0, 0.0)),
        Term(lean_drift, (0.0, 0.0)),
        Term(moving_friction, (0.0,)),
        Term(ring_push, (0.0, 0.0)),
    )


def _kerb(filtered: Filtered, asked: Array, maze: Maze) -> tuple[float, float, float, float]:
    """Numbers of a kerb without any height, where the ball is slowed most."""
    centre, _, inner, outer = _slowing_sector(filtered, asked, maze, (BESIDE,))
    return centre, inner, outer, 0.0


def _waves(place: Array, along: Array) -> float:
    """How many waves around explain most of the force along the rings that innovations ask for."""
    theta = np.arctan2(place[:, 1], place[:, 0])
    powers = [abs(np.sum(along * np.exp(-1j * n * theta))) for n in WAVES]
    return float(WAVES[int(np.argmax(powers))])


def _slowing_sector(
    filtered: Filtered, asked: Array, maze: Maze, halves: Sequence[float]
) -> tuple[float, float, float, float]:
    """Middle and half width, rad, and radii, m, of the sector in which a deceleration explains most."""
    place, v = filtered.state[:, :2], filtered.state[:, 2:4]
    speed, r, theta = np.hypot(*v.T), np.hypot(*place.T), np.arctan2(place[:, 1], place[:, 0])
    slows = np.where(speed > SLOW, -np.sum(asked * v, axis=1) / np.maximum(speed, SLOW), 0.0)
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


def _asked(filtered: Filtered) -> Array:
    """By how much the innovations behind each picture (N, 2) speak for an acceleration there, up to a scale."""
    (a, b), (xx, yy, xy) = filtered.nu.T, filtered.S.T
    det = xx * yy - xy * xy
    weighted = np.nan_to_num(np.column_stack([(yy * a - xy * b) / det, (xx * b - xy * a) / det]))
    out = np.zeros_like(weighted)
    for later in range(1, MEMORY + 1):
        out[:-later] += (later / MEMORY) * math.exp(-later / 3.0) * weighted[later:]
    return out


def _bump_place(place: Array, asked: Array, maze: Maze) -> tuple[float, float, float]:
    """Where a pull towards one place explains most, and how wide it is, m."""
    reach = maze.ring(1).outer_radius
    ticks = np.arange(-reach, reach + GRID, GRID)
    coarse = ((float(x), float(y), WIDTH) for x in ticks for y in ticks if math.hypot(x, y) < reach)
    x, y, _ = max(coarse, key=lambda at: _pulled(place, asked, at))
    ticks = np.arange(-GRID, GRID + FINE, FINE)
    fine = ((x + float(dx), y + float(dy), width) for dx in ticks for dy in ticks for width in WIDTHS)
    return max(fine, key=lambda at: _pulled(place, asked, at))


def _pulled(place: Array, asked: Array, at: tuple[float, float, float]) -> float:
    """How much a pull towards a place, with a width, explains of what innovations ask for."""
    x, y, width = at
    near = (np.abs(place[:, 0] - x) < 3.0 * width) & (np.abs(place[:, 1] - y) < 3.0 * width)
    away = (place[near] - (x, y)) / width
    pull = away * np.exp(-0.5 * np.sum(away * away, axis=1))[:, None]
    power = float(np.sum(pull * pull))
    return float(np.sum(pull * asked[near])) ** 2 / power if power > 5.0 else 0.0


def _frequency(t: Array, asked: Array) -> float:
    """Where the spectrum of what the innovations ask for is highest, Hz."""
    span = float(t[-1] - t[0])
    tried = np.arange(SLOWEST, FASTEST, 0.4 / span)
    powers = np.zeros(len(tried))
    for start in range(0, len(tried), 200):
        turn = np.exp(-2j * math.pi * np.outer(tried[start : start + 200], t))
        powers[start : start + 200] = np.sum(np.abs(turn @ asked) ** 2, axis=1)
    return float(tried[np.argmax(powers)])
