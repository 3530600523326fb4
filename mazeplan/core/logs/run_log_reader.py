"""Reads run logs (MCAP) back, also logs that a crash cut off; run_log.py describes their content.

The file is read from front to back, without its index: one that was cut has none. All chunks that are whole count. Logs
of older versions have no chunks. The topics of `viewer_topics.py` are skipped: they say the same in other words.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from mazeplan.core import file_kinds
from mazeplan.core.errors import LogError
from mazeplan.core.events import TimedEvent
from mazeplan.core.file_format import format_problem
from mazeplan.core.logs.viewer_topics import VIEWER_SCHEMAS
from mazeplan.core.records import Array, TreeOutline

PROGRAM = "mazeplan"
FORMAT = 1  # version of the topics and their fields; a reader refuses what is newer
MAGIC = b"\x89MCAP0\r\n"
RECORD_LIMIT = 64 * 2**20  # bytes; the longest of ours is a model that is attached
MEASURED = ("t", "x", "y", "beta", "gamma", "u_beta", "u_gamma")  # columns that every log has
PLAN_STATES = ("theta", "theta_dot", "beta", "beta_dot", "gamma", "gamma_dot")
PLAN_CONTROLS = ("u_beta", "u_gamma")
EXPECTED = "a run log of mazeplan (MCAP)"


@dataclass(frozen=True)
class LoggedPlan:
    """A plan without its gains. states: (T+1, 6), controls: (T, 2), both empty when it was not finite; t0, dt: s;
    cost and ms are NaN where the log does not hold them."""

    t0: float
    dt: float
    cost: float
    reason: str
    iterations: int
    ms: float
    states: Array
    controls: Array


@dataclass(frozen=True)
class LoggedTree:
    """A tree that began at t, s. statuses: ((t, letters), ...) from each tick that changed a status on; a letter of
    `run_log.STATUSES` for each node."""

    t: float
    outline: TreeOutline
    statuses: tuple[tuple[float, str], ...] = ()


@dataclass(frozen=True)
class RunLog:
    """A log that was read.

    header:   facts about the run
    ticks:    column -> array of N: float with NaN for missing, or object (str, "" for missing) for text
    plans:    in the order in which they were made
    events:   see `core.events`
    trees:    one for each goal; empty in logs of older versions
    result:   the outcome, None when there is none
    complete: whether the file was finished; False after a crash, when the last quarter of a second may be missing
    """

    path: Path
    header: dict[str, Any]
    ticks: dict[str, np.ndarray]
    plans: tuple[LoggedPlan, ...]
    events: tuple[TimedEvent, ...]
    result: dict[str, Any] | None
    complete: bool
    trees: tuple[LoggedTree, ...] = ()


class _Whole:
    """A stream that reads all that was asked or says that the file is over: a record that was cut is no record."""

    def __init__(self, stream: IO[bytes], size: int) -> None:
        self._stream, self._left = stream, size

    def read(self, length: int) -> bytes:
        if not 0 <= length <= self._left:
            raise EndOfFile
        self._left -= length
        return self._stream.read(length)


def read_log(path: str | Path) -> RunLog:
    """Read a log, also one that was cut. Raises LogError when the file is missing, damaged, or no run log of ours."""
    path = Path(path)
    header, messages, complete = read_messages(path)

    def of(wanted: str) -> list[dict[str, Any]]:
        return [document for topic, document in messages if topic == wanted]

    try:
        return RunLog(
            path,
            header,
            columns_of(of("/tick")),
            tuple(_plan(document) for document in of("/plan")),
            tuple(TimedEvent.from_document(document) for document in of("/event")),
            next(iter(of("/result")), None),
            complete,
            _trees(messages),
        )
    except (KeyError, TypeError, ValueError, OverflowError) as problem:
        raise LogError(f"damaged: a field is missing or of the wrong kind ({problem})", file=path) from None


def read_messages(path: Path) -> tuple[dict[str, Any], list[tuple[str, dict[str, Any]]], bool]:
    """The header, all messages as they were written, and whether the file was finished. Raises LogError."""
    try:
        with path.open("rb") as stream:
            messages, complete = _messages(stream, path)
    except (OSError, ValueError):
        raise LogError(file_kinds.refused(path, EXPECTED), file=path) from None
    header = next((document for topic, document in messages if topic == "/header"), {})
    if header.get("program") != PROGRAM:
        raise LogError(f"got an MCAP file without the header of a run, expected {EXPECTED}", file=path)
    _check_format(header, path)
    return header, messages, complete


def read_attachment(path: Path, name: str) -> bytes | None:
    """A file that a log holds, or None. Raises LogError where the log cannot be read up to there."""
    try:
        with path.open("rb") as stream:
            whole: Any = _Whole(stream, os.fstat(stream.fileno()).st_size)
            reader = StreamReader(whole, emit_chunks=True, validate_crcs=True, record_size_limit=RECORD_LIMIT)
            found = (r.data for r in reader.records if isinstance(r, Attachment) and r.name == name)
            return next(found, None)
    except EndOfFile:
        return None
    except (OSError, McapError, ValueError, KeyError) as problem:
        raise LogError(f"damaged: {_one_line(problem)}", file=path) from None


def _messages(stream: IO[bytes], path: Path) -> tuple[list[tuple[str, dict[str, Any]]], bool]:
    """(topic, document) of all messages, and whether the file was finished."""
    size = os.fstat(stream.fileno()).st_size
    if stream.read(len(MAGIC)) != MAGIC:
        raise LogError(file_kinds.refused(path, EXPECTED), file=path)
    stream.seek(max(0, size - len(MAGIC)))
    finished = size > len(MAGIC) and stream.read() == MAGIC
    stream.seek(0)
    topics: dict[int, str] = {}
    found: list[tuple[str, dict[str, Any]]] = []
    # the reader asks only for read(); Any, as its annotations name concrete stream classes
    whole: Any = _Whole(stream, size)
    reader = StreamReader(whole, emit_chunks=True, validate_crcs=True, record_size_limit=RECORD_LIMIT)
    try:
        for record in _unpacked(reader.records):
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message) and topics[record.channel_id] not in VIEWER_SCHEMAS:
                found.append((topics[record.channel_id], _document(record.data)))
                if len(found) == 1:  # the header: what follows it may be written in another way
                    _check_format(found[0][1], path)
    except EndOfFile:
        if finished:  # it has its end, so a length in its middle must be wrong
            raise LogError("damaged: a record is longer than the file", file=path) from None
        return found, False
    except (McapError, ValueError, KeyError, RecursionError) as problem:
        raise LogError(f"damaged after {len(found)} messages: {_one_line(problem)}", file=path) from None
    return found, True


def _check_format(header: dict[str, Any], path: Path) -> None:
    """Refuse a log of a format that cannot be read; a document that is no header of ours passes."""
    if header.get("program") == PROGRAM:
        problem = format_problem(header.get("format"), FORMAT, header.get("version"))
        if problem is not None:
            raise LogError(problem, file=path, key="header.format")


def _unpacked(records: Iterable[McapRecord]) -> Iterator[McapRecord]:
    """All records, those in chunks one by one. Raises ValueError for a chunk that is damaged."""
    for record in records:
        if not isinstance(record, Chunk):
            yield record
            continue
        if record.uncompressed_size > RECORD_LIMIT:
            raise ValueError("a chunk that is too long")
        try:
            inside = breakup_chunk(record, validate_crc=True)
        except Exception as problem:  # of the library for its compression, which one says the file
            raise ValueError(f"a chunk cannot be unpacked: {_one_line(problem)}") from None
        yield from inside


def _one_line(problem: Exception) -> str:
    return " ".join(str(problem).split())[:120] or type(problem).__name__


def _document(data: bytes) -> dict[str, Any]:
    document = json.loads(data)
    if not isinstance(document, dict):
        raise ValueError("a message is no JSON object")
    return document


def columns_of(ticks: Sequence[Mapping[str, Any]]) -> dict[str, np.ndarray]:
    """Ticks as they were written, by column; see `RunLog.ticks`."""
    names = dict.fromkeys((*MEASURED, *(name for tick in ticks for name in tick)))
    columns = {}
    for name in names:
        values = [tick.get(name) for tick in ticks]
        if any(isinstance(value, str) for value in values):
            columns[name] = np.array(["" if value is None else str(value) for value in values], dtype=object)
        else:
            columns[name] = np.array([math.nan if value is None else float(value) for value in values])
    if not np.isfinite(columns["t"]).all():
        raise ValueError("a tick without t")
    return columns


def _plan(document: dict[str, Any]) -> LoggedPlan:
    def stack(names: tuple[str, ...]) -> Array:
        return np.array([document.get(name, []) for name in names], dtype=float).T

    def number(name: str) -> float:
        return float(document.get(name, math.nan))

    reason, iterations = str(document.get("reason", "")), int(document.get("iterations", 0))
    t0, dt, cost, ms = (number(name) for name in ("t0", "dt", "cost", "ms"))
    return LoggedPlan(t0, dt, cost, reason, iterations, ms, stack(PLAN_STATES), stack(PLAN_CONTROLS))


def _trees(messages: list[tuple[str, dict[str, Any]]]) -> tuple[LoggedTree, ...]:
    """The trees of a run, one after another, each with its statuses."""
    trees: list[LoggedTree] = []
    for topic, document in messages:
        if topic == "/tree":
            trees.append(LoggedTree(float(document["t"]), TreeOutline.from_document(document)))
        elif topic == "/status" and trees:
            t, nodes, last = float(document["t"]), str(document["nodes"]), trees[-1]
            if len(nodes) != len(last.outline.paths):
                raise ValueError("statuses of another tree")
            trees[-1] = replace(last, statuses=(*last.statuses, (t, nodes)))
    return tuple(trees)
