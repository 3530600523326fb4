"""Reads run logs (MCAP) back, also logs that a crash cut off; run_log.py has their content, mcap_file.py the file."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.core.errors import LogError, ShortWarning
from mazeplan.core.events import TimedEvent
from mazeplan.core.file_format import format_problem
from mazeplan.core.logs.mcap_file import EXPECTED, HEADER, NO_RUN, Document, McapFile
from mazeplan.core.records import Array, TreeOutline

PROGRAM = "mazeplan"
FORMAT = 1  # version of the topics and their fields; a reader refuses a newer version
MEASURED = ("t", "x", "y", "beta", "gamma", "u_beta", "u_gamma")  # columns that every log has
PLAN_STATES = ("theta", "theta_dot", "beta", "beta_dot", "gamma", "gamma_dot")
PLAN_CONTROLS = ("u_beta", "u_gamma")


@dataclass(frozen=True)
class LoggedPlan:
    """A plan without its gains; see `records.Plan`.

    t0, dt:   s
    cost, ms: NaN if the log does not hold them
    states:   (T+1, 6), empty if the plan was not finite
    controls: (T, 2), empty if the plan was not finite
    """

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
    """A tree that began at t, s.

    statuses: ((t, letters), ...) for each tick that changed a status; letters: one of `run_log.STATUSES` per node."""

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


def read_log(path: str | Path) -> RunLog:
    """Read a log, also a log that was cut. Raises LogError when the file is missing, damaged, or not a run log of
    mazeplan."""
    path = Path(path)
    header, messages, complete = read_messages(path)

    def of(wanted: str) -> list[dict[str, Any]]:
        return [document for topic, document in messages if topic == wanted]

    with checked_fields(path):
        return RunLog(
            path,
            header,
            columns_of(of("/tick")),
            tuple(_plan(document) for document in of("/plan")),
            tuple(TimedEvent.from_document(document) for document in of("/event")),
            next(iter(of("/result")), None),
            complete,
            trees_of(messages),
        )


class CutLogWarning(ShortWarning):
    """A log was cut off, so its end is missing."""


def warn_if_cut(log: RunLog) -> None:
    """Warn (CutLogWarning) if a log was not finished by its program."""
    if not log.complete:
        t = log.ticks["t"]
        kept = f"{len(t)} ticks" + (f" up to t = {t[-1]:.2f} s" if len(t) else "")
        warning = f"{log.path}: the log is cut off, its program did not finish it; used are its {kept}"
        warnings.warn(warning, CutLogWarning, stacklevel=3)


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
    file, messages = McapFile(path), list[Document]()
    for message in file.documents():
        messages.append(message)
        if len(messages) == 1:  # checked first, because a newer format may differ in all that follows
            _check_format(message[1], path)
    return header_of(messages, path), messages, file.complete


def read_header(path: Path) -> dict[str, Any]:
    """The header of a log; the rest is not read. Raises LogError."""
    return header_of(list(islice(McapFile(path).documents(), 1)), path)


def header_of(messages: Sequence[Document], path: Path) -> dict[str, Any]:
    """The header among the messages of a log. Raises LogError without one, or with one of a newer format."""
    header = next((document for topic, document in messages if topic == HEADER), {})
    if header.get("program") != PROGRAM:
        raise LogError(f"{NO_RUN}, expected {EXPECTED}", file=path)
    _check_format(header, path)
    return header


def read_attachment(path: Path, name: str) -> bytes | None:
    """Content of a file that is attached to a log, or None. Raises LogError if the log cannot be read up to the
    attachment."""
    return McapFile(path).attachment(name)


def _check_format(header: dict[str, Any], path: Path) -> None:
    """Refuse a log of a format that cannot be read; a document that is not a header of mazeplan passes."""
    if header.get("program") == PROGRAM:
        problem = format_problem(header.get("format"), FORMAT, header.get("version"))
        if problem is not None:
            raise LogError(problem, file=path, key="header.format")


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


def trees_of(messages: Sequence[Document]) -> tuple[LoggedTree, ...]:
    """The trees of a run, one after another, each with its statuses. Raises KeyError, TypeError or ValueError."""
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
