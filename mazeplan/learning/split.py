"""Rows for training and for testing, by blocks in time, and intervals by block bootstrap.

Neighbouring rows of a record are nearly equal: a random test row would have its twins among the training rows. So whole
blocks are test rows. Rows near a border belong to neither set, since smoothing mixes them with the other. For the same
reason the interval of a score comes from drawing whole blocks (after Kuensch, 1989).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mazeplan.core.errors import TableError
from mazeplan.core.records import Array, IntArray

DRAWS = 1000  # of a bootstrap: the ends of a 95 % interval are then within about 2 % of its width
LEVEL = 0.95  # probability of an interval
WINDOWS = 10  # minimum number of windows for a share, which has steps of 1 / windows
BLOCKS = 5  # minimum number of blocks for an interval: 5 give 126 different draws, 4 only 35
TOO_FEW = "too few"


@dataclass(frozen=True)
class Split:
    """A split of N rows.

    train, test (N,):  whether a row is for training, or for testing; never both
    block (N,):        number of the block of each row"""

    train: np.ndarray
    test: np.ndarray
    block: IntArray


def block_split(
    segment: Array | IntArray, dt: float, *, block_s: float = 10.0, test_share: float = 0.3, guard: int = 3
) -> Split:
    """Train and test rows by blocks of about `block_s` seconds; deterministic.

    segment:     segment number of each row (N,), in order of time
    dt:          s from row to row
    test_share:  share of the test blocks, in (0, 1)
    guard:       rows on either side of a border within a segment that belong to neither set; use (window - 1) / 2 of
                 a smoothing

    Test blocks are all over the record; the first block is train. A record with fewer than two test blocks gets shorter
    blocks. Raises TableError if no row is left to train or to test on.
    """
    n = len(segment)
    every = math.ceil(1.0 / test_share)
    length = max(1, min(round(block_s / dt), n // (2 * every)))
    block = np.arange(n) // length
    # a block is test when test_share times the number of blocks so far passes a whole number (1e-9: rounding)
    wanted = np.floor((block + 1) * test_share + 1e-9) - np.floor(block * test_share + 1e-9) > 0.5
    kept = ~near_border(wanted, segment, guard)
    split = Split(kept & ~wanted, kept & wanted, block.astype(np.int64))
    for name, mask in (("train", split.train), ("test", split.test)):
        if not mask.any():
            raise TableError(f"got {n} rows ({n * dt:.3g} s): too short, none is left to {name} on")
    return split


def near_border(wanted: np.ndarray, segment: Array | IntArray, guard: int) -> np.ndarray:
    """Rows (N,) that have a row of the other set within `guard` rows, in the same segment."""
    borders = np.flatnonzero((np.diff(wanted) != 0) & (np.diff(segment) == 0.0)) + 1
    number = np.cumsum(np.diff(segment, prepend=segment[:1]) != 0.0)
    near = np.zeros(len(wanted), dtype=bool)
    for border in borders.tolist():
        span = slice(max(border - guard, 0), border + guard)
        near[span] |= number[span] == number[border]
    return near


def uniform_downsample(n: int, most: int) -> IntArray:
    """Indices of at most `most` of n rows, evenly spread in time, growing."""
    if n <= most:
        return np.arange(n, dtype=np.int64)
    return (2 * np.arange(most, dtype=np.int64) + 1) * n // (2 * most)


def block_bootstrap(
    values: Array, blocks: IntArray, statistic: Callable[[Array], float], rng: np.random.Generator, draws: int = DRAWS
) -> tuple[float, float]:
    """(low, high): 95 % interval of `statistic`, drawing whole blocks with replacement.

    values:    (N,) or (N, k), one row for each observation
    blocks:    (N,) number of the block of each row
    statistic: function of an array like values

    With fewer than some 20 blocks, or blocks shorter than the memory of the record, the interval is too narrow.
    (nan, nan) with fewer than two blocks.
    """
    order = np.argsort(blocks, kind="stable")
    borders = np.flatnonzero(np.diff(blocks[order])) + 1
    members = np.split(order, borders)
    if len(members) < 2:
        return math.nan, math.nan
    drawn = rng.integers(0, len(members), (draws, len(members)))
    found = np.array([float(statistic(values[np.concatenate([members[i] for i in row])])) for row in drawn])
    low, high = np.quantile(found, [0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL])
    return float(low), float(high)


def enough(windows: int | None = None, blocks: int | None = None) -> bool:
    """Whether windows and blocks of time suffice for the uncertainty of a score; None: unknown, or not needed."""
    return (windows is None or windows >= WINDOWS) and (blocks is None or blocks >= BLOCKS)
