"""Reads run logs (MCAP) back, also those that were cut by a crash; what is in them is described in runlog.py.

The file is read from front to back, without its index: one that was cut has none.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Attachment, Channel, Chunk, Message
from mcap.stream_reader import StreamReader

from mazeplan import filekinds
from mazeplan.errors import LogError

PROGRAM = "mazeplan"
FORMAT = 1  # version of the topics and their fields; a reader refuses what is newer
MAGIC = b"\x89MCAP0\r\n"
RECORD_LIMIT = 64 * 2**20  # bytes; the longest of ours is a model that is attached
MEASURED = ("t", "x", "y", "beta", "gamma", "u_beta", "u_gamma")  # columns that every log has
PLAN_STATES = ("theta", "theta_dot", "beta", "beta_dot", "gamma", "gamma_dot")
PLAN_CONTROLS = ("u_beta", "u_gamma")
EXPECTED = "a run log of mazeplan (MCAP)"


@dataclass(frozen=True)
class RunLog:
    """A log that was read.

    header:   what the writer told about the run
    ticks:    column -> array of N: float with NaN for missing, or object (str, "" for missing) for text
    plans:    documents with t0, dt, cost, reason, iterations, ms and the arrays states (T+1, 6) and controls (T, 2)
    events:   documents with t, kind, detail
    trees:    documents with t, paths, kinds, names, parents (`runlog`), and statuses: ((t, letters), ...) from each
              tick after which they were others; empty in logs of older versions
    result:   the outcome, None when there is none
    complete: whether the file was finished; False after a crash, when the last message may be missing
    """

    path: Path
    header: dict[str, Any]
    ticks: dict[str, np.ndarray]
    plans: tuple[dict[str, Any], ...]
    events: tuple[dict[str, Any], ...]
    result: dict[str, Any] | None
    complete: bool
    trees: tuple[dict[str, Any], ...] = ()


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
            tuple(_event(document) for document in of("/event")),
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
        raise LogError(filekinds.refused(path, EXPECTED), file=path) from None
    header = next((document for topic, document in messages if topic == "/header"), {})
    if header.get("program") != PROGRAM:
        raise LogError(f"got an MCAP file without the header of a run, expected {EXPECTED}", file=path)
    if header.get("format") != FORMAT:
        raise LogError(f"got format {header.get('format')!r}, expected {FORMAT}: written by another version", file=path)
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
        raise LogError(filekinds.refused(path, EXPECTED), file=path)
    stream.seek(max(0, size - len(MAGIC)))
    finished = size > len(MAGIC) and stream.read() == MAGIC
    stream.seek(0)
    topics: dict[int, str] = {}
    found: list[tuple[str, dict[str, Any]]] = []
    # the reader asks only for read(); Any, as its annotations name concrete stream classes
    whole: Any = _Whole(stream, size)
    reader = StreamReader(whole, emit_chunks=True, validate_crcs=True, record_size_limit=RECORD_LIMIT)
    try:
        for record in reader.records:
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                found.append((topics[record.channel_id], _document(record.data)))
            elif isinstance(record, Chunk):
                raise LogError("got an MCAP file with chunks, expected one as mazeplan writes it", file=path)
    except EndOfFile:
        if finished:  # it has its end, so a length in its middle must be wrong
            raise LogError("damaged: a record is longer than the file", file=path) from None
        return found, False
    except (McapError, ValueError, KeyError, RecursionError) as problem:
        raise LogError(f"damaged after {len(found)} messages: {_one_line(problem)}", file=path) from None
    return found, True


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


def _plan(document: dict[str, Any]) -> dict[str, Any]:
    def stack(names: tuple[str, ...]) -> np.ndarray:
        return np.array([document.get(name, []) for name in names], dtype=float).T

    rest = {key: value for key, value in document.items() if key not in PLAN_STATES + PLAN_CONTROLS}
    return {**rest, "states": stack(PLAN_STATES), "controls": stack(PLAN_CONTROLS)}


def _trees(messages: list[tuple[str, dict[str, Any]]]) -> tuple[dict[str, Any], ...]:
    """The trees of a run, one after another, each with its statuses."""
    trees: list[dict[str, Any]] = []
    for topic, document in messages:
        if topic == "/tree":
            if len({len(document[name]) for name in ("paths", "kinds", "names", "parents")}) != 1:
                raise ValueError("a tree whose nodes are not all told")
            asks = document.get("conditions")  # logs of older versions do not tell
            if asks is not None and not all(isinstance(i, int) and 0 <= i < len(document["paths"]) for i in asks):
                raise ValueError("a condition that is no node")
            trees.append({**document, "t": float(document["t"]), "statuses": []})
        elif topic == "/status" and trees:
            nodes = str(document["nodes"])
            if len(nodes) != len(trees[-1]["paths"]):
                raise ValueError("statuses of another tree")
            trees[-1]["statuses"].append((float(document["t"]), nodes))
    return tuple({**tree, "statuses": tuple(tree["statuses"])} for tree in trees)


def _event(document: dict[str, Any]) -> dict[str, Any]:
    if not isinstance(document["kind"], str) or not isinstance(document["detail"], dict):
        raise TypeError("an event without kind or detail")
    return {**document, "t": float(document["t"])}
