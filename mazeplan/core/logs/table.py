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
import math
import os
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.core import file_kinds
from mazeplan.core.errors import TableError
from mazeplan.core.logs.columns import KNOWN, SI_UNITS, ColumnSource, Rows, checked, select_columns
from mazeplan.core.logs.run_log_reader import read_log, warn_if_cut
from mazeplan.core.records import Array

LIMIT_BYTES = 100 * 2**20  # half a million rows of 20 columns, about five hours at 30 Hz
LONGEST_STEP = 1.5  # times the usual step; after a longer one, samples are missing
MISSING = ("", "na", "n/a", "#n/a", "<na>", "nan", "null", "none")  # cells without a value, in small letters


@dataclass(frozen=True)
class Table:
    """A table of measurements."""

    columns: dict[str, Array]  # (N,) by name
    source: dict[str, str] = field(default_factory=dict)  # file and sha256 of the file from which the table was read
    path: str | None = None  # of this file, for messages
    named: Mapping[str, str] = field(default_factory=dict)  # names in this file of columns that have another name there

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


def read_table(path: str | Path, columns: Mapping[str, ColumnSource] | None = None) -> Table:
    """A table from a run log (.mcap) or CSV. Raises TableError or LogError with file, line and column.

    columns: names and units of columns of a CSV (`parse_columns`); a run log has names and units of its own"""
    path = Path(path)
    kind = file_kinds.got(path)
    if not path.is_file() or kind in OTHERS or not os.access(path, os.R_OK):
        raise TableError(file_kinds.refused(path, EXPECTED), file=path)
    if path.suffix == ".mcap" or kind == file_kinds.LOG:
        log = read_log(path)
        warn_if_cut(log)
        found = {name: column for name, column in log.ticks.items() if column.dtype != object}
        rows, content = Rows(path, range(1, 1 + len(log.ticks.get("t", ())))), path.read_bytes()
    else:
        content = content_of(path)
        found, rows = read_csv(content, path)
        found, named = select_columns(found, columns or {}, SI_UNITS, (), path)
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
    found, named = select_columns(found, columns or {}, SI_UNITS, (), rows.file)
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
    numbers: dict[str, Any] = dict(cells)
    for name, column in cells.items():
        if column.dtype.kind not in "fiu":
            numbers[name] = [_number(cell, name, i, rows) for i, cell in enumerate(column)]
    return {name: np.ascontiguousarray(column, dtype=np.float64) for name, column in numbers.items()}, rows


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


def stretches(table: Table) -> list[slice]:
    """Rows without interruption, in order: one segment, and no step in t longer than LONGEST_STEP times `dt`."""
    if len(table) == 0:
        return []
    broken = (np.diff(table.segment) != 0.0) | (np.diff(table["t"]) > LONGEST_STEP * table.dt)
    edges = [0, *(np.flatnonzero(broken) + 1).tolist(), len(table)]
    return [slice(start, stop) for start, stop in pairwise(edges)]


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


def read_csv(content: bytes, path: Path) -> tuple[dict[str, Array], Rows]:
    """Columns of numbers, and where their rows are in the file. Blank lines are no rows. Raises TableError."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        line, got = content.count(b"\n", 0, problem.start) + 1, f"byte 0x{content[problem.start]:02x}"
        raise TableError(f"not a CSV file: got {got}, expected UTF-8 text", file=path, line=line) from None
    reader = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True)
    rows, lines, numbers, line = Rows(path, ()), list[int](), array("d"), 1
    try:
        for fields in reader:
            blank = not fields or (len(fields) == 1 and not fields[0].strip())
            if not blank and not rows.header:
                rows = Rows(path, lines, text, _header(fields, path, line))
            elif not blank:
                lines.append(line)
                if len(fields) != len(rows.header):
                    problem = f"got {len(fields)} fields, expected {len(rows.header)}"
                    raise TableError(problem, file=path, line=line)
                numbers.extend(_numbers(fields, rows))
            line = reader.line_num + 1
    except csv.Error as problem:
        raise TableError(f"not a CSV file: {problem}", file=path, line=line) from None
    values = np.array(numbers, dtype=np.float64).reshape(len(lines), len(rows.header))
    return {name: values[:, i].copy() for i, name in enumerate(rows.header) if name}, rows


def _header(fields: list[str], path: Path, line: int) -> tuple[str, ...]:
    """Names of the columns; "" for a column without a name, which is left out."""
    header = tuple(name.strip() for name in fields)
    twice = [name for i, name in enumerate(header) if name and name in header[:i]]
    if twice:
        raise TableError(f"got column {twice[0]!r} twice, expected each name once", file=path, line=line)
    return header


def _numbers(fields: list[str], rows: Rows) -> list[float]:
    """The numbers of the last row."""
    try:
        return [float(cell) for cell in fields]
    except ValueError:
        row = len(rows.lines) - 1
        return [_number(cell, name, row, rows) for cell, name in zip(fields, rows.header, strict=True)]


def _number(cell: Any, name: str, row: int, rows: Rows) -> float:
    """A cell as a number. An empty cell is NaN; text is refused in a known column, and NaN in another one."""
    try:
        return float(cell)
    except (TypeError, ValueError):
        if name in KNOWN and str(cell).strip().lower() not in MISSING:
            rows.refuse(name, row, "a number")
        return math.nan
