"""Names and units of a user's columns: `NAME=COLUMN[:UNIT]`, or a suffix as in `t_ms`, `x_mm`, `beta_deg`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mazeplan.core.errors import InputError, TableError, one_of
from mazeplan.core.records import Array

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
