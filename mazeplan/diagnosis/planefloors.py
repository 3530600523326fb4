"""What acts on a ball with a body at places of the plate or moments of time: a warped floor, a bump or magnet, a table
that rocks. They are written in the plane, so that one set of numbers holds for all rings, and a search knows where to
begin: at the place or frequency at which the innovations ask for it most.

    floor_warp      z = a (x^2 - y^2) + 2 b x y + c (x^2 + y^2)
    floor_bump      a pull of at most `depth` times gravity towards (x, y), derivative of a Gaussian bell of this width
    table_swing     the table leans by bs sin wt + bc cos wt, and gs sin wt + gc cos wt
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mazeplan.estimation.bodyfilter import BodyFilter, Filtered
from mazeplan.maze.geometry import Maze
from mazeplan.physics.effect import GRAVITY, Effect, Parameter, Term
from mazeplan.physics.symbols import cos, exp, sin
from mazeplan.records import Array

GRID, WIDTH = 0.008, 0.015  # m; between places that are tried for a bump, and its first width
MEMORY = 8  # pictures over which an acceleration shows in the innovations
SLOWEST, FASTEST = 0.05, 8.0  # Hz, of a table that rocks
STEEP = Parameter("1/m", 0.0, -1.0, 1.0, smallest=0.004, step=2e-3)
PLACE = Parameter("m", 0.0, -0.2, 0.2, step=5e-4)
DEPTH = Parameter("1", 0.0, -0.2, 0.2, smallest=0.002, step=1e-3)
SWING = Parameter("rad", 0.0, -0.1, 0.1, smallest=0.001, step=5e-4)


def _place(s: Any) -> tuple[Any, Any]:
    return s.radius * cos(s.theta), s.radius * sin(s.theta)


def _warp(s: Any, p: Any) -> dict[str, Any]:
    x, y = _place(s)
    return {"beta": -2.0 * (p.a * x + p.b * y + p.c * x), "gamma": 2.0 * (p.b * x - p.a * y + p.c * y)}


def _bump(s: Any, p: Any) -> dict[str, Any]:
    x, y = _place(s)
    x, y = (x - p.x) / p.width, (y - p.y) / p.width
    pull = p.depth * exp(0.5 - 0.5 * (x * x + y * y))  # largest at one width from the middle, then `depth`
    return {"beta": -pull * x, "gamma": pull * y}


def _swing(s: Any, p: Any) -> dict[str, Any]:
    phase = 2.0 * math.pi * p.frequency * s.t
    return {"beta": p.bs * sin(phase) + p.bc * cos(phase), "gamma": p.gs * sin(phase) + p.gc * cos(phase)}


floor_warp = Effect("floor_warp", {"a": STEEP, "b": STEEP, "c": STEEP}, GRAVITY, _warp, text="the floor is not flat")
floor_bump = Effect(
    "floor_bump",
    {"x": PLACE, "y": PLACE, "depth": DEPTH, "width": Parameter("m", WIDTH, 0.004, 0.06, step=5e-4)},
    GRAVITY, _bump, text="one hill or hollow, or a magnet",
)  # fmt: skip
table_swing = Effect(
    "table_swing",
    {"frequency": Parameter("Hz", 0.0, 0.0, 15.0, step=1e-4), "bs": SWING, "bc": SWING, "gs": SWING, "gc": SWING},
    GRAVITY, _swing, text="the table rocks",
)  # fmt: skip


def started_terms(body: BodyFilter, filtered: Filtered, delay: float, maze: Maze) -> tuple[Term, Term, Term]:
    """The three without any size yet, at the place and frequency that these innovations speak for."""
    asked = _asked(filtered)
    x, y = _bump_place(filtered.state[:, :2], asked, maze)
    frequency = _frequency(body.pictures.t - delay, asked)
    return (
        Term(floor_warp, (0.0, 0.0, 0.0)),
        Term(floor_bump, (x, y, 0.0, WIDTH)),
        Term(table_swing, (frequency, 0.0, 0.0, 0.0, 0.0)),
    )


def _asked(filtered: Filtered) -> Array:
    """By how much the innovations behind each picture (N, 2) speak for an acceleration there, up to a scale."""
    (a, b), (xx, yy, xy) = filtered.nu.T, filtered.S.T
    det = xx * yy - xy * xy
    weighted = np.nan_to_num(np.column_stack([(yy * a - xy * b) / det, (xx * b - xy * a) / det]))
    out = np.zeros_like(weighted)
    for later in range(1, MEMORY + 1):
        out[:-later] += (later / MEMORY) * math.exp(-later / 3.0) * weighted[later:]
    return out


def _bump_place(place: Array, asked: Array, maze: Maze) -> tuple[float, float]:
    """Where a pull towards one place explains most."""
    reach = maze.ring(1).outer_radius
    ticks = np.arange(-reach, reach + GRID, GRID)
    best, found = 0.0, (0.0, 0.0)
    for x in ticks:
        near = np.abs(place[:, 0] - x) < 3.0 * WIDTH
        here, pulled = place[near], asked[near]
        for y in ticks[np.hypot(x, ticks) < reach]:
            away = (here - (x, y)) / WIDTH
            pull = away * np.exp(-0.5 * np.sum(away * away, axis=1))[:, None]
            power = float(np.sum(pull * pull))
            score = float(np.sum(pull * pulled)) ** 2 / power if power > 5.0 else 0.0
            if score > best:
                best, found = score, (float(x), float(y))
    return found


def _frequency(t: Array, asked: Array) -> float:
    """Where the spectrum of what the innovations ask for is highest, Hz."""
    span = float(t[-1] - t[0])
    tried = np.arange(SLOWEST, FASTEST, 0.4 / span)
    powers = np.zeros(len(tried))
    for start in range(0, len(tried), 200):
        turn = np.exp(-2j * math.pi * np.outer(tried[start : start + 200], t))
        powers[start : start + 200] = np.sum(np.abs(turn @ asked) ** 2, axis=1)
    return float(tried[np.argmax(powers)])
