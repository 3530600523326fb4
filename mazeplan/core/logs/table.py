"""Tables of measurements: columns of equal length, from run logs or from a user's CSV files.

Known columns, in SI units and radians: t theta r x y beta gamma u_beta u_gamma segment ring, and the derivatives
theta_dot beta_dot gamma_dot theta_ddot beta_ddot gamma_ddot. Required columns: t, beta, gamma, and theta or x, y. A
sample in which the ball was not seen has NaN in x, y, theta. Derivatives may be missing at the edges of a segment.

Unknown columns are kept; a cell in them that is not a number becomes NaN.
"""

from __future__ import annotations

import csv
import hashlib
import io
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.core import file_kinds
from mazeplan.core.errors import TableError
from mazeplan.core.logs.column_units import ColumnSource, select_columns
from mazeplan.core.logs.run_log import read_log
from mazeplan.core.logs.run_log_reader import warn_if_cut
from mazeplan.core.logs.table_checks import KNOWN, UNITS, Rows, checked, fields_of, lines_of
from mazeplan.core.records import Array, IntArray

LIMIT_BYTES = 100 * 2**20  # half a million rows of 20 columns, about five hours at 30 Hz
LIMIT_COLUMNS = 1000


@dataclass(frozen=True)
class Table:
    """A table of measurements.

    columns: arrays (N,) by name
    source:  file and sha256 of the file from which the table was read
    path:    path of this file, for messages
    named:   names in this file of columns that have another name there
    """

    columns: dict[str, Array]
    source: dict[str, str] = field(default_factory=dict)
    path: str | None = None
    named: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.columns["t"])

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    @property
    def place(self) -> str | None:
        """Name of the table in messages: its path, else its file."""
        return self.path or self.source.get("file")

    @property
    def segment(self) -> Array:
        """Number of the uninterrupted stretch of each row; 0 everywhere if the table has no such column."""
        return self.columns.get("segment", np.zeros(len(self)))

    @cached_property
    def dt(self) -> float:
        """Time from row to row within a segment, s: mean of the steps near the median, so that rounded times do no
        harm."""
        steps = np.diff(self["t"])[np.diff(self.segment) == 0.0]
        return float(np.mean(steps[np.abs(steps / np.median(steps) - 1.0) < 0.5])) if steps.size else float("nan")


IN_MEMORY = Path("the table")
OTHERS = ("an empty file", "a MATLAB file", "XML", "JSON")
EXPECTED = "a run log (.mcap) or a table (CSV) with t, beta, gamma and theta, or x and y, in its first row"


def check_there(path: str | Path) -> None:
    """Raises TableError if a file is missing, cannot be read, or is certainly neither a run log nor a table."""
    path = Path(path)
    if not path.is_file() or file_kinds.got(path) in OTHERS or not os.access(path, os.R_OK):
        raise TableError(file_kinds.refused(path, EXPECTED), file=path)


def read_table(path: str | Path, columns: Mapping[str, ColumnSource] | None = None) -> Table:
    """A table from a run log (.mcap) or CSV. Raises TableError or LogError with file, line and column.

    columns: names and units of columns of a CSV (`parse_columns`); a run log has names and units of its own"""
    path = Path(path)
    check_there(path)
    if path.suffix == ".mcap" or file_kinds.got(path) == file_kinds.LOG:
        log = read_log(path)
        warn_if_cut(log)
        found = {name: column for name, column in log.ticks.items() if column.dtype != object}
        rows, content = Rows(path, range(1, 1 + len(log.ticks.get("t", ())))), path.read_bytes()
    else:
        content = content_of(path)
        found, rows = read_csv(content, path)
        found, named = select_columns(found, columns or {}, UNITS, (), path)
        rows = replace(rows, named=named)
    with np.errstate(all="ignore"):  # very large numbers overflow in the checks, but comparisons still work
        found = checked(found, rows)
    source = {"file": path.name, "sha256": hashlib.sha256(content).hexdigest()}
    return Table(found, source, str(path), rows.named)


def as_table(given: Any, columns: Mapping[str, ColumnSource] | None = None) -> Table:
    """A table from what a user of Python has: a Table, a path, {column: numbers}, or a DataFrame of pandas.

    columns: as of `read_table`. Raises TableError, LogError."""
    if isinstance(given, Table):
        return given
    if isinstance(given, str | Path):
        return read_table(given, columns)
    found, rows = given_columns(given)
    found, named = select_columns(found, columns or {}, UNITS, (), rows.file)
    with np.errstate(all="ignore"):
        return Table(checked(found, replace(rows, named=named)), {"file": rows.file.name})


def given_columns(given: Any) -> tuple[dict[str, Array], Rows]:
    """Columns of a table in memory, and their rows for messages. Raises TableError."""
    columns = given.columns if isinstance(given, Table) else given
    try:
        cells = {str(name): np.asarray(columns[name]) for name in columns}
        count = {len(column) for column in cells.values()}
    except (TypeError, KeyError, IndexError, ValueError):
        got = type(given).__name__
        raise TableError(f"got {got}, expected a path, a Table, a dict of columns or a DataFrame") from None
    if len(count) != 1:
        raise TableError(f"got columns of {len(count)} lengths, expected all as long as t", file=IN_MEMORY)
    rows = Rows(IN_MEMORY, range(count.pop()))
    return {name: _numbers(column, name, rows) for name, column in cells.items()}, rows


def several(given: Any) -> list[Any]:
    """One log or table, or several of them, as a list."""
    if given is None:
        return []
    return [given] if isinstance(given, str | Path | Table | Mapping) or hasattr(given, "columns") else list(given)


def name_of(given: Any) -> str:
    """Name of a log or table in titles: its file, if it has one."""
    if isinstance(given, str | Path):
        return Path(given).name
    return given.source.get("file", IN_MEMORY.name) if isinstance(given, Table) else IN_MEMORY.name


def join(tables: Sequence[Table]) -> Table:
    """All tables one below the other, with the columns that all tables have. Segments of different tables stay
    apart."""
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
    """Rows without interruption, in order: one segment, and no step in t longer than `longest_step` times `dt`."""
    if len(table) == 0:
        return []
    broken = (np.diff(table.segment) != 0.0) | (np.diff(table["t"]) > longest_step * table.dt)
    edges = [0, *(np.flatnonzero(broken) + 1).tolist(), len(table)]
    return [slice(start, stop) for start, stop in pairwise(edges)]


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
    """UTF-8 text without byte order mark and with bare line feeds. Raises TableError if the content is not text."""
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
    """First line and number of fields of each record; blank lines are not records."""
    if b'"' in data:
        reader, line, found = csv.reader(lines_of(data), skipinitialspace=True), 1, []
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


def _header(data: bytes, line: int, fields: int, path: Path) -> tuple[str, ...]:
    """Names of the columns; "" for a column without a name, which is left out."""
    if fields > LIMIT_COLUMNS:
        raise TableError(f"got {fields} columns, expected at most {LIMIT_COLUMNS}", file=path, line=line)
    header = tuple(name.strip() for name in fields_of(data, line))
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


def read_csv(content: bytes, path: Path) -> tuple[dict[str, Array], Rows]:
    """Columns of numbers, and where their rows are in the file."""
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
    rows = Rows(path, lines[1:], data, header)
    # each number must be the double nearest to its text; from pandas 3.1 on that is the default, without an option
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


def _numbers(cells: np.ndarray, name: str, rows: Rows) -> Array:
    """A column (N,) as numbers. Text is refused in a known column; in other columns it becomes NaN."""
    if cells.dtype.kind in "fiu":
        return np.ascontiguousarray(cells, dtype=np.float64)
    good = [_is_number(cell) for cell in cells]
    if name in KNOWN and not all(good):
        rows.refuse(name, good.index(False), "a number")
    return np.array([float(cell) if ok else np.nan for cell, ok in zip(cells, good, strict=True)], dtype=np.float64)
