"""Records of a motion with one degree of freedom. There are two kinds of files: a table (CSV) of position and inputs,
and the MATLAB file of the public benchmark EMPS (electro-mechanical positioning system), a motor-driven axis:

    qm    measured position, m         vir   control voltage, V
    gtau  drive gain, N/V              t     time, s

A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS", Workshop on Nonlinear System Identification
Benchmarks, 2019. Other variables of the file are ignored. The program parses the file and runs nothing in it.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.core import file_kinds
from mazeplan.core.errors import TableError
from mazeplan.core.logs.table import OTHERS, content_of, read_csv
from mazeplan.core.records import Array

COLUMNS, GAIN = ("t", "qm", "vir"), "gtau"
FEWEST = 1000  # samples
FEWEST_ROWS = 100  # of a table
UNEVEN = 0.1  # share of the mean time step by which one step may differ


@dataclass(frozen=True)
class MotionLog:
    """The record of a motion.

    dt: time between samples, s
    position: measured positions (N,), NaN where not seen; angles have no jumps
    inputs: measured inputs (N, W)
    gain: of a drive, N/V"""

    dt: float
    position: Array
    inputs: Array
    gain: float = 1.0

    def __len__(self) -> int:
        return len(self.position)


def read_motion(path: Path, position: str, inputs: Sequence[str], unit: str) -> MotionLog:
    """The columns t, position and inputs of a table (CSV). Cells of the position may be empty. Raises TableError."""
    expected = f"a table (CSV) with {', '.join(('t', position, *inputs))} in its first row"
    if not path.is_file() or file_kinds.got(path) in OTHERS:
        raise TableError(file_kinds.refused(path, expected), file=path)
    columns, rows = read_csv(content_of(path), path)
    for name in ("t", position, *inputs):
        if name not in columns:
            raise TableError(f"column {name} is missing; there are {', '.join(columns)}", file=path)
        bad = np.isinf(columns[name]) if name == position else ~np.isfinite(columns[name])
        if bad.any():
            rows.refuse(name, int(np.argmax(bad)), "a finite number")
    dt, x = _step(path, columns["t"], FEWEST_ROWS), columns[position].copy()
    seen = np.flatnonzero(np.isfinite(x))
    if len(seen) < FEWEST_ROWS or np.ptp(x[seen]) == 0.0:
        problem = f"got {len(seen)} samples of one position" if len(seen) else "got no position"
        raise TableError(f"{problem}, expected {FEWEST_ROWS} at least of what moves", file=path, key=position)
    if unit == "rad":
        x[seen] = np.unwrap(x[seen])
    first = int(seen[0])
    return MotionLog(dt, x[first:], np.column_stack([columns[name] for name in inputs] or [x[:, None][:, :0]])[first:])


def read_drive(path: Path, gain: float | None = None) -> MotionLog:
    """The record in a .mat file (MATLAB 4 to 7.2). Its input is the force (N): gain of the drive times voltage.

    gain: of the drive, N/V, for a file without a gain
    Raises TableError: file, variable, what was got, what is allowed."""
    found = _variables(path)
    if gain is not None:
        found.setdefault(GAIN, np.array([gain]))
    for name in (*COLUMNS, GAIN):
        if name not in found:
            problem = f"got only {', '.join(sorted(found)) or 'other variables'}, expected t, qm, vir and gtau"
            raise TableError(problem, file=path, key=name)
    t, position, volts = (_column(path, name, found[name]) for name in COLUMNS)
    for name, column in (("qm", position), ("vir", volts)):
        if len(column) != len(t):
            raise TableError(f"got {len(column)} samples, expected {len(t)} as in t", file=path, key=name)
    dt = _step(path, t, FEWEST)
    _moves(path, position, volts)
    gains = _column(path, GAIN, found[GAIN])
    if len(gains) != 1 or gains[0] == 0.0:
        got = f"{len(gains)} values" if len(gains) != 1 else "0"
        raise TableError(f"got {got}, expected one number other than 0, in N/V", file=path, key=GAIN)
    return MotionLog(dt, position, float(gains[0]) * volts[:, None], float(gains[0]))


def _step(path: Path, t: Array, fewest: int) -> float:
    """The time from each sample to the next, s."""
    if len(t) < fewest:
        raise TableError(f"got {len(t)} samples, expected at least {fewest}", file=path, key="t")
    steps = np.diff(t)
    dt = float(np.mean(steps))
    if not (dt > 0.0 and np.max(np.abs(steps - dt)) < UNEVEN * dt):
        problem = f"got steps of {steps.min():g} to {steps.max():g} s, expected samples at one rate"
        raise TableError(problem, file=path, key="t")
    return dt


def _moves(path: Path, position: Array, volts: Array) -> None:
    """Raise TableError if position or voltage is constant: nothing can be learned then."""
    for name, column, unit in (("qm", position, "m"), ("vir", volts, "V")):
        if np.ptp(column) == 0.0:
            problem = f"got {column[0]:g} {unit} throughout, expected an axis that moves under changing forces"
            raise TableError(problem, file=path, key=name)


def _variables(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat

    expected = "a .mat file (MATLAB 4 to 7.2) of the benchmark EMPS"
    if not path.is_file() or not path.stat().st_size:
        raise TableError(file_kinds.refused(path, expected), file=path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # warnings about other variables
            found = loadmat(path, variable_names=[*COLUMNS, GAIN])
    except Exception as error:  # for a damaged file, the reader may raise anything
        kind = file_kinds.got(path)
        reason = f" ({str(error).splitlines()[0] if str(error) else type(error).__name__})"
        raise TableError(f"got {kind}{reason if 'MATLAB' in kind else ''}, expected {expected}", file=path) from None
    return {name: value for name, value in found.items() if not name.startswith("__")}


def _column(path: Path, name: str, value: Any) -> Array:
    """A vector (N,) of finite numbers."""
    got = np.asarray(value)
    if got.dtype.kind not in "fiu" or got.size != max(got.shape, default=0):
        raise TableError(
            f"got {got.dtype} of shape {got.shape}, expected a column of real numbers", file=path, key=name
        )
    out = got.astype(np.float64).ravel()
    if not np.isfinite(out).all():
        bad = int(np.flatnonzero(~np.isfinite(out))[0])
        raise TableError(f"got {out[bad]} at sample {bad + 1}, expected finite numbers", file=path, key=name)
    return out
