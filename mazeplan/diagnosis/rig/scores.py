"""Predictions of held-out pictures by a rigid ball: for each half of a record, its numbers come from the other half."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mazeplan.control.estimation.rigid_body_filter import BodyFilter, BodyModel, Filtered
from mazeplan.control.estimation.rigid_body_fit import BLOCK_S, fit_body, number_of
from mazeplan.core.maths.angles import difference
from mazeplan.core.records import Array, IntArray
from mazeplan.diagnosis.rig.fitting import ENOUGH, NEEDED, NOISE, STEPS
from mazeplan.diagnosis.rig.search import SearchResult
from mazeplan.learning.rollout import STEPS as AHEAD
from mazeplan.maze.geometry import Maze

EVERY = 7  # pictures between the starts of roll-outs
STRETCH_S = 30.0  # s; the halves are every other stretch, so that both show what depends on the place
SHOWN = 3.0  # a half shows a number if its standard error is at most so many times that of the whole record
FEWEST = 40  # minimum number of roll-outs in a ring, for a mean error
BETTER = 2.0  # standard errors by which held-out blocks have to be likelier
LOSS = 0.1  # maximum loss of blocks, over the gain of the others
PARTS = 20  # of a record, whose roll-outs give the scatter of a difference
LOST = 0.5  # rad, mean error of roll-outs that have lost the ball: a further loss means nothing


@dataclass(frozen=True)
class HeldOut:
    """Predictions of held-out pictures."""

    starts: IntArray  # pictures (W,) from which roll-outs start
    before: Array  # errors (AHEAD, W) of the angle 1 to AHEAD samples ahead, rad, without what was found
    after: Array  # and with it
    gain: Array  # gain (B,) of -2 log L in blocks of BLOCK_S s
    plain: Array  # errors (AHEAD, W) with the new stage alone, rad
    # mean of the errors AHEAD samples ahead with what was found, and its standard error, rad, by ring
    by_ring: dict[int, tuple[float, float]] = field(default_factory=dict)

    @property
    def ahead(self) -> int:
        """Samples ahead at which errors decide: AHEAD, or half of it if the ball is lost by then, as in navigation, or
        if only the nearer roll-outs are as accurate as without what was found."""
        return next((ahead for ahead in self._horizons if self._not_worse(self.before, ahead)), self._horizons[0])

    @property
    def _horizons(self) -> tuple[int, ...]:
        lost = min(_mean(errors[-1]) for errors in (self.before, self.plain, self.after)) > LOST
        return (AHEAD // 2,) if lost else (AHEAD, AHEAD // 2)

    def ball_effects_not_worse(self, most: float = 1.0) -> bool:
        """Whether roll-outs with the effects of ball, table and camera are at least as accurate as without, within so
        many standard errors."""
        return any(self._not_worse(self.plain, ahead, most) for ahead in self._horizons)

    @property
    def better(self) -> bool:
        """Whether roll-outs with all effects, also of the stage, are at least as accurate as without."""
        return self._not_worse(self.before, self.ahead)

    def _not_worse(self, than: Array, ahead: int, most: float = 1.0) -> bool:
        """Whether errors so many samples ahead are not larger, within so many standard errors of the difference.

        After many impacts, every roll-out has lost the ball, and the mean says little of what acts between them."""
        more = (self.after - than)[ahead - 1]
        more = more[np.isfinite(more)]
        parts = [part.mean() for part in np.array_split(more, PARTS) if len(part)]
        spread = float(np.std(parts, ddof=1)) / math.sqrt(len(parts)) if len(parts) > 1 else 0.0
        return float(np.mean(more)) <= most * spread

    @property
    def z_score(self) -> float:
        """Standard errors by which blocks are likelier with what was found; inf if nothing was found."""
        if not np.any(self.gain):
            return math.inf
        spread = max(float(self.gain.std(ddof=1)) / math.sqrt(len(self.gain)), 1e-12)
        return float(self.gain.mean()) / spread

    @property
    def likelier(self) -> bool:
        """Whether blocks are likelier with what was found, beyond doubt: by BETTER standard errors, or by NEEDED in all
        blocks but the best one together, with hardly a loss. An effect at one place acts in a few blocks only, which
        differ from all others, so that standard errors are wide."""
        rest = np.sort(self.gain)[:-1]
        gained, lost = float(rest[rest > 0.0].sum()), float(-rest[rest < 0.0].sum())
        return self.z_score > BETTER or (gained - lost > NEEDED and lost < LOSS * gained)

    def evidence(self, dt: float) -> dict[str, Any]:
        """Errors by the time ahead for the pictures of a report, rad: their mean, and the range of four in five."""
        both = {"before": self.before, "after": self.after}

        def rounded(values: Array) -> list[float | None]:
            return [round(float(v), 5) if math.isfinite(v) else None for v in values]

        return {
            "ahead_s": (dt * np.arange(1, len(self.before) + 1)).round(4).tolist(),
            "error": {when: rounded(np.nanmean(errors, axis=1)) for when, errors in both.items()},
            "low": {when: rounded(np.nanquantile(errors, 0.1, axis=1)) for when, errors in both.items()},
            "high": {when: rounded(np.nanquantile(errors, 0.9, axis=1)) for when, errors in both.items()},
        }

    def errors(self, which: str) -> dict[str, float]:
        """Mean absolute errors of roll-outs for the JSON document, rad. which: before or after"""
        errors = getattr(self, which)
        return {f"rollout{ahead}": _mean(errors[ahead - 1]) for ahead in (AHEAD // 2, AHEAD)}


def held_out(body: BodyFilter, old: BodyFilter, was: BodyModel, searched: SearchResult, maze: Maze) -> HeldOut:
    """Predictions of a record without and with what was found.

    old: the filter with the plate moved by the old model's stage
    was: the old model"""
    n, plain = len(body.pictures), searched.without.filtered
    starts = starts_of(body, plain, maze)
    before = roll_out_errors(old, was._replace(wander=searched.without.model.wander), starts)
    gain, blocks = np.zeros(n), np.arange(0, n, round(BLOCK_S / body.pictures.dt))
    alone = roll_out_errors(body, searched.without.model, starts)
    if not searched.found:
        rings = errors_by_ring(body, plain, starts, alone, maze)
        return HeldOut(starts, before, alone, np.zeros(len(blocks)), alone, rings)
    after, rows = np.empty_like(before), min(round(STRETCH_S / body.pictures.dt), -(-n // 2))
    second = np.arange(n) // rows % 2 == 1
    for rows in (second, ~second):
        model = _by_rows(body, searched, ~rows)
        gain[rows] = (minus2_by_picture(plain) - minus2_by_picture(body.run(model)))[rows]
        after[:, rows[starts]] = roll_out_errors(body, model, starts[rows[starts]])
    rings = errors_by_ring(body, plain, starts, after, maze)
    return HeldOut(starts, before, after, np.add.reduceat(np.nan_to_num(gain), blocks), alone, rings)


def _by_rows(body: BodyFilter, searched: SearchResult, rows: np.ndarray) -> BodyModel:
    """The model with what was found, fitted to some pictures. Numbers that these hardly show stay as they are: a ball
    that met one end of a sector only says nothing of the other."""
    part, whole = body.part(rows), searched.fit
    names = tuple(dict.fromkeys([*NOISE, *(name for c in searched.candidates for name in c.fitted)]))
    here = fit_body(part, whole.model, names, steps=0).stderr
    shown = [n for n in names if here[n] < SHOWN * whole.stderr[n] < number_of(whole.model, n).high]
    return fit_body(part, whole.model, shown, STEPS, ENOUGH).model


def on_test(old: BodyFilter, was: BodyModel, new: BodyFilter, found: BodyModel, maze: Maze) -> HeldOut:
    """Predictions of a further record, all of it held out."""
    found = found._replace(wander=was.wander)
    before, after = old.run(was), new.run(found)
    starts = starts_of(new, after, maze)
    gain = np.nan_to_num(minus2_by_picture(before) - minus2_by_picture(after))
    blocks = np.arange(0, len(gain), round(BLOCK_S / new.pictures.dt))
    errors = (roll_out_errors(old, was, starts), roll_out_errors(new, found, starts))
    return HeldOut(starts, *errors, np.add.reduceat(gain, blocks), errors[0])


def starts_of(body: BodyFilter, filtered: Filtered, maze: Maze) -> IntArray:
    """Pictures from which roll-outs start: outside the central disc, with the next pictures in the same stretch."""
    n, begins = len(body.pictures), body.pictures.begins
    disc = max((ring.outer_radius for ring in maze.rings if ring.is_disc), default=0.0)
    begun = np.cumsum(begins)
    good = np.isfinite(filtered.nu[: n - AHEAD, 0]) & (begun[: n - AHEAD] == begun[AHEAD:])
    good &= np.min([np.hypot(*filtered.state[k : n - AHEAD + k, :2].T) for k in (0, AHEAD // 2, AHEAD)], axis=0) > disc
    return np.flatnonzero(good)[::EVERY]


def errors_by_ring(
    body: BodyFilter, filtered: Filtered, starts: IntArray, errors: Array, maze: Maze
) -> dict[int, tuple[float, float]]:
    """Mean of the last of the errors (AHEAD, W), and its standard error, by ring, for rings with FEWEST roll-outs.

    A ball that has left its ring by then does not count: whether it passes an opening depends on tenths of a mm."""
    r, then = (np.hypot(*filtered.state[rows, :2].T) for rows in (starts, starts + AHEAD))
    last = errors[-1]
    block = starts // round(BLOCK_S / body.pictures.dt)
    within = {ring.number: (ring.inner_radius, ring.outer_radius) for ring in maze.rings}
    here = {n: (np.minimum(r, then) > low) & (np.maximum(r, then) < high) for n, (low, high) in within.items()}
    here = {number: rows & np.isfinite(last) for number, rows in here.items()}
    return {number: _ring_error(last[rows], block[rows]) for number, rows in here.items() if rows.sum() >= FEWEST}


def _ring_error(errors: Array, block: IntArray) -> tuple[float, float]:
    """Mean and standard error of errors (M,). block: number (M,) of their blocks

    Errors of one block are not independent."""
    mean = float(errors.mean())
    sums = np.bincount(block, errors - mean)
    there = len(np.unique(block))
    if there < 2:
        return mean, math.inf
    return mean, math.sqrt(float(np.sum(sums**2)) * there / (there - 1.0)) / len(errors)


def minus2_by_picture(filtered: Filtered) -> Array:
    """nu' S^-1 nu + log det S of each picture, (N,)."""
    (a, b), (xx, yy, xy) = filtered.nu.T, filtered.S.T
    det = xx * yy - xy * xy
    return np.asarray(np.log(det) + (a * a * yy - 2.0 * a * b * xy + b * b * xx) / det)


def roll_out_errors(body: BodyFilter, model: BodyModel, starts: IntArray) -> Array:
    """Absolute errors (AHEAD, W) of the angle, rad, 1 to AHEAD samples after the pictures `starts` (W,).

    The plate moves as in the record. NaN where the ball was not seen."""
    states, y = body.run(model).state, body.pictures.y
    places = body.rolled_out(model, states, starts, AHEAD)[:, 1:]
    there = y[starts[:, None] + np.arange(1, AHEAD + 1)]
    error = difference(np.arctan2(places[..., 1], places[..., 0]), np.arctan2(there[..., 1], there[..., 0]))
    return np.abs(error).T


def _mean(errors: Array) -> float:
    return round(float(np.nanmean(errors)), 4) if np.isfinite(errors).any() else math.nan
