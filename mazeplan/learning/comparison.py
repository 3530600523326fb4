"""Compare kinds of ball models on measured data: the tables of the paper, for any logs.

For each ring:

    nRMSE of theta_dd on training and test rows
    mean absolute error of theta after 20 and 40 samples of roll-outs from causal estimates
    95 % intervals by block bootstrap

Models are trained on training rows only. The rate of theta (see `samples`) is chosen on these rows, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mazeplan.core.errors import InputError, TableError
from mazeplan.core.logs.table import Table
from mazeplan.core.progress import Advance, Words, led_by, no_advance, no_words, piece
from mazeplan.learning.camera_center import find_centre, smoothing_of, straightened
from mazeplan.learning.features import paper_features
from mazeplan.learning.linear import fit_linear
from mazeplan.learning.ring_scores import CompareOptions, RingData, RingScores, score
from mazeplan.learning.rollout import angle_noise
from mazeplan.learning.samples import (
    RingSamples,
    SampleOptions,
    joined,
    orientation,
    oriented,
    ring_samples,
    rings_of,
    rings_wanted,
)
from mazeplan.learning.smoothing import Smoothing
from mazeplan.learning.split import Split, block_split
from mazeplan.maze.geometry import Maze

BLOCK_S = 5.0  # s; every fourth block is test, and smoothing and the delayed rate reach 7 samples across a border
SPLIT: dict[str, Any] = {"block_s": BLOCK_S, "test_share": 0.25, "guard": 8}
LONGEST_LAG = 5.0  # samples
FEWEST = 50  # training rows; a ring with fewer is left out
CLEAN = 0.1  # noise of a difference of angles over the spread of rates; below this, delayed rates are used


def compare(
    logs: Sequence[Table],
    tests: Sequence[Table],
    maze: Maze,
    options: CompareOptions | None = None,
    *,
    openings_known: bool = False,
    progress: Words = no_words,
    advance: Advance = no_advance,
    left_out: Words = no_words,
) -> list[RingScores]:
    """Scores of each ring with enough samples in the logs (and in the test logs, if there are any).

    openings_known:  whether the maze has the openings of the rig
    progress:        receives each step in words
    advance:         receives the share done
    left_out:        receives a sentence for each table or ring that is left out

    Raises InputError if no ring remains."""
    options = options or CompareOptions()
    logs, tests = (_with_ring(tables, maze, options.samples, left_out) for tables in (logs, tests))
    delay = options.delay if options.delay is not None else best_lag(logs, maze, options)
    options = replace(options, samples=replace(options.samples, delay=delay))
    rates = options.rates if options.rates != "auto" else _rates(logs, maze, options)
    chosen = replace(options.samples, rates=rates)
    options = replace(options, fit=replace(options.fit, inputs="local", heavy_tails=True))  # the best predictor
    train, test = (by_ring(tables, maze, options, chosen) for tables in (logs, tests))
    signs = orientation(train)
    scores, short = [], ""
    for i, ring in enumerate(sorted(train)):
        share = piece(advance, i, 1, len(train))
        if tests and ring not in test:
            continue
        samples = oriented(train[ring], signs)
        try:
            other = oriented(test[ring], signs) if tests else None
            data = prepare(samples, other, replace(options, samples=chosen))
        except TableError as problem:  # the ball only passed through
            short = f"; ring {ring}: {problem}"
            left_out(f"ring {ring} is left out: {problem}")
            continue
        angles = np.array([o.angle for o in maze.openings_of(ring)]) if openings_known else None
        words = led_by(f"ring {ring}: ", progress)
        scores.append(score(ring, data, options, rates, signs, angles, words, share))
    if not scores:
        raise InputError(f"no ring has samples both to train and to test on{short}")
    return scores


def _with_ring(tables: Sequence[Table], maze: Maze, options: SampleOptions, left_out: Words) -> Sequence[Table]:
    """The tables that have rows of `options.ring`; all, if that is None. Raises InputError if there are none."""
    if options.ring is None:
        return tables
    kept, without = [], []
    for table in tables:
        seen = np.isfinite(table["theta"])
        if (seen & (rings_wanted(table, maze, options) > 0)).any():
            kept.append(table)
            continue
        there = np.unique(rings_of(table, maze)[seen])
        others = ", ".join(f"{ring:.0f}" for ring in there[there > 0]) or "none"
        without.append(f"{table.source.get('file', 'a table')} has no row of ring {options.ring}, but of {others}")
    if tables and not kept:
        raise InputError("; ".join(without))
    for text in without:
        left_out(f"left out: {text}")
    return kept


def best_lag(logs: Sequence[Table], maze: Maze, options: CompareOptions) -> float:
    """Delay of the ball behind the tilt, s: the lag with the smallest residual of the linear model in training rows.

    It is 0 for tables that contain derivatives, because their signals are aligned already."""
    if any("theta_ddot" in table for table in logs) and not options.samples.recompute:
        return 0.0
    dt, lags = logs[0].dt, np.arange(0.0, LONGEST_LAG + 0.25, 0.5)
    left = []
    for lag in lags:
        samples = replace(options.samples, delay=float(lag * dt), rates="smoothed")
        rest = 0.0
        for part in by_ring(logs, maze, replace(options, smoothing=Smoothing()), samples).values():
            try:
                rows = np.flatnonzero(block_split(part.segment, part.dt, **SPLIT).train & part.good)
            except TableError:  # the ball only passed through
                continue
            if len(rows) > FEWEST:
                k, target = part.at(rows), part.theta_ddot[rows]
                error = fit_linear(paper_features(k), target).mean(paper_features(k)) - target
                rest += float(np.sum((np.clip(error, *np.quantile(error, [0.02, 0.98])) * k.radius) ** 2))
        left.append(rest)
    if not any(left):
        return 0.0
    i = int(np.clip(np.argmin(left), 1, len(lags) - 2))
    below, here, above = left[i - 1 : i + 2]
    bend = below - 2.0 * here + above
    shift = 0.5 * (below - above) / bend if bend > 0.0 else 0.0
    return float(max(0.0, lags[i] + 0.5 * np.clip(shift, -1.0, 1.0)) * dt)


def _rates(logs: Sequence[Table], maze: Maze, options: CompareOptions) -> str:
    """`delayed` if the angle is clean enough for differences, else `smoothed`."""
    worst = 0.0
    for samples in by_ring(logs, maze, options, replace(options.samples, rates="smoothed")).values():
        if not samples.good.any():
            continue
        spread = max(float(np.std(samples.k.theta_dot[samples.good])), 1e-9)  # 0 for a ball at rest
        worst = max(worst, math.sqrt(2.0) * angle_noise(samples) / samples.dt / spread)
    return "delayed" if worst < CLEAN else "smoothed"


def by_ring(
    tables: Sequence[Table], maze: Maze, options: CompareOptions, samples: SampleOptions
) -> dict[int, RingSamples]:
    """Samples of all tables by ring, one table after the other."""
    found: dict[int, list[RingSamples]] = {}
    for table in tables:
        for ring, part in ring_samples(table, maze, options.smoothing, samples).items():
            found.setdefault(ring, []).append(part)
    return {ring: joined(parts) for ring, parts in found.items()}


def prepare(train: RingSamples, test: RingSamples | None, options: CompareOptions) -> RingData:
    """Rows to train and to test on. Raises TableError if there are too few."""
    other = test if test is not None else train
    if test is None:
        split = block_split(train.segment, train.dt, **SPLIT)
    else:
        block = np.arange(len(test)) // max(1, round(BLOCK_S / test.dt))
        split = Split(np.ones(len(train), bool), np.ones(len(test), bool), block)
    rows = np.flatnonzero(split.train & train.good)
    held = int(np.sum(split.test & other.good))
    if len(rows) < FEWEST or not held:
        raise TableError(f"got {len(rows)} rows to train and {held} to test on, expected at least {FEWEST} and 1")
    data = RingData(train, other, rows, split.test, split.block)
    smoothing = smoothing_of(train, rows, options.smoothing)
    centre = None if smoothing is None else find_centre(train, rows, smoothing)
    if smoothing is None or centre is None:
        return data
    rates = options.samples.rates
    moved = straightened(train, centre, rates, smoothing)
    there = moved if test is None else straightened(other, centre, rates, smoothing)
    good = np.flatnonzero(split.train & moved.good)
    return replace(data, train=moved, test=there, train_rows=good, centre=centre, seen=(train, other))
