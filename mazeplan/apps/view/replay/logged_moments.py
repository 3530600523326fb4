"""Moments of a log, made when they are needed.

A log of up to WHOLE ticks is read as one block. A longer log is read in blocks of BLOCK ticks. Each block is read with
LEAD ticks before it, which fill the curves of its first moments. Older messages that still count (tree, failures, goal,
closed openings, tries) come from the whole log. The errors of plans in a block use only the ticks that were read.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from typing import overload

import numpy as np

from mazeplan.apps.view.moment import COLUMN, COLUMNS, Moment
from mazeplan.apps.view.story import Story, moments_from
from mazeplan.core.logs.chunks import Document
from mazeplan.core.logs.log_index import LogIndex
from mazeplan.core.logs.run_log_reader import checked_fields
from mazeplan.core.records import Array

WHOLE = 5400  # ticks: 3 minutes at 30 Hz
BLOCK, LEAD = 450, 900
KEPT = 8  # blocks that stay in memory
NEWEST = ("/status", "/openings")  # each message replaces the one before


class LoggedMoments(Sequence[Moment]):
    """One moment for each tick. Raises LogError for a damaged message, and for a file that was changed meanwhile.

    whole: whether all moments are read at once"""

    def __init__(self, index: LogIndex) -> None:
        self._index, self._count = index, len(index.times)
        self.whole = self._count <= WHOLE
        self._size = max(self._count, 1) if self.whole else BLOCK
        self._blocks: dict[int, tuple[list[Moment], Array]] = {}  # in the order of use, the latest last

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> Moment: ...
    @overload
    def __getitem__(self, index: slice) -> list[Moment]: ...
    def __getitem__(self, index: int | slice) -> Moment | list[Moment]:
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(self._count))]
        k = index + self._count if index < 0 else index
        if not 0 <= k < self._count:
            raise IndexError(index)
        return self._block(k // self._size)[0][k % self._size]

    def rows(self, first: int, end: int) -> Array:
        """The newest row of each moment from `first` up to `end`, (end - first, len(COLUMNS)); theta is continuous."""
        if first >= end:
            return np.empty((0, len(COLUMNS)))
        blocks = range(first // self._size, (end - 1) // self._size + 1)
        rows = np.vstack([self._block(block)[1] for block in blocks])
        begin = first - blocks[0] * self._size
        rows = rows[begin : begin + end - first]
        rows[:, [COLUMN["theta"], COLUMN["planned_theta"]]] -= turns(rows[:, COLUMN["theta"]])[:, None]
        return rows

    def _block(self, block: int) -> tuple[list[Moment], Array]:
        found = self._blocks.pop(block, None)
        if found is None:
            moments = self._read(block * self._size, min((block + 1) * self._size, self._count))
            unknown = np.full(len(COLUMNS), np.nan)
            found = moments, np.array([m.rows[-1] if len(m.rows) else unknown for m in moments])
        self._blocks[block] = found
        if len(self._blocks) > KEPT:
            del self._blocks[next(iter(self._blocks))]
        return found

    def _read(self, first: int, end: int) -> list[Moment]:
        index, story = self._index, Story()
        chunk = index.chunk_of(max(0, first - LEAD)) if first else 0
        with checked_fields(index.path):
            for topic, document in self._before(chunk):
                story.take(topic, document)
            story.ticks = index.ticks_before(chunk)
            return list(islice(moments_from(story, index.messages(chunk), first), end - first))

    def _before(self, chunk: int) -> Iterator[Document]:
        """The messages of earlier chunks that still count."""
        earlier = [document for number, document in self._index.rare if number < chunk]
        newest = {topic: i for i, (topic, _) in enumerate(earlier)}
        return (message for i, message in enumerate(earlier) if message[0] not in NEWEST or i == newest[message[0]])


def turns(theta: Array) -> Array:
    """The whole turns to subtract from an angle so that it does not jump, rad, (N,); also across gaps of NaN."""
    off, known = np.zeros(len(theta)), np.flatnonzero(np.isfinite(theta))
    steps = np.round(np.diff(theta[known]) / (2.0 * np.pi))
    off[known[1:]] = 2.0 * np.pi * steps
    return np.cumsum(off)
