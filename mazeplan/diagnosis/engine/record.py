"""A record of a motion as it was measured: true times, gaps, empty cells; nothing is filtered or resampled.

Rows with the same time are merged. A gap is a step much longer than the usual one; inputs are unknown there, so no
simulation crosses it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.core import file_kinds
from mazeplan.core.errors import TableError
from mazeplan.core.logs.columns import ColumnSource, Rows, check_steps, select_columns
from mazeplan.core.logs.table import OTHERS, content_of, given_columns, read_csv
from mazeplan.core.records import Array

FEWEST = 60  # samples
GAP = 6.0  # usual steps; inputs that were not recorded for longer are unknown
DOUBLED = 0.05  # maximum share of rows that may repeat the time of the row before
FINEST = 1e-8  # share of its range that a sensor shows at best
SLOWEST = 5.0  # s; longer steps are another unit of time
NEIGHBOURS = 7  # samples of the local polynomial that measures the noise
# degree of the polynomial, and the median of its residual in multiples of white noise (chi distributions with 4, 2 and
# 1 degrees of freedom): a parabola takes a swing of ten samples for noise, a higher degree follows it
DEGREES = ((2, 0.916), (4, 0.833), (5, 0.674))


@dataclass(frozen=True)
class Record:
    """The record of a motion."""

    t: Array  # times (N,), s, from 0 on
    y: Array  # measured coordinates (N, C), NaN where not seen; angles have no jumps
    u: Array  # inputs (N, W)
    notes: tuple[str, ...] = field(default=())  # what was merged or left out
    means: bool = False  # whether the inputs of a row are means over the step that follows

    def __len__(self) -> int:
        return len(self.t)

    @property
    def seconds(self) -> float:
        """The length of the record."""
        return float(self.t[-1])

    @property
    def step(self) -> float:
        """The usual time between two samples, s."""
        return float(np.median(np.diff(self.t)))

    @property
    def stretches(self) -> list[tuple[int, int]]:
        """First row, and row behind the last one, of each part without a gap."""
        ends = np.flatnonzero(np.diff(self.t) > GAP * self.step) + 1 if self.u.shape[1] else []
        edges = [0, *ends, len(self)]
        return [(int(a), int(b)) for a, b in pairwise(edges) if b - a > 2]


def read_record(
    given: Any, positions: Sequence[str], units: Sequence[str], inputs: Sequence[str],
    columns: Mapping[str, ColumnSource] | None = None,
) -> Record:  # fmt: skip
    """The columns t, positions and inputs of a table. Cells of positions may be empty. Raises TableError.

    given: path of a CSV, or a table in memory (`given_columns`)"""
    if isinstance(given, str | Path):
        path = Path(given)
        expected = f"a table (CSV) with {', '.join(('t', *positions, *inputs))} in its first row"
        if not path.is_file() or file_kinds.got(path) in OTHERS:
            raise TableError(file_kinds.refused(path, expected), file=path)
        found, rows = read_csv(content_of(path), path)
    else:
        found, rows = given_columns(given)
        path = rows.file
    known = {"t": "s", **dict(zip(positions, units, strict=True))}
    found, named = select_columns(found, columns or {}, known, inputs, path)
    rows = replace(rows, named=named)
    for name in ("t", *positions, *inputs):
        if name not in found:
            raise TableError(f"column {name} is missing; there are {', '.join(found)}", file=path)
        bad = np.isinf(found[name]) if name in positions else ~np.isfinite(found[name])
        if bad.any():
            rows.refuse(name, int(np.argmax(bad)), "a finite number")
    y = np.column_stack([found[name] for name in positions])
    u = np.column_stack([found[name] for name in inputs] or [np.empty((len(y), 0))])
    return record_of(found["t"], y, u, units, rows, positions)


def record_of(
    t: Array, y: Array, u: Array, units: Sequence[str], rows: Rows, names: Sequence[str] = ("position",)
) -> Record:
    """A record of checked columns. Raises TableError with the row."""
    if len(t) < FEWEST:
        raise TableError(f"got {len(t)} samples, expected at least {FEWEST}", file=rows.file, key="t")
    notes, steps = [], np.diff(t)
    same = steps == 0.0
    check_steps(t, (steps < 0.0) | (same & (same.mean() > DOUBLED)), float(np.median(steps)), SLOWEST, rows)
    if same.any():
        notes.append(f"{same.sum()} rows have the time of the row before and were merged with it")
        group = np.cumsum(np.diff(t, prepend=-np.inf) > 0.0) - 1
        t = t[np.diff(t, prepend=-np.inf) > 0.0]
        y, u = (_means(x, group) for x in (y, u))
    y = y.copy()
    for i, (name, unit) in enumerate(zip(names, units, strict=True)):
        seen = np.flatnonzero(np.isfinite(y[:, i]))
        if len(seen) < FEWEST or np.ptp(y[seen, i]) == 0.0:
            got = f"{len(seen)} samples of one position" if len(seen) else "no position"
            raise TableError(f"got {got}, expected {FEWEST} at least of what moves", file=rows.file, key=name)
        if unit == "rad":
            y[seen, i] = np.unwrap(y[seen, i])
    record = Record(np.asarray(t - float(t[0]), dtype=np.float64), y, u)
    if gaps := len(record.stretches) - 1:
        notes.append(f"{gaps} gap{'s' * (gaps > 1)} in time: no simulation crosses them")
    return replace(record, notes=tuple(notes))


def _means(x: Array, group: np.ndarray) -> Array:
    """Means over the rows of each group, without empty cells."""
    out = np.full((int(group[-1]) + 1, x.shape[1]), np.nan)
    for i in range(x.shape[1]):
        seen = np.isfinite(x[:, i])
        total = np.bincount(group[seen], x[seen, i], len(out))
        count = np.bincount(group[seen], minlength=len(out))
        out[:, i] = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return out


def noise_of(record: Record) -> Array:
    """Standard deviation of the measurement noise of each coordinate (C,).

    It is the residual of local polynomials (median absolute deviation), of the degree that leaves least, and not less
    than that of rounding: the smallest change between samples over sqrt(12)."""
    out, half = [], NEIGHBOURS // 2
    for y in record.y.T:
        seen = np.isfinite(y)
        t, x = record.t[seen], y[seen]
        index = np.arange(half, len(x) - half)[:, None] + np.arange(-half, half + 1)
        near = (t[index] - t[index[:, half]][:, None]) / record.step
        close = near[:, -1] - near[:, 0] < 1.5 * NEIGHBOURS
        out.append(min(_left_by(degree, near[close], x[index][close]) / share for degree, share in DEGREES))
    return np.maximum(out, least_noise(record))


def least_noise(record: Record) -> Array:
    """The noise of each coordinate (C,) that rounding causes, and at least FINEST of its range."""
    seen = [y[np.isfinite(y)] for y in record.y.T]
    return np.array([max(resolution(x) / np.sqrt(12.0), FINEST * float(np.ptp(x))) for x in seen])


def _left_by(degree: int, near: Array, x: Array) -> float:
    """Median rms residual of polynomials through windows x (N, NEIGHBOURS) at times `near`; 0 if nothing moves."""
    q, _ = np.linalg.qr(near[:, :, None] ** np.arange(degree + 1))
    z = x - x.mean(axis=1, keepdims=True)
    left = z - np.einsum("nij,nj->ni", q, np.einsum("nij,ni->nj", q, z))
    rms = np.sqrt(np.sum(left**2, axis=1) / (NEIGHBOURS - 1 - degree))
    moving = rms[rms > 1e-12 * float(np.ptp(x) if x.size else 0.0)]
    return float(np.median(moving)) if len(moving) else 0.0


def resolution(x: Array) -> float:
    """The step of rounded values; 0 if values are not multiples of one step."""
    values = np.unique(x)
    if len(values) < 3:
        return 0.0
    gaps = np.diff(values)
    gaps = gaps[gaps > 1e-9 * float(np.ptp(x))]
    if not len(gaps):
        return 0.0
    usual = float(np.quantile(gaps, 0.05))
    steps = (usual, usual / 2.0, usual / 3.0)  # an encoder that turns fast skips values
    fits = (step for step in steps if float(np.mean(np.abs(gaps / step - np.round(gaps / step)) < 0.02)) > 0.9)
    return next(fits, 0.0)
