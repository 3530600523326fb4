"""The columns of a table: their names and units in a user's file, and the checks of what they hold.

A column is named by `NAME=COLUMN[:UNIT]`, or its name has a suffix as in `t_ms`, `x_mm`, `beta_deg`."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import NoReturn

import numpy as np

from mazeplan.core.errors import InputError, TableError, one_of
from mazeplan.core.records import Array

BALL = ("x", "y", "theta", "r")  # may be missing in single rows: the ball was not seen
RATES = tuple(f"{name}_{order}" for order in ("dot", "ddot") for name in ("theta", "beta", "gamma"))
TILTS = ("beta", "gamma")
EVERYWHERE = ("t", "beta", "gamma", "u_beta", "u_gamma", "segment", "ring")  # if present, a number in each row
KNOWN = (*EVERYWHERE, *BALL, *RATES)
SI_UNITS = {  # of the known columns
    "t": "s", **dict.fromkeys(("x", "y", "r"), "m"),
    **dict.fromkeys(("theta", "beta", "gamma", "u_beta", "u_gamma"), "rad"),
    **{name: "rad/s2" if name.endswith("ddot") else "rad/s" for name in RATES},
    "segment": "", "ring": "",
}  # fmt: skip

DEGREES = 1.0  # rad; a larger tilt was measured in degrees
MILLIMETRES = 1.0  # m; a ball further out than this was measured in millimetres: the largest track is 0.09 m
SPINNING = 20.0  # rad/s; if half of all rows are faster (over LAG_S), the angle is in degrees
SLOWEST = 0.5  # s, maximum step; after a longer step, a rolling ball is somewhere else
LAG_S = 0.1  # s; long enough that noise of the camera does not look like speed

# factor to the SI unit, and that unit, by the name of a unit
UNITS: dict[str, tuple[float, str]] = {
    "s": (1.0, "s"), "ms": (1e-3, "s"), "us": (1e-6, "s"), "ns": (1e-9, "s"), "min": (60.0, "s"),
    "m": (1.0, "m"), "cm": (1e-2, "m"), "mm": (1e-3, "m"), "um": (1e-6, "m"),
    "rad": (1.0, "rad"), "mrad": (1e-3, "rad"), "deg": (math.pi / 180.0, "rad"), "rev": (2.0 * math.pi, "rad"),
    "N": (1.0, "N"), "mN": (1e-3, "N"), "kN": (1e3, "N"), "V": (1.0, "V"), "mV": (1e-3, "V"),
    "rad/s": (1.0, "rad/s"), "deg/s": (math.pi / 180.0, "rad/s"),
    "rad/s2": (1.0, "rad/s2"), "deg/s2": (math.pi / 180.0, "rad/s2"),
    "Nm": (1.0, "N m"), "mNm": (1e-3, "N m"), "Ncm": (1e-2, "N m"), "A": (1.0, "A"), "mA": (1e-3, "A"),
}  # fmt: skip
SUFFIXES = ("ms", "us", "ns", "cm", "mm", "deg", "mrad")  # of names of columns


@dataclass(frozen=True)
class ColumnSource:
    """Where a column is in a file. column: its name there; unit: as text, empty for the SI unit"""

    column: str
    unit: str = ""


def parse_columns(texts: Iterable[str] | Mapping[str, str]) -> dict[str, ColumnSource]:
    """The columns that `--columns NAME=COLUMN[:UNIT]` names; one text may hold several, with blanks between them.

    texts: for Python also {NAME: "COLUMN[:UNIT]"}

    Raises InputError."""
    texts = [f"{name}={source}" for name, source in texts.items()] if isinstance(texts, Mapping) else texts
    found: dict[str, ColumnSource] = {}
    for text in (part for whole in texts for part in whole.split()):
        name, equals, source = text.partition("=")
        column, _, unit = source.rpartition(":") if source.rpartition(":")[2] in UNITS else (source, "", "")
        if not (name and equals and column):
            raise InputError(f"--columns: got {text!r}, expected NAME=COLUMN[:UNIT], such as t=time_ms:ms")
        if ":" in column:
            raise InputError(f"--columns: got unit {column.rpartition(':')[2]!r}, expected one of {', '.join(UNITS)}")
        if name in found:
            raise InputError(f"--columns: got {name} twice, expected it once")
        found[name] = ColumnSource(column, unit)
    return found


def select_columns(
    there: Mapping[str, Array], given: Mapping[str, ColumnSource], units: Mapping[str, str], others: Sequence[str],
    file: Path,
) -> tuple[dict[str, Array], dict[str, str]]:  # fmt: skip
    """The columns of a file by the names that a program knows, in SI units, and the names in the file of the others.

    units: SI unit of each known column; others: known columns of any unit. Raises TableError."""
    out, named = dict(there), dict[str, str]()
    for name, source in given.items():
        if name not in (known := (*units, *others)):
            raise InputError(f"--columns: got name {name!r}, expected {one_of(known, name)}")
        if source.column not in there:
            problem = f"--columns: column {source.column} is missing; there are {', '.join(there)}"
            raise TableError(problem, file=file)
        factor, unit = UNITS[source.unit] if source.unit else _of_suffix(source.column)
        if unit and name in units and unit != units[name]:
            raise TableError(f"--columns {name}: got a unit of {unit}, expected one of {units[name]}", file=file)
        out[name] = factor * there[source.column] if factor != 1.0 else there[source.column]
        named[name] = source.column
    for name in (*units, *others):
        if name in out:
            continue
        for suffix in SUFFIXES:
            factor, unit = UNITS[suffix]
            if f"{name}_{suffix}" in there and units.get(name, unit) == unit:
                out[name], named[name] = factor * there[f"{name}_{suffix}"], f"{name}_{suffix}"
    return out, named


def _of_suffix(column: str) -> tuple[float, str]:
    """Factor and SI unit of a name such as t_ms; 1 and "" without such a suffix."""
    stem, _, suffix = column.rpartition("_")
    return UNITS[suffix] if stem and suffix in SUFFIXES else (1.0, "")


@dataclass(frozen=True)
class Rows:
    """Where the rows of a table are in its file, for messages."""

    file: Path
    lines: Sequence[int]  # of each row
    text: str = ""  # content of a CSV file
    header: tuple[str, ...] = ()  # names of its columns
    named: Mapping[str, str] = field(default_factory=dict)  # names in the file of columns that have another name there

    def refuse(self, name: str, row: int, expected: str, got: object = None) -> NoReturn:
        """Raise TableError about one cell. got: the cell's value for the message; by default the text in the file."""
        line, name = int(self.lines[row]), self.named.get(name, name)
        if got is None and self.text:
            rest = islice(io.StringIO(self.text, newline=""), line - 1, None)
            cell = next(csv.reader(rest, skipinitialspace=True))[self.header.index(name)].strip()
            got = repr(cell[:40]) if cell else "an empty cell"
        raise TableError(f"got {got or 'no value'}, expected {expected}", file=self.file, line=line, key=name)


def checked(columns: dict[str, Array], rows: Rows) -> dict[str, Array]:
    """The columns, with theta, r, x, y computed where possible. Raises TableError."""
    _check_present(columns, rows)
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


def _check_present(columns: dict[str, Array], rows: Rows) -> None:
    file, names = rows.file, list(rows.header or columns)
    there = ", ".join(names[:30]) + (f" and {len(names) - 30} more" if len(names) > 30 else "")
    missing = [name for name in ("t", "beta", "gamma") if name not in columns]
    missing += ["theta (or x and y)"] if "theta" not in columns and not {"x", "y"} <= set(columns) else []
    if missing:
        problem = f"missing columns: {', '.join(missing)}; there are {there or 'none'}"
        raise TableError(f"{problem}; others: --columns NAME=COLUMN[:UNIT]", file=file)
    if len(columns["t"]) < 2:
        raise TableError(f"got {len(columns['t'])} rows, expected at least 2: record for longer", file=file)


def _unmeasured(columns: dict[str, Array]) -> bool:
    """Whether the rig has no tilt sensor: commands, but no tilt in any row."""
    there = all(name in columns for name in ("u_beta", "u_gamma"))
    return there and not any(np.isfinite(columns[name]).any() for name in TILTS)


def _usual_step(t: Array, segment: Array) -> float:
    steps = np.diff(t)[np.diff(segment) == 0.0]
    return float(np.median(steps)) if steps.size else float("nan")


def _first(bad: np.ndarray) -> int:
    """Index of the first True, -1 when there is none."""
    return int(np.argmax(bad)) if bad.any() else -1


def _check_numbers(columns: dict[str, Array], rows: Rows) -> None:
    for name, column in columns.items():
        if name in EVERYWHERE and not (name in TILTS and _unmeasured(columns)):
            bad, expected = ~np.isfinite(column), "a finite number"
        else:
            bad, expected = np.isinf(column) & (name in KNOWN), "a finite number, or an empty cell"
        if (row := _first(bad)) >= 0:
            rows.refuse(name, row, expected)
        if name in ("segment", "ring") and (row := _first(column != np.round(column))) >= 0:
            rows.refuse(name, row, "a whole number", f"{column[row]:g}")
        if name == "r" and (row := _first(column < 0.0)) >= 0:
            rows.refuse(name, row, "at least 0 m", f"{column[row]:g}")


def _check_time(columns: dict[str, Array], rows: Rows) -> None:
    t, segment = columns["t"], columns.get("segment", np.zeros(len(columns["t"])))
    check_steps(t, (np.diff(t) <= 0.0) & (np.diff(segment) == 0.0), _usual_step(t, segment), SLOWEST, rows)


def check_steps(t: Array, wrong: np.ndarray, usual: float, slowest: float, rows: Rows) -> None:
    """Raise TableError for times (N,) with a step that is wrong (N - 1,), or whose usual step is above `slowest`, s."""
    row = 1 + _first(wrong)
    if row > 0:
        rows.refuse("t", row, "it to grow", f"{float(t[row])!r} after {float(t[row - 1])!r}")
    if usual > slowest:
        hint = f"for another unit: --columns t={rows.named.get('t', 't')}:ms"
        rows.refuse("t", 1, f"at most {slowest:g} s from sample to sample; {hint}", f"steps of {usual:g} (median)")


def _check_units(columns: dict[str, Array], rows: Rows) -> None:
    angles, lengths = ("beta", "gamma", "u_beta", "u_gamma"), ("x", "y", "r")
    checks = [(name, f"radians (at most {DEGREES:g})", DEGREES, "deg") for name in angles]
    checks += [(name, f"metres (at most {MILLIMETRES:g})", MILLIMETRES, "mm") for name in lengths]
    if "theta" in columns and _in_degrees(columns):
        checks.append(("theta", "radians; these are degrees", 0.0, "deg"))
    for name, expected, most, unit in checks:
        size = np.nan_to_num(np.abs(columns.get(name, np.zeros(1))))
        row = int(np.argmax(size))
        if size[row] > most:
            remedy = f"other units: --columns {name}={rows.named.get(name, name)}:{unit}"
            if rows.file.suffix == ".mcap":  # its units are those of the rig's class
                remedy = "the rig has to give SI units"
            rows.refuse(name, row, f"{expected}; {remedy}", f"{columns[name][row]:g}")


def _in_degrees(columns: dict[str, Array]) -> bool:
    """Whether theta is certainly an angle in degrees; an unwrapped angle in radians may be as large.

    theta is in degrees if it agrees with x, y in degrees only. Otherwise theta must leave +-2 pi. In addition, it must
    have only whole numbers, or jump by about 360, or in half of all rows change faster than a ball can roll.
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
    usual = _usual_step(t, segment)  # not finite if each row is a segment
    lag = max(1, round(LAG_S / usual)) if np.isfinite(usual) else len(t)
    if lag >= len(t):
        return False
    speed = np.abs(theta[lag:] - theta[:-lag]) / (t[lag:] - t[:-lag])
    speed = speed[np.isfinite(speed) & (segment[lag:] == segment[:-lag])]
    return bool(speed.size) and float(np.median(speed)) > SPINNING
