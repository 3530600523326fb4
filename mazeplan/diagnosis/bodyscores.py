"""How well a ball with a body predicts what took no part in a fit: each half of a record by the other's numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mazeplan.diagnosis.bodysearch import ENOUGH, NOISE, STEPS, Searched
from mazeplan.estimation.bodyfilter import BodyFilter, BodyModel, Filtered
from mazeplan.estimation.bodyfit import BLOCK_S, fit_body
from mazeplan.maths.angles import difference
from mazeplan.maze.geometry import Maze
from mazeplan.models.rollout import STEPS as AHEAD
from mazeplan.records import Array, IntArray

EVERY = 7  # pictures between the starts of roll-outs


@dataclass(frozen=True)
class HeldOut:
    """starts (W,): pictures from which the ball was followed; before, after (AHEAD, W): errors of its angle, rad, 1 to
    AHEAD samples ahead, without and with what was found; gain (B,): of -2 log L by blocks of BLOCK_S, with it; plain
    (AHEAD, W): errors with the new stage alone."""

    starts: IntArray
    before: Array
    after: Array
    gain: Array
    plain: Array

    @property
    def nearer(self) -> bool:
        """Whether roll-outs are nearer with what was found of ball, table and camera than without."""
        return float(np.nanmean(self.after[-1])) <= float(np.nanmean(self.plain[-1]))

    @property
    def likelier(self) -> float:
        """Standard errors by which blocks are likelier with what was found; inf where nothing was."""
        if not np.any(self.gain):
            return math.inf
        spread = max(float(self.gain.std(ddof=1)) / math.sqrt(len(self.gain)), 1e-12)
        return float(self.gain.mean()) / spread

    def errors(self, which: str) -> dict[str, float]:
        """Mean absolute errors as in the JSON; which: before or after."""
        errors = getattr(self, which)
        return {f"rollout{ahead}": _mean(errors[ahead - 1]) for ahead in (AHEAD // 2, AHEAD)}


def held_out(body: BodyFilter, old: BodyFilter, was: BodyModel, searched: Searched, maze: Maze) -> HeldOut:
    """How the record is predicted without and with what was found. old: the filter with the plate as the old model's
    stage moves it; was: the old model."""
    n, plain = len(body.pictures), searched.first.filtered
    starts = starts_of(body, plain, maze)
    before = roll_out_errors(old, was._replace(wander=searched.first.model.wander), starts)
    gain, blocks = np.zeros(n), np.arange(0, n, round(BLOCK_S / body.pictures.dt))
    alone = roll_out_errors(body, searched.first.model, starts)
    if not searched.found:
        return HeldOut(starts, before, alone, np.zeros(len(blocks)), alone)
    after, second = np.empty_like(before), np.arange(n) >= n // 2
    for rows in (second, ~second):
        model = _by_rows(body, searched, ~rows)
        gain[rows] = (surprise(plain) - surprise(body.run(model)))[rows]
        after[:, rows[starts]] = roll_out_errors(body, model, starts[rows[starts]])
    return HeldOut(starts, before, after, np.add.reduceat(np.nan_to_num(gain), blocks), alone)


def _by_rows(body: BodyFilter, searched: Searched, rows: np.ndarray) -> BodyModel:
    """What was found, with the sizes that some pictures tell."""
    p = body.pictures
    clock = None if p.clock is None else p.clock[rows]
    part = replace(p, t=p.t[rows], y=p.y[rows], first=p.first[rows], clock=clock)
    names: Sequence[str] = [*NOISE, *(name for c in searched.found for name in c.fitted)]
    told = BodyFilter(part, body.plate, body.walls)
    return fit_body(told, searched.fit.model, names, STEPS, ENOUGH).model


def on_test(old: BodyFilter, was: BodyModel, new: BodyFilter, found: BodyModel, maze: Maze) -> HeldOut:
    """The same for a further record that took no part: all of it is held out."""
    found = found._replace(wander=was.wander)
    before, after = old.run(was), new.run(found)
    starts = starts_of(new, after, maze)
    gain = np.nan_to_num(surprise(before) - surprise(after))
    blocks = np.arange(0, len(gain), round(BLOCK_S / new.pictures.dt))
    errors = (roll_out_errors(old, was, starts), roll_out_errors(new, found, starts))
    return HeldOut(starts, *errors, np.add.reduceat(gain, blocks), errors[0])


def starts_of(body: BodyFilter, filtered: Filtered, maze: Maze) -> IntArray:
    """Pictures from which the ball is followed: outside the disc, with none of the next ones in another stretch."""
    n, first = len(body.pictures), body.pictures.first
    disc = max((ring.outer_radius for ring in maze.rings if ring.is_disc), default=0.0)
    begun = np.cumsum(first)
    good = np.isfinite(filtered.nu[: n - AHEAD, 0]) & (begun[: n - AHEAD] == begun[AHEAD:])
    good &= np.min([np.hypot(*filtered.state[k : n - AHEAD + k, :2].T) for k in (0, AHEAD // 2, AHEAD)], axis=0) > disc
    return np.flatnonzero(good)[::EVERY]


def surprise(filtered: Filtered) -> Array:
    """nu' S^-1 nu + log det S of each picture, (N,)."""
    (a, b), (xx, yy, xy) = filtered.nu.T, filtered.S.T
    det = xx * yy - xy * xy
    return np.asarray(np.log(det) + (a * a * yy - 2.0 * a * b * xy + b * b * xx) / det)


def roll_out_errors(body: BodyFilter, model: BodyModel, starts: IntArray) -> Array:
    """Absolute errors (AHEAD, W) of the angle, rad, 1 to AHEAD samples behind some pictures (W,), along the plate's
    motion; NaN where the ball was not seen."""
    states, y = body.run(model).state, body.pictures.y
    places = body.rolled_out(model, states, starts, AHEAD)[:, 1:]
    there = y[starts[:, None] + np.arange(1, AHEAD + 1)]
    error = difference(np.arctan2(places[..., 1], places[..., 0]), np.arctan2(there[..., 1], there[..., 0]))
    return np.abs(error).T


def _mean(errors: Array) -> float:
    return round(float(np.nanmean(errors)), 4) if np.isfinite(errors).any() else math.nan
