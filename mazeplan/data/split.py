"""Rows for training and for testing, by blocks in time, and intervals by resampling blocks.

Neighbouring rows of a record are nearly the same row: drawn at random, each test row has its twins among the training
rows. So whole blocks are test rows, and rows near a border belong to neither set: smoothing mixes them with the other.
For the same reason an interval of a score comes from drawing whole blocks (a block bootstrap, after Kuensch 1989), not
rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mazeplan.errors import SettingsError, TableError
from mazeplan.records import Array, IntArray

DRAWS = 1000  # of a bootstrap: the ends of a 95 % interval are then within about 2 % of its width


@dataclass(frozen=True)
class Split:
    """Which rows are for what: train, test (N,) bool, never both; block (N,) number of the block of each row."""

    train: np.ndarray
    test: np.ndarray
    block: IntArray


def block_split(
    rows: int | Array | IntArray,
    dt: float,
    *,
    block_s: float = 10.0,
    test_share: float = 0.3,
    guard: int = 3,
    mode: Literal["interleaved", "tail"] = "interleaved",
) -> Split:
    """Train and test rows, by blocks of about `block_s` seconds. The same every time: nothing is drawn.

    rows:        number of rows, or the segment number of each row (N,); rows in order of time
    dt:          s from row to row
    test_share:  share of the blocks that are test, in (0, 1)
    guard:       rows on either side of a border between train and test that belong to neither; (window - 1) / 2 of a
                 smoothing keeps each set from being mixed with the other. Where a segment begins nothing is mixed
    mode:        interleaved: test blocks all over the record, every third of them for a share of 1/3, the first block
                 being train; tail: the last share of the rows

    A record with fewer than two test blocks gets shorter blocks. Raises SettingsError for the settings, TableError
    when nothing is left to train or to test on.
    """
    for name, value, good, allowed in (
        ("dt", dt, 0.0 < dt < math.inf, "a number > 0"),
        ("block_s", block_s, 0.0 < block_s < math.inf, "a number > 0"),
        ("test_share", test_share, 0.0 < test_share < 1.0, "a number between 0 and 1"),
        ("guard", guard, isinstance(guard, int) and guard >= 0, "a whole number >= 0"),
        ("mode", mode, mode in ("interleaved", "tail"), "interleaved or tail"),
    ):
        if not good:
            raise SettingsError(f"got {value!r}, expected {allowed}", key=name)
    segment = np.zeros(rows) if isinstance(rows, int) else np.asarray(rows, dtype=np.float64)
    n = len(segment)
    every = math.ceil(1.0 / test_share)
    length = max(1, min(round(block_s / dt), n // (2 * every)))
    block = np.arange(n) // length
    if mode == "tail":
        wanted = np.arange(n) >= n - round(test_share * n)
    else:  # test whenever the share of the blocks so far gets one more whole block; the nudge is for .1 + .1 + .1
        due = np.floor((block + 1) * test_share + 1e-9) - np.floor(block * test_share + 1e-9)
        wanted = due > 0.5
    kept = ~near_border(wanted, segment, guard)
    split = Split(kept & ~wanted, kept & wanted, block.astype(np.int64))
    for name, mask in (("train", split.train), ("test", split.test)):
        if not mask.any():
            raise TableError(f"got {n} rows ({n * dt:.3g} s): too short, none is left to {name} on")
    return split


def near_border(wanted: np.ndarray, segment: Array, guard: int) -> np.ndarray:
    """Rows (N,) with a row of the other set within `guard` rows in their own segment."""
    borders = np.flatnonzero((np.diff(wanted) != 0) & (np.diff(segment) == 0.0)) + 1
    number = np.cumsum(np.diff(segment, prepend=segment[:1]) != 0.0)
    near = np.zeros(len(wanted), dtype=bool)
    for border in borders.tolist():
        span = slice(max(border - guard, 0), border + guard)
        near[span] |= number[span] == number[border]
    return near


def uniform_downsample(n: int, most: int) -> IntArray:
    """Indices of at most `most` of n rows, evenly spread in time, growing. Raises SettingsError when most < 1."""
    if not most >= 1:
        raise SettingsError(f"got {most!r}, expected a whole number >= 1", key="most")
    if n <= most:
        return np.arange(n, dtype=np.int64)
    return (2 * np.arange(most, dtype=np.int64) + 1) * n // (2 * most)


def block_bootstrap(
    values: Array,
    blocks: IntArray,
    statistic: Callable[[Array], float],
    rng: np.random.Generator,
    draws: int = DRAWS,
    *,
    level: float = 0.95,
) -> tuple[float, float]:
    """(low, high) of the interval that holds `statistic` with probability `level`, drawing whole blocks.

    values:    (N,) or (N, k), a row each; blocks: (N,) number of the block of each row
    statistic: of such an array of values, whole blocks of it drawn with replacement

    Blocks should be much longer than the memory of the record and many (some 20); the interval is somewhat too narrow
    otherwise. (nan, nan) with fewer than two blocks: one block tells nothing of their spread.
    """
    values, blocks = np.asarray(values), np.asarray(blocks)
    if len(values) != len(blocks):
        raise ValueError(f"got {len(values)} values and {len(blocks)} blocks, expected as many")
    order = np.argsort(blocks, kind="stable")
    borders = np.flatnonzero(np.diff(blocks[order])) + 1
    members = np.split(order, borders)
    if len(members) < 2:
        return math.nan, math.nan
    drawn = rng.integers(0, len(members), (draws, len(members)))
    found = np.array([float(statistic(values[np.concatenate([members[i] for i in row])])) for row in drawn])
    low, high = np.quantile(found, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
    return float(low), float(high)
