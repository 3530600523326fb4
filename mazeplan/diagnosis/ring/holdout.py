"""Which rows search and fits see, and which are held out for the scores."""

from __future__ import annotations

import numpy as np

from mazeplan.diagnosis.record import RingRecord
from mazeplan.learning.split import block_split, near_border

SEEN = 0.7  # share of the record that search and fits see
BLOCK_S = 10.0  # s
GUARD = 8  # rows at a border that belong to neither set: windows of derivatives and states of the filter reach across
INNER_S, INNER = 5.0, 4  # s, of an inner block; blocks in a group
Folds = list[tuple[np.ndarray, np.ndarray]]  # pairs of training rows and test rows (N,)
LONGEST = 0.5  # share of the record; with a longer stretch, the record counts as one piece


def seen_and_held(record: RingRecord) -> tuple[np.ndarray, np.ndarray, str]:
    """Seen rows and held-out rows (N,), and the held-out rows in words.

    The last part of an uninterrupted record is held out, because a model has to predict what comes later. A record in
    many pieces has no such order, so blocks all over the record are held out."""
    known = np.isfinite(record.theta)
    lengths = np.diff(np.append(np.flatnonzero(record.begins), len(record)))
    if record.u is None and lengths.max() < LONGEST * len(record):
        split = block_split(record.segment, record.dt, block_s=BLOCK_S, test_share=1.0 - SEEN, guard=GUARD)
        return split.train, split.test, f"blocks of {BLOCK_S:g} s all over the record"
    seen = np.cumsum(known)  # samples of the ball: it may be elsewhere for most of the record
    rows = seen <= SEEN * seen[-1]
    return rows, ~rows, f"the last {1.0 - SEEN:.0%} of the record"


def inner_folds(record: RingRecord, seen: np.ndarray) -> Folds:
    """Folds among the seen rows: each block of a group of INNER is tested in one of them."""
    block, folds = np.arange(len(record)) // max(round(INNER_S / record.dt), 1), []
    for which in range(INNER):
        tried = block % INNER == which
        kept = seen & ~near_border(tried, record.segment.astype(np.float64), GUARD)
        folds.append((kept & ~tried, kept & tried))
    return folds
