"""Compare kinds of ball models on measured data: the tables of the paper, for any logs.

For each ring:

    nRMSE of theta_dd on training and test rows
    mean absolute error of theta after 20 and 40 samples of roll-outs from causal estimates
    95 % intervals by block bootstrap

Models are trained on training rows only. The rate of theta (see `samples`) is chosen on these rows, too. A Gaussian
process predicts accelerations by its mean, because their errors are squared. Roll-outs use the fit with heavy tails
(see `fitting`), because their errors are absolute.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mazeplan.core.errors import InputError, TableError
from mazeplan.core.logs.table import Table
from mazeplan.core.progress import Advance, Words, led_by, no_advance, no_words, piece
from mazeplan.core.records import Array, IntArray
from mazeplan.learning.camera_center import Centre, find_centre, smoothing_of, straightened
from mazeplan.learning.features import paper_features
from mazeplan.learning.fitting import FitOptions, fit_discrete, fit_kind, fit_linear, roll_out_discrete
from mazeplan.learning.gp_training import TrainingOptions
from mazeplan.learning.rollout import (
    CHECKED,
    Accelerate,
    Rollout,
    Windows,
    angle_noise,
    causal_start,
    choose_windows,
    roll_out,
    roll_out_delayed,
)
from mazeplan.learning.samples import RingSamples, SampleOptions, joined_samples, orientation, oriented, rings_wanted
from mazeplan.learning.smoothing import Smoothing
from mazeplan.learning.split import Split, block_bootstrap, block_split, uniform_downsample
from mazeplan.maze.geometry import Maze

PREDICTED = ("rf", "p", "pi", "np", "sp")  # default
ROLLED = ("pi", "np", "npd", "sp")  # kinds with roll-outs
MISFIT = 0.5  # error of the model over the spread of theta_dd, as assumed by the filter before a roll-out
# With fewer rows, their choice matters. On measured data the exponential kernel predicted other blocks better, although
# the likelihood of the training rows often prefers the smooth one.
THOROUGH = TrainingOptions(first=900, rows=2000, starts=2, refinement=40, family="exponential")
COST = {"rf": 0.5, "p": 0.1, "pi": 0.1, "np": 6.0, "sp": 6.0, "roll": 0.5}  # relative duration
BLOCK_S = 5.0  # s; every fourth block is test, and smoothing and the delayed rate reach 7 samples across a border
SPLIT: dict[str, Any] = {"block_s": BLOCK_S, "test_share": 0.25, "guard": 8}
LONGEST_LAG = 5.0  # samples
MIN_TRAINED = 50  # training rows; a ring with fewer is left out
CLEAN = 0.1  # noise of a difference of angles over the spread of rates; below this, delayed rates are used


@dataclass(frozen=True)
class CompareOptions:
    """Settings of a comparison.

    smoothing:  of positions, if the table contains no derivatives
    delay:      delay of the ball behind the tilt, s; None: estimated by `best_lag`
    samples:    settings of the samples
    rates:      rates of the samples; "auto": chosen by the noise of the angle
    fit:        settings of the fits
    kinds:      names in `fitting.KINDS`"""

    smoothing: Smoothing = field(default_factory=lambda: Smoothing(window=9))
    delay: float | None = None
    samples: SampleOptions = field(default_factory=SampleOptions)
    rates: str = "auto"
    fit: FitOptions = field(default_factory=lambda: FitOptions(training=THOROUGH))
    kinds: tuple[str, ...] = PREDICTED


@dataclass(frozen=True)
class RingData:
    """Training and test samples of one ring (the same samples if a record is split), with the rows of each set.

    centre:  of the rings, if the camera counts the angle about another point; models are then fitted in the true angle
    seen:    with a centre, the training and test samples as measured, for the scores"""

    train: RingSamples
    test: RingSamples
    train_rows: IntArray
    test_mask: np.ndarray
    block: IntArray
    centre: Centre | None = None
    seen: tuple[RingSamples, RingSamples] | None = None

    def pairs(self, mean: Accelerate, rows: IntArray, train: bool = False) -> tuple[Array, Array]:
        """theta_dd in some rows, measured and predicted."""
        samples = self.train if train else self.test
        truth, predicted = samples.theta_ddot[rows], mean(samples.at(rows))
        if self.centre is None or self.seen is None:
            return truth, predicted
        seen = self.seen[0 if train else 1]
        measured = seen.theta_ddot[rows]
        return measured, measured + (predicted - truth) / self.centre.slope(seen.k.theta[rows])

    @property
    def test_rows(self) -> IntArray:
        """Rows that are scored."""
        return np.flatnonzero(self.test_mask & self.test.good)


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
) -> dict[int, dict[str, Any]]:
    """Scores of each ring with enough samples in the logs (and in the test logs, if there are any), as JSON has them.

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
    train, test = (joined_samples(tables, maze, options.smoothing, chosen) for tables in (logs, tests))
    signs = orientation(train)
    scores: dict[int, dict[str, Any]] = {}
    short = ""
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
        found = {"rates": rates, "delay_s": delay, "signs": dict(zip(("beta", "gamma"), signs, strict=True))}
        scores[ring] = _rounded(score(ring, data, options, rates, angles, words, share) | found)
    if not scores:
        raise InputError(f"no ring has samples both to train and to test on{short}")
    return scores


def _with_ring(tables: Sequence[Table], maze: Maze, options: SampleOptions, left_out: Words) -> list[Table]:
    """The tables that have rows of `options.ring`; all, if that is None. Raises InputError if there are none."""
    kept, without = [], []
    for table in tables:
        if options.ring is None or (np.isfinite(table["theta"]) & (rings_wanted(table, maze, options) > 0)).any():
            kept.append(table)
        else:
            without.append(f"{table.source.get('file', 'a table')} has no row of ring {options.ring}")
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
        for part in joined_samples(logs, maze, Smoothing(), samples).values():
            try:
                rows = np.flatnonzero(block_split(part.segment, part.dt, **SPLIT).train & part.good)
            except TableError:  # the ball only passed through
                continue
            if len(rows) > MIN_TRAINED:
                k, target = part.at(rows), part.theta_ddot[rows]
                error = paper_features(k) @ fit_linear(paper_features(k), target) - target
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
    smoothed = replace(options.samples, rates="smoothed")
    for samples in joined_samples(logs, maze, options.smoothing, smoothed).values():
        if not samples.good.any():
            continue
        spread = max(float(np.std(samples.k.theta_dot[samples.good])), 1e-9)  # 0 for a ball at rest
        worst = max(worst, math.sqrt(2.0) * angle_noise(samples) / samples.dt / spread)
    return "delayed" if worst < CLEAN else "smoothed"


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
    if len(rows) < MIN_TRAINED or not held:
        raise TableError(f"got {len(rows)} rows to train and {held} to test on, expected at least {MIN_TRAINED} and 1")
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


def score(
    ring: int, data: RingData, options: CompareOptions, rates: str, openings: Array | None, progress: Words,
    advance: Advance,
) -> dict[str, Any]:  # fmt: skip
    """Fit each kind of model and score it. openings: angles of the openings, rad, if known.

    In the result, `rollout` has mean absolute errors of theta, rad, by kind and sample; `interval95` the intervals of
    all scores; `blocks` the numbers of blocks of time with test rows, and with windows."""
    rng = np.random.default_rng([options.fit.seed, ring])
    windows = choose_windows(data.test, data.test_mask, openings)
    train_rows = data.train_rows[uniform_downsample(len(data.train_rows), options.fit.most)]
    at = data.test_rows
    nrmse_train, nrmse_test, models = {}, {}, {}
    interval: dict[str, dict[str, tuple[float, float]]] = {"nrmse_test": {}, "20": {}, "40": {}}
    fits = sum(COST[kind] for kind in options.kinds)
    done, whole = 0.0, fits + COST["roll"] * len(ROLLED)
    for kind in options.kinds:
        progress(kind)
        words, share = led_by(f"{kind}, ", progress), piece(advance, done, COST[kind], whole)
        models[kind] = fit_kind(kind, data.train, train_rows, options.fit, progress=words, advance=share)
        done += COST[kind]
        advance(done, whole)
        nrmse_train[kind] = nrmse(*data.pairs(models[kind].mean, train_rows, train=True))
        pairs = np.stack(data.pairs(models[kind].mean, at), axis=1)
        nrmse_test[kind] = nrmse(*pairs.T)
        interval["nrmse_test"][kind] = block_bootstrap(pairs, data.block[at], lambda p: nrmse(p[:, 0], p[:, 1]), rng)
    misfit = MISFIT * float(np.std(data.train.theta_ddot[train_rows]))
    rollout: dict[str, dict[str, float]] = {}
    for kind in ROLLED:
        progress(f"rolling out {kind}")
        fitted = models.get("np" if kind == "npd" else kind)  # npd goes with np
        if fitted is not None and len(windows):
            rolled = _roll(kind, fitted.typical, data, windows, misfit, rates, train_rows, options.fit)
            rollout[kind] = {str(n): rolled.after(n) for n in CHECKED}
            for n in CHECKED:
                blocks = data.block[windows.start]
                interval[str(n)][kind] = block_bootstrap(rolled.error[:, n], blocks, lambda e: float(np.mean(e)), rng)
        done += COST["roll"]
        advance(done, whole)
    blocks = {name: len(np.unique(data.block[rows])) for name, rows in (("test", at), ("windows", windows.start))}
    off = (0.0, 0.0) if data.centre is None else (data.centre.x, data.centre.y)
    return {
        "n_train": len(train_rows), "n_test": len(at), "windows": len(windows), "windows_chosen": windows.chosen,
        "blocks": blocks, "centre_m": [part * data.test.k.radius for part in off],
        "nrmse_train": nrmse_train, "nrmse_test": nrmse_test, "rollout": rollout, "interval95": interval,
    }  # fmt: skip


def _roll(
    kind: str, mean: Accelerate, data: RingData, windows: Windows, misfit: float, rates: str, rows: IntArray,
    options: FitOptions,
) -> Rollout:  # fmt: skip
    """The roll-out of a kind; misfit: see `causal_start`; rows: training rows, for npd."""
    start = windows.start
    theta, rate = causal_start(mean, data.test, start, angle_noise(data.train), misfit)
    if kind == "npd":
        done = roll_out_discrete(fit_discrete(data.train, rows, options), data.test, start, theta, rate)
    else:
        rolled = roll_out_delayed if rates == "delayed" else roll_out
        done = rolled(mean, data.test, start, theta, rate)
    if data.centre is None or data.seen is None:
        return done
    return Rollout.against(data.centre.seen(done.angle), data.seen[1].k.theta, start)


def nrmse(truth: Array, predicted: Array) -> float:
    """Root mean square error over the standard deviation of the truth; NaN for no rows or a constant truth."""
    spread = float(np.std(truth)) if len(truth) else 0.0
    return float(np.sqrt(np.mean((truth - predicted) ** 2)) / spread) if spread > 0.0 else math.nan


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(part) for part in value]
    return round(value, 4) if isinstance(value, float) and math.isfinite(value) else value
