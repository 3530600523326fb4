"""Index of a long log: ticks and plans stay in the file until someone asks for them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.core.logs.chunks import Chunks, Document
from mazeplan.core.logs.run_log_reader import LogChunks, header_of
from mazeplan.core.records import Array

OFTEN = ("/tick", "/plan")  # topics that stay in the file; they are nine tenths of a log


@dataclass(frozen=True)
class LogIndex:
    """What a log holds.

    path:     of the file
    header:   facts about the run
    rare:     every message whose topic is not in OFTEN, with the number of its chunk
    times:    log times of the ticks, (N,), s
    complete: whether the file was finished
    """

    path: Path
    header: dict[str, Any]
    rare: Sequence[tuple[int, Document]]
    times: Array
    complete: bool
    _chunks: Chunks = field(repr=False)
    _places: Sequence[int] = field(repr=False)
    _ticks_before: Sequence[int] = field(repr=False)  # (chunks + 1,)

    def chunk_of(self, tick: int) -> int:
        """The chunk that holds a tick, numbered from 0."""
        return int(np.searchsorted(self._ticks_before, tick, side="right")) - 1

    def ticks_before(self, chunk: int) -> int:
        """How many ticks earlier chunks hold."""
        return self._ticks_before[chunk]

    def messages(self, chunk: int) -> Iterator[Document]:
        """All messages from a chunk on. Raises LogError for a file that was changed meanwhile."""
        for place in self._places[chunk:]:
            yield from self._chunks.documents(self._chunks.at(place))


def index_log(path: Path) -> LogIndex:
    """Index a log, also a log that was cut. Raises LogError when the file is missing, damaged, or not a run log of
    mazeplan."""
    chunks, rare = LogChunks(path), list[tuple[int, Document]]()
    places, ticks, times = list[int](), list[int](), list[int]()
    for place, found in chunks:
        seldom = chunks.documents([message for message in found if message.topic not in OFTEN])
        rare += ((len(places), document) for document in seldom)
        now = [message.ns for message in found if message.topic == "/tick"]
        places.append(place)
        ticks.append(len(now))
        times += now
    header = header_of([document for _, document in rare], path)
    before = list(accumulate(ticks, initial=0))
    return LogIndex(path, header, rare, 1e-9 * np.array(times, dtype=float), chunks.complete, chunks, places, before)
