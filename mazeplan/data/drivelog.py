"""Records of a motor-driven axis: the MATLAB file of the public benchmark EMPS (electro-mechanical positioning system).

    qm    measured position, m         vir   control voltage, V
    gtau  drive gain, N/V              t     time, s

A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS", Workshop on Nonlinear System Identification
Benchmarks, 2019. Other variables of the file are not looked at. The file is parsed, nothing in it is run.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan import filekinds
from mazeplan.errors import TableError
from mazeplan.records import Array

COLUMNS, GAIN = ("t", "qm", "vir"), "gtau"
FEWEST = 1000  # samples
UNEVEN = 0.1  # of a step, by which one step may differ from the others


@dataclass(frozen=True)
class DriveLog:
    """dt: s; position, force (N,): m, N as the drive gain (N/V) makes it from the voltage."""

    dt: float
    position: Array
    force: Array
    gain: float

    def __len__(self) -> int:
        return len(self.position)


def read_drive(path: Path, gain: float | None = None) -> DriveLog:
    """The record in a .mat file (MATLAB 4 to 7.2); gain: that of the drive (N/V), where the file has none. Raises
    TableError: file, variable, what was got, what is allowed."""
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
    if len(t) < FEWEST:
        raise TableError(f"got {len(t)} samples, expected at least {FEWEST}", file=path, key="t")
    steps = np.diff(t)
    dt = float(np.mean(steps))
    if not (dt > 0.0 and np.max(np.abs(steps - dt)) < UNEVEN * dt):
        problem = f"got steps of {steps.min():g} to {steps.max():g} s, expected samples at one rate"
        raise TableError(problem, file=path, key="t")
    _moves(path, position, volts)
    gains = _column(path, GAIN, found[GAIN])
    if len(gains) != 1 or gains[0] == 0.0:
        got = f"{len(gains)} values" if len(gains) != 1 else "0"
        raise TableError(f"got {got}, expected one number other than 0, in N/V", file=path, key=GAIN)
    return DriveLog(dt, position, float(gains[0]) * volts, float(gains[0]))


def _moves(path: Path, position: Array, volts: Array) -> None:
    """Raise where nothing can be learned."""
    for name, column, unit in (("qm", position, "m"), ("vir", volts, "V")):
        if np.ptp(column) == 0.0:
            problem = f"got {column[0]:g} {unit} throughout, expected an axis that moves under changing forces"
            raise TableError(problem, file=path, key=name)


def _variables(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat

    expected = "a .mat file (MATLAB 4 to 7.2) of the benchmark EMPS"
    if not path.is_file() or not path.stat().st_size:
        raise TableError(filekinds.refused(path, expected), file=path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of variables that are not ours
            found = loadmat(path, variable_names=[*COLUMNS, GAIN])
    except Exception as error:  # a damaged file raises whatever its reader stumbles over
        kind = filekinds.got(path)
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
