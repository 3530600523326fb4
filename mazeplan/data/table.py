"""Tables of measurements: columns of equal length, from run logs or from CSV that a user brings.

Known columns, SI units and radians: t theta r x y beta gamma u_beta u_gamma segment ring. Needed: t, beta, gamma,
and theta or x, y. Unknown
columns are kept. A sample in which the ball was not seen has NaN in x, y, theta.
"""

from __future__ import annotations

import csv
import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mazeplan.data.runlog import read_log
from mazeplan.errors import TableError
from mazeplan.records import Array

BALL = ("x", "y", "theta", "r")  # may be missing in single rows: the ball was not seen
DEGREES = 1.0  # rad; a plate that is said to tilt further was measured in degrees


@dataclass(frozen=True)
class Table:
    """Columns (N,) by name; `source`: file and sha256 of what it was read from."""

    columns: dict[str, Array]
    source: dict[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.columns["t"])

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    @property
    def segment(self) -> Array:
        """Number of the uninterrupted stretch of each row; 0 everywhere when the table does not say."""
        return self.columns.get("segment", np.zeros(len(self)))


def _checked(columns: dict[str, Array], file: Path, lines: Sequence[int]) -> dict[str, Array]:
    for name in ("t", "beta", "gamma"):
        if name not in columns:
            raise TableError(f"column {name} is missing; there are {', '.join(columns) or 'none'}", file=file)
    if "theta" not in columns and not {"x", "y"} <= set(columns):
        raise TableError(f"needs theta, or x and y; there are {', '.join(columns)}", file=file)
    if len(columns["t"]) < 2:
        raise TableError(f"got {len(columns['t'])} rows, expected at least 2", file=file)
    for name, values in columns.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size and name in ("t", "beta", "gamma", "u_beta", "u_gamma", "segment", "ring"):
            raise TableError(f"{name}: no finite number", file=file, line=lines[int(bad[0])])
    segment = columns.get("segment", np.zeros(len(columns["t"])))
    back = np.flatnonzero((np.diff(columns["t"]) <= 0.0) & (np.diff(segment) == 0.0))
    if back.size:
        row = int(back[0]) + 1
        raise TableError(
            f"t: got {columns['t'][row]:g} after {columns['t'][row - 1]:g}, expected it to grow",
            file=file, line=lines[row],
        )  # fmt: skip
    for name in ("beta", "gamma", "u_beta", "u_gamma"):
        if name in columns and np.max(np.abs(columns[name])) > DEGREES:
            row = int(np.argmax(np.abs(columns[name])))
            raise TableError(
                f"{name}: got {columns[name][row]:g}, expected radians (at most {DEGREES:g}); are these degrees?",
                file=file, line=lines[row],
            )  # fmt: skip
    if {"x", "y"} <= set(columns):
        columns.setdefault("theta", np.arctan2(columns["y"], columns["x"]))
        columns.setdefault("r", np.hypot(columns["x"], columns["y"]))
    elif {"theta", "r"} <= set(columns):
        columns["x"], columns["y"] = columns["r"] * np.cos(columns["theta"]), columns["r"] * np.sin(columns["theta"])
    return columns


def read_table(path: str | Path) -> Table:
    """A table from a run log (.mcap) or CSV. Raises TableError or LogError with file and row."""
    path = Path(path)
    if not path.is_file():
        raise TableError("no such file", file=path)
    if path.suffix == ".mcap":
        log = read_log(path)
        numeric = {name: column for name, column in log.ticks.items() if column.dtype != object}
        columns = _checked(numeric, path, range(1, 1 + len(log.ticks.get("t", ()))))
    else:
        columns, lines = _read_csv(path)
        columns = _checked(columns, path, lines)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return Table(columns, {"file": path.name, "sha256": digest})


def _read_csv(path: Path) -> tuple[dict[str, Array], list[int]]:
    """Columns, and the line of each row: lines without anything on them are no rows."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = csv.reader(stream)
            header = [name.strip() for name in next(rows, [])]
            if not header or len(set(header)) != len(header):
                raise TableError("expected a header row with each name once", file=path, line=1)
            values: list[list[float]] = []
            lines: list[int] = []
            for row in rows:
                if row:
                    values.append(_numbers(row, header, path, rows.line_num))
                    lines.append(rows.line_num)
    except (UnicodeDecodeError, csv.Error, OSError) as problem:
        raise TableError(f"not a CSV file: {problem}", file=path) from None
    array = np.array(values, dtype=float).reshape(-1, len(header))
    return {name: np.ascontiguousarray(array[:, i]) for i, name in enumerate(header)}, lines


def _numbers(row: Sequence[str], header: Sequence[str], path: Path, line: int) -> list[float]:
    if len(row) != len(header):
        raise TableError(f"got {len(row)} fields, expected {len(header)}", file=path, line=line)
    out = []
    for name, text in zip(header, row, strict=True):
        try:
            out.append(float(text) if text.strip() else math.nan)
        except ValueError:
            if name in ("leaf", "opening"):  # text columns of our own exports
                out.append(math.nan)
                continue
            raise TableError(f"{name}: got {text[:40]!r}, expected a number", file=path, line=line) from None
    return out


def join(tables: Sequence[Table]) -> Table:
    """All tables one below the other, with segments that stay apart; columns that all of them have."""
    names = [name for name in tables[0].columns if all(name in table for table in tables)]
    columns = {name: np.concatenate([table[name] for table in tables]) for name in names}
    numbers, offset = [], 0.0
    for table in tables:
        numbers.append(table.segment - table.segment.min() + offset)
        offset = float(numbers[-1].max()) + 1.0
    columns["segment"] = np.concatenate(numbers)
    return Table(columns)
