"""Reads run logs (MCAP) back; run_log.py has their content.

A file is read from front to back without its index, because a file that a crash cut off has no index. All complete
chunks count.
"""

from __future__ import annotations

import json
import math
import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Attachment, Channel, McapRecord, Message
from mcap.stream_reader import StreamReader

from mazeplan.core import file_kinds
from mazeplan.core.errors import LogError, ShortWarning
from mazeplan.core.events import TimedEvent
from mazeplan.core.file_kinds import format_problem
from mazeplan.core.records import Plan, StopReason, TreeOutline

MAGIC = b"\x89MCAP0\r\n"
RECORD_LIMIT = 64 * 2**20  # bytes; the longest record of a run log is an attached model
EXPECTED = "a run log of mazeplan (MCAP)"
HEADER, NO_RUN = "/header", "got an MCAP file without the header of a run"
DAMAGE = (ValueError, KeyError, RecursionError)  # what damaged bytes raise
Document = tuple[str, dict[str, Any]]  # topic, message
PROGRAM = "mazeplan"
FORMAT = 1  # version of the topics and their fields; a reader refuses a newer version
MEASURED = ("t", "x", "y", "beta", "gamma", "u_beta", "u_gamma")  # columns that every log has
PLAN_STATES = ("theta", "theta_dot", "beta", "beta_dot", "gamma", "gamma_dot")
PLAN_CONTROLS = ("u_beta", "u_gamma")


@dataclass(frozen=True)
class LoggedTree:
    """A tree that began at t, s.

    statuses: ((t, letters), ...) for each tick that changed a status; letters: one of `run_log.STATUSES` per node."""

    t: float
    outline: TreeOutline
    statuses: tuple[tuple[float, str], ...] = ()


@dataclass(frozen=True)
class RunLog:
    """A log that was read.

    ticks: column -> array of N: float with NaN for missing, or object (str, "" for missing) for text"""

    path: Path
    header: dict[str, Any]  # facts about the run
    ticks: dict[str, np.ndarray]
    plans: tuple[Plan, ...]  # without gains; states are empty if a plan was not finite
    events: tuple[TimedEvent, ...]
    result: dict[str, Any] | None  # the outcome
    complete: bool  # False after a crash, when the last quarter of a second may be missing
    trees: tuple[LoggedTree, ...] = ()  # one for each goal; empty in logs of older versions


def read_log(path: str | Path) -> RunLog:
    """Read a log, also a log that was cut. Raises LogError when the file is missing, damaged, or not a run log of
    mazeplan."""
    path = Path(path)
    header, messages, complete = read_messages(path)

    def of(wanted: str) -> list[dict[str, Any]]:
        return [document for topic, document in messages if topic == wanted]

    with checked_fields(path):
        plans = tuple(_plan(document) for document in of("/plan"))
        events = tuple(TimedEvent.from_document(document) for document in of("/event"))
        result = next(iter(of("/result")), None)
        return RunLog(path, header, _columns(of("/tick")), plans, events, result, complete, _trees(messages))


def warn_if_cut(log: RunLog) -> None:
    """Warn (ShortWarning) if a log was not finished by its program."""
    if not log.complete:
        t = log.ticks["t"]
        kept = f"{len(t)} ticks" + (f" up to t = {t[-1]:.2f} s" if len(t) else "")
        warning = f"{log.path}: the log is cut off, its program did not finish it; used are its {kept}"
        warnings.warn(warning, ShortWarning, stacklevel=3)


@contextmanager
def checked_fields(path: Path) -> Iterator[None]:
    """Raises LogError if a message with a missing or wrong field causes an error in the block."""
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError) as problem:
        found = f"a field is missing or of the wrong kind ({problem})"
        raise LogError(f"damaged: {found}; copy it again from where it was recorded", file=path) from None


def read_messages(path: Path) -> tuple[dict[str, Any], list[Document], bool]:
    """The header, all messages as they were written, and whether the file was finished. Raises LogError."""
    file, messages = _McapFile(path), list[Document]()
    for message in file.documents():
        messages.append(message)
        if len(messages) == 1:  # checked first, because a newer format may differ in all that follows
            _header(messages, path)
    return _header(messages, path), messages, file.complete


def read_header(path: Path) -> dict[str, Any]:
    """The header of a log; the rest is not read. Raises LogError."""
    return _header(list(islice(_McapFile(path).documents(), 1)), path)


def _header(messages: Sequence[Document], path: Path) -> dict[str, Any]:
    """The first message of a log, its header. Raises LogError for another message, and for a newer format."""
    topic, header = messages[0] if messages else ("", {})
    if topic != HEADER or header.get("program") != PROGRAM:
        raise LogError(f"{NO_RUN}, expected {EXPECTED}", file=path)
    if problem := format_problem(header.get("format"), FORMAT, header.get("version")):
        raise LogError(problem, file=path, key="header.format")
    return header


def read_attachment(path: Path, name: str) -> bytes | None:
    """Content of a file that is attached to a log, or None. Raises LogError if the log cannot be read so far."""
    attached = (record for record in _McapFile(path).records() if isinstance(record, Attachment))
    return next((record.data for record in attached if record.name == name), None)


def _columns(ticks: Sequence[Mapping[str, Any]]) -> dict[str, np.ndarray]:
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


def _plan(document: dict[str, Any]) -> Plan:
    states, controls = (
        np.array([document.get(name, []) for name in names], dtype=float).T for names in (PLAN_STATES, PLAN_CONTROLS)
    )
    numbers = {name: float(document.get(name, math.nan)) for name in ("t0", "dt", "cost", "ms")}
    reason, iterations = StopReason(document.get("reason", "not_finite")), int(document.get("iterations", 0))
    return Plan(states, controls, np.empty((0, 2, 6)), reason=reason, iterations=iterations, **numbers)


def _trees(messages: Sequence[Document]) -> tuple[LoggedTree, ...]:
    """The trees of a run, one after another, each with its statuses."""
    trees: list[tuple[LoggedTree, list[tuple[float, str]]]] = []
    for topic, document in messages:
        if topic == "/tree":
            trees.append((LoggedTree(float(document["t"]), TreeOutline.from_document(document)), []))
        elif topic == "/status" and trees:
            nodes, (last, statuses) = str(document["nodes"]), trees[-1]
            if len(nodes) != len(last.outline.paths):
                raise ValueError("statuses of another tree")
            statuses.append((float(document["t"]), nodes))
    return tuple(replace(tree, statuses=tuple(statuses)) for tree, statuses in trees)


class _McapFile:
    """A file. complete: whether it was finished; valid when the whole file was read

    Every method raises LogError for a file that is missing, damaged, or not an MCAP file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.complete = True
        self._count = 0  # messages read so far

    def documents(self) -> Iterator[Document]:
        """The messages, one after another."""
        topics: dict[int, str] = {}
        for record in self.records():
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                try:
                    topic, document = topics[record.channel_id], json.loads(record.data)
                    if not isinstance(document, dict):
                        raise ValueError("a message is no JSON object")
                except DAMAGE as problem:
                    if topics and HEADER not in topics.values():  # a file of another program
                        raise LogError(f"{NO_RUN}, expected {EXPECTED}", file=self.path) from None
                    raise self._damaged(problem) from None
                self._count += 1
                yield topic, document

    def records(self) -> Iterator[McapRecord]:
        """All records up to the end, or to where the file was cut."""
        try:
            with self.path.open("rb") as stream:
                size = os.fstat(stream.fileno()).st_size
                if stream.read(len(MAGIC)) != MAGIC:
                    raise LogError(file_kinds.refused(self.path, EXPECTED), file=self.path)
                stream.seek(max(len(MAGIC), size - len(MAGIC)))
                self.complete = stream.read() == MAGIC
                stream.seek(0)
                try:
                    yield from StreamReader(stream, validate_crcs=True, record_size_limit=RECORD_LIMIT).records
                except Exception as problem:  # damaged bytes may raise anything in the library of a compression
                    if self.complete or stream.tell() < size:  # a cut file ends in the midst of a record
                        raise self._damaged(problem) from None
        except OSError:
            raise LogError(file_kinds.refused(self.path, EXPECTED), file=self.path) from None

    def _damaged(self, problem: Exception) -> LogError:
        why = " ".join(str(problem).split())[:120] or type(problem).__name__
        remedy = "copy it again from where it was recorded"
        return LogError(f"damaged after {self._count} messages: {why}; {remedy}", file=self.path)
