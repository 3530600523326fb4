"""Tables of measurements: columns of equal length, from run logs or from CSV that a user brings.

Known columns, SI units and radians: t theta r x y beta gamma u_beta u_gamma segment ring, and the derivatives
theta_dot beta_dot gamma_dot theta_ddot beta_ddot gamma_ddot. Needed: t, beta, gamma, and theta or x, y. A sample in
which the ball was not seen has NaN in x, y, theta; derivatives may be missing at the edges of a segment.

Unknown columns are kept and never refused: a cell of theirs that is no number is NaN.
"""

from __future__ import annotations

import csv
import hashlib
import io
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from mazeplan.core import file_kinds
from mazeplan.core.errors import TableError
from mazeplan.core.logs.run_log import read_log
from mazeplan.core.logs.run_log_reader import columns_of, warn_if_cut
from mazeplan.core.records import Array, IntArray

BALL = ("x", "y", "theta", "r")  # may be missing in single rows: the ball was not seen
RATES = tuple(f"{name}_{order}" for order in ("dot", "ddot") for name in ("theta", "beta", "gamma"))
EVERYWHERE = ("t", "beta", "gamma", "u_beta", "u_gamma", "segment", "ring")  # a number in each row, if there at all
KNOWN = (*EVERYWHERE, *BALL, *RATES)

DEGREES = 1.0  # rad; a plate that is said to tilt further was measured in degrees
MILLIMETRES = 1.0  # m; a ball further out than this was measured in millimetres: the largest track is 0.09 m
MILLISECONDS = 5.0  # s; a table with longer steps than this has another unit of time: rigs run at about 30 Hz
SPINNING = 20.0  # rad/s; half of all rows faster than this (over LAG_S) is no ball in a ring but an angle in degrees
SLOWEST = 0.5  # s; a ball that rolls is somewhere else after a longer step
LAG_S = 0.1  # s; long enough that noise of the camera is no speed

LIMIT_BYTES = 100 * 2**20  # half a million rows of 20 columns, about five hours at 30 Hz
LIMIT_COLUMNS = 1000


@dataclass(frozen=True)
class Table:
    """Columns (N,) by name; `source`: file and sha256 of what it was read from; path: of that, for messages."""

    columns: dict[str, Array]
    source: dict[str, str] = field(default_factory=dict)
    path: str | None = None

    def __len__(self) -> int:
        return len(self.columns["t"])

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    @property
    def place(self) -> str | None:
        """What messages call it: its path, else its file."""
        return self.path or self.source.get("file")

    @property
    def segment(self) -> Array:
        """Number of the uninterrupted stretch of each row; 0 everywhere when the table does not say."""
        return self.columns.get("segment", np.zeros(len(self)))

    @property
    def dt(self) -> float:
        """Time from row to row within a segment, s: mean of the usual steps, so that rounded times do no harm."""
        steps = np.diff(self["t"])[np.diff(self.segment) == 0.0]
        return float(np.mean(steps[np.abs(steps / np.median(steps) - 1.0) < 0.5])) if steps.size else float("nan")


@dataclass(frozen=True)
class _Rows:
    """Where the rows of a table stand in its file, for messages: line of each row; data, header of a CSV."""

    file: Path
    lines: Sequence[int] | IntArray
    data: bytes = b""
    header: tuple[str, ...] = ()

    def refuse(self, name: str, row: int, expected: str, got: object = None) -> NoReturn:
        """Raise TableError about one cell; got: what to say, else what stands in the file."""
        line = int(self.lines[row])
        if got is None:
            fields = _fields(self.data, line)
            at = self.header.index(name) if name in self.header else len(fields)
            text = fields[at].strip() if at < len(fields) else ""
            got = repr(text[:40]) if text else "an empty cell" if self.data else "no value"
        raise TableError(f"got {got}, expected {expected}", file=self.file, line=line, key=name)


OTHERS = (
    "an empty file", "a file with nothing but blanks", "a PNG picture", "a JPEG picture", "a PDF", "a zip archive",
    "a gzip archive", "an HDF5 file", "a MATLAB file", "XML", "HTML", "JSON", "YAML",
)  # fmt: skip
EXPECTED = "a run log (.mcap) or a table (CSV) with t, beta, gamma and theta, or x and y, in its first row"


def check_there(path: Path) -> None:
    """Raises TableError for what is not there, or surely neither a run log nor a table."""
    if not path.is_file() or file_kinds.got(path) in OTHERS or not os.access(path, os.R_OK):
        raise TableError(file_kinds.refused(path, EXPECTED), file=path)


def read_table(path: str | Path) -> Table:
    """A table from a run log (.mcap) or CSV. Raises TableError or LogError with file, line and column."""
    path = Path(path)
    check_there(path)
    if path.suffix == ".mcap" or file_kinds.got(path) == file_kinds.LOG:
        log = read_log(path)
        warn_if_cut(log)
        columns = {name: column for name, column in log.ticks.items() if column.dtype != object}
        rows, content = _Rows(path, range(1, 1 + len(log.ticks.get("t", ())))), path.read_bytes()
    else:
        content = content_of(path)
        columns, rows = read_csv(content, path)
    with np.errstate(all="ignore"):  # numbers near the largest overflow in the checks; they compare all the same
        columns = _checked(columns, rows)
    return Table(columns, {"file": path.name, "sha256": hashlib.sha256(content).hexdigest()}, str(path))


def table_of(ticks: Sequence[Mapping[str, Any]], name: str) -> Table:
    """A table from the ticks of a run, documents as a log holds them. Raises TableError about the file `name`."""
    columns = {key: column for key, column in columns_of(ticks).items() if column.dtype != object}
    with np.errstate(all="ignore"):
        return Table(_checked(columns, _Rows(Path(name), range(1, 1 + len(ticks)))), {"file": name})


def join(tables: Sequence[Table]) -> Table:
    """All tables one below the other, with segments that stay apart; columns that all of them have."""
    names = [name for name in tables[0].columns if all(name in table for table in tables)]
    columns = {name: np.concatenate([table[name] for table in tables]) for name in names}
    numbers, offset = [], 0.0
    for table in tables:
        numbers.append(table.segment - table.segment.min() + offset)
        offset = float(numbers[-1].max()) + 1.0
    columns["segment"] = np.concatenate(numbers)
    files = ", ".join(table.source.get("file", "a table") for table in tables)
    return Table(columns, {"file": files}, ", ".join(table.place or "a table" for table in tables))


def stretches(table: Table, longest_step: float = 1.5) -> list[slice]:
    """Rows without interruption, in order: one segment, and no step in t longer than `longest_step` usual ones."""
    if len(table) == 0:
        return []
    broken = (np.diff(table.segment) != 0.0) | (np.diff(table["t"]) > longest_step * table.dt)
    edges = [0, *(np.flatnonzero(broken) + 1).tolist(), len(table)]
    return [slice(start, stop) for start, stop in pairwise(edges)]


def _usual_step(t: Array, segment: Array) -> float:
    steps = np.diff(t)[np.diff(segment) == 0.0]
    return float(np.median(steps)) if steps.size else float("nan")


# --- reading CSV


def content_of(path: Path) -> bytes:
    """The bytes of a file that is not too large."""
    try:
        size = path.stat().st_size
        if size > LIMIT_BYTES:
            raise TableError(
                f"got {size / 2**20:.0f} MiB, expected at most {LIMIT_BYTES / 2**20:.0f}; split it", file=path
            )
        return path.read_bytes()
    except OSError as problem:
        raise TableError(f"cannot be read: {problem.strerror or problem}", file=path) from None


def _plain_text(content: bytes, path: Path) -> bytes:
    """UTF-8 without byte order mark and with bare line feeds. Raises TableError for what is no text."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise TableError("not a CSV file: got UTF-16 text, expected UTF-8", file=path)
    data = content.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    nul = data.find(b"\0")
    if nul >= 0:
        raise TableError("not a CSV file: got a NUL byte, expected text", file=path, line=data.count(b"\n", 0, nul) + 1)
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as problem:
        line = data.count(b"\n", 0, problem.start) + 1
        got = f"byte 0x{data[problem.start]:02x}"
        raise TableError(f"not a CSV file: got {got}, expected UTF-8 text", file=path, line=line) from None
    return data


def _records(data: bytes, path: Path) -> tuple[IntArray, IntArray]:
    """First line, and number of fields, of each record; lines with nothing but blanks are no records."""
    if b'"' in data:
        reader, line, found = csv.reader(_lines(data), skipinitialspace=True), 1, []
        try:
            for row in reader:
                if len(row) > 1 or (row and row[0].strip()):
                    found.append((line, len(row)))
                line = reader.line_num + 1
        except csv.Error as problem:
            raise TableError(f"not a CSV file: {problem}", file=path, line=line) from None
        array = np.array(found, dtype=np.int64).reshape(-1, 2)
        return array[:, 0], array[:, 1]
    # without quotes each line is a record, and counting commas is twenty times as fast
    text = np.frombuffer(data if data.endswith(b"\n") else data + b"\n", dtype=np.uint8)
    ends = np.flatnonzero(text == ord("\n"))
    starts = np.concatenate([[0], ends[:-1] + 1])
    fields = np.diff(np.searchsorted(np.flatnonzero(text == ord(",")), ends), prepend=0) + 1
    there = ends > starts
    for i in np.flatnonzero(there & (fields == 1)):
        there[i] = bool(data[starts[i] : ends[i]].strip(b" \t"))
    return np.flatnonzero(there) + 1, fields[there]


def _lines(data: bytes) -> io.TextIOWrapper:
    return io.TextIOWrapper(io.BytesIO(data), encoding="utf-8", newline="")


def _fields(data: bytes, line: int) -> list[str]:
    """Fields of the record that starts at a line."""
    rest = data.split(b"\n", line - 1)
    return next(csv.reader(_lines(rest[-1]), skipinitialspace=True), []) if len(rest) == line else []


def _header(data: bytes, line: int, fields: int, path: Path) -> tuple[str, ...]:
    """Names of the columns; "" for one without a name, which is left out."""
    if fields > LIMIT_COLUMNS:
        raise TableError(f"got {fields} columns, expected at most {LIMIT_COLUMNS}", file=path, line=line)
    header = tuple(name.strip() for name in _fields(data, line))
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if len(header) == 1 and mark in header[0]:
            raise TableError(f"got {name} between the names, expected commas", file=path, line=line)
    if all(_is_number(name) for name in header):
        raise TableError("got numbers, expected a header row with the names of the columns", file=path, line=line)
    twice = [name for i, name in enumerate(header) if name and name in header[:i]]
    if twice:
        problem = f"got column {twice[0]!r} twice, expected a header row with each name once"
        raise TableError(problem, file=path, line=line)
    return header


def read_csv(content: bytes, path: Path) -> tuple[dict[str, Array], _Rows]:
    """Columns of numbers, and where their rows stand."""
    import pandas as pd  # slow to import

    data = _plain_text(content, path)
    lines, fields = _records(data, path)
    if not len(lines):
        raise TableError("got an empty file, expected a header row", file=path, line=1)
    header = _header(data, int(lines[0]), int(fields[0]), path)
    wrong = np.flatnonzero(fields != len(header))
    if wrong.size:
        row = int(wrong[0])
        raise TableError(f"got {fields[row]} fields, expected {len(header)}", file=path, line=int(lines[row]))
    rows = _Rows(path, lines[1:], data, header)
    # each number must be the double nearest to its text; from 3.1 on that is what pandas does and the option is gone
    old = tuple(int(part) for part in pd.__version__.split(".")[:2]) < (3, 1)
    exact: dict[str, Any] = {"float_precision": "round_trip"} if old else {}
    try:
        frame = pd.read_csv(
            io.BytesIO(data),
            header=0,
            names=list(range(len(header))),
            index_col=False,
            skipinitialspace=True,
            low_memory=False,
            **exact,
        )
    except (ValueError, OverflowError) as problem:  # pandas' own errors are ValueErrors
        raise TableError(f"not a CSV file: {' '.join(str(problem).split())[:200]}", file=path) from None
    if len(frame) != len(lines) - 1:
        raise TableError(f"not a CSV file: got {len(frame)} rows in {len(lines) - 1} lines", file=path)
    return {name: _numbers(frame[i].to_numpy(), name, rows) for i, name in enumerate(header) if name}, rows


def _is_number(text: object) -> bool:
    try:
        float(str(text))
    except ValueError:
        return False
    return "_" not in str(text)  # 1_000 is a number to Python only


def _numbers(cells: np.ndarray, name: str, rows: _Rows) -> Array:
    """A column as it was read, (N,): as numbers. Text is refused in a known column, else it is NaN."""
    if cells.dtype.kind in "fiu":
        return np.ascontiguousarray(cells, dtype=np.float64)
    good = [_is_number(cell) for cell in cells]
    if name in KNOWN and not all(good):
        rows.refuse(name, good.index(False), "a number")
    return np.array([float(cell) if ok else np.nan for cell, ok in zip(cells, good, strict=True)], dtype=np.float64)


# --- checks


def _checked(columns: dict[str, Array], rows: _Rows) -> dict[str, Array]:
    """The columns, with theta, r, x, y worked out where they can be. Raises TableError."""
    _check_present(columns, rows.file)
    _check_numbers(columns, rows)
    _check_time(columns, rows)
    _check_units(columns, rows)
    if {"x", "y"} <= set(columns):
        columns.setdefault("theta", np.arctan2(columns["y"], columns["x"]))
        columns.setdefault("r", np.hypot(columns["x"], columns["y"]))
    elif {"theta", "r"} <= set(columns):
        columns["x"], columns["y"] = columns["r"] * np.cos(columns["theta"]), columns["r"] * np.sin(columns["theta"])
    if not np.isfinite(columns["theta"]).any():
        raise TableError("got no row with theta, or x and y: the ball is never seen", file=rows.file)
    return columns


def _check_present(columns: dict[str, Array], file: Path) -> None:
    names = list(columns)
    there = ", ".join(names[:30]) + (f" and {len(names) - 30} more" if len(names) > 30 else "")
    missing = [name for name in ("t", "beta", "gamma") if name not in columns]
    if "theta" not in columns and not {"x", "y"} <= set(columns):
        missing.append("theta (or x and y)")
    if missing:
        upper = any(name.lower() in KNOWN for name in names if name not in KNOWN)
        hint = "; names of columns are in lower case" if upper else ""
        raise TableError(f"missing columns: {', '.join(missing)}; there are {there or 'none'}{hint}", file=file)
    if len(columns["t"]) < 2:
        raise TableError(f"got {len(columns['t'])} rows, expected at least 2: record for longer", file=file)


def _first(bad: np.ndarray) -> int:
    """Index of the first True, -1 when there is none."""
    return int(np.argmax(bad)) if bad.any() else -1


def _check_numbers(columns: dict[str, Array], rows: _Rows) -> None:
    for name in EVERYWHERE:
        if name in columns and (row := _first(~np.isfinite(columns[name]))) >= 0:
            rows.refuse(name, row, "a finite number")
    for name in (*BALL, *RATES):
        if name in columns and (row := _first(np.isinf(columns[name]))) >= 0:
            rows.refuse(name, row, "a finite number, or an empty cell")
    for name in ("segment", "ring"):
        if name in columns and (row := _first(columns[name] != np.round(columns[name]))) >= 0:
            rows.refuse(name, row, "a whole number", f"{columns[name][row]:g}")
    if "r" in columns and (row := _first(columns["r"] < 0.0)) >= 0:
        rows.refuse("r", row, "at least 0 m", f"{columns['r'][row]:g}")


def _check_time(columns: dict[str, Array], rows: _Rows) -> None:
    t, segment = columns["t"], columns.get("segment", np.zeros(len(columns["t"])))
    row = 1 + _first((np.diff(t) <= 0.0) & (np.diff(segment) == 0.0))
    if row > 0:
        rows.refuse("t", row, "it to grow", f"{float(t[row])!r} after {float(t[row - 1])!r}")
    step = _usual_step(t, segment)
    if step > MILLISECONDS:
        unit = "milliseconds" if step < 1000.0 * MILLISECONDS else "microseconds or nanoseconds"
        rows.refuse("t", 1, f"seconds; are these {unit}?", f"steps of {step:g} (median)")
    if step > SLOWEST:
        numbers = "; are these the numbers of the samples?" if np.all(np.diff(t) == 1.0) else ""
        rows.refuse("t", 1, f"at most {SLOWEST:g} s from sample to sample{numbers}", f"steps of {step:g} s (median)")


def _check_units(columns: dict[str, Array], rows: _Rows) -> None:
    tilt = f"radians (at most {DEGREES:g}); are these degrees?"
    place = f"metres (at most {MILLIMETRES:g}); are these millimetres or centimetres?"
    limits = [(name, DEGREES, tilt) for name in ("beta", "gamma", "u_beta", "u_gamma")]
    for name, most, expected in limits + [(name, MILLIMETRES, place) for name in ("x", "y", "r")]:
        if name in columns:
            size = np.nan_to_num(np.abs(columns[name]))
            row = int(np.argmax(size))
            if size[row] > most:
                rows.refuse(name, row, expected, f"{columns[name][row]:g}")
    if "theta" in columns and _in_degrees(columns):
        row = int(np.argmax(np.nan_to_num(np.abs(columns["theta"]))))
        rows.refuse("theta", row, "radians; these are degrees", f"{columns['theta'][row]:g}")


def _in_degrees(columns: dict[str, Array]) -> bool:
    """Whether theta is an angle in degrees for sure; an unwrapped angle in radians may be as large.

    Sure: it agrees with x, y in degrees only; or it leaves +-2 pi and goes by whole numbers, or jumps by about 360, or
    changes faster than a ball can roll in half of all rows.
    """
    theta, t = columns["theta"], columns["t"]
    if {"x", "y"} <= set(columns):
        seen = np.arctan2(columns["y"], columns["x"])
        turns = [(theta * unit - seen) / (2.0 * np.pi) for unit in (1.0, np.pi / 180.0)]
        off = [2.0 * np.pi * np.abs(turn - np.round(turn)) for turn in turns]
        both = np.isfinite(off[0])
        if both.any() and np.median(off[0][both]) > 0.5 and np.median(off[1][both]) < 0.1:  # rad
            return True
    known = theta[np.isfinite(theta)]
    if not known.size or np.max(np.abs(known)) < 2.0 * np.pi + 0.1:
        return False
    if np.all(known == np.round(known)) and len(np.unique(known)) > 3:
        return True
    segment = columns.get("segment", np.zeros(len(t)))
    step = np.diff(theta)[np.diff(segment) == 0.0]
    if np.max(np.abs(known)) <= 360.0 and np.any((np.abs(step) > 300.0) & (np.abs(step) < 360.0 + 1e-9)):
        return True
    lag = max(1, round(LAG_S / _usual_step(t, segment)))
    if lag >= len(t):
        return False
    speed = np.abs(theta[lag:] - theta[:-lag]) / (t[lag:] - t[:-lag])
    speed = speed[np.isfinite(speed) & (segment[lag:] == segment[:-lag])]
    return bool(speed.size) and float(np.median(speed)) > SPINNING
