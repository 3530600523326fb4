"""Schedules of faults, from YAML: what is to go wrong, when, how long, how strongly.

    faults:
      - kind: frames_lost          # one of faultkinds.KINDS
        at_s: [0.3, 1.5]           # a number, or least and most: each run draws between them by its seed
        duration_s: 0.8            # left out: as the kind has it
      - {kind: servo_slow, size: 10, axis: beta, name: tired servo}

An entry is a trial of its own; entries of one `name` act together in one run.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError
from pydantic_core import PydanticCustomError

from mazeplan.errors import SettingsError
from mazeplan.maze.yamltree import Key, Tree, key_path, read_yaml, shown
from mazeplan.rigs.faultkinds import AT_S, KINDS, Kind, Range
from mazeplan.rigs.settings import Section

MOST = 1e3  # of any number in a schedule


def _range(value: Any) -> Any:
    pair = value if isinstance(value, list | tuple) else (value, value)
    numbers = [v for v in pair if isinstance(v, int | float) and not isinstance(v, bool) and 0.0 <= v <= MOST]
    if len(numbers) != 2 or len(pair) != 2 or numbers[0] > numbers[1]:
        raise PydanticCustomError("range", "a number of 0 to 1000, or [least, most] of such")
    return float(numbers[0]), float(numbers[1])


Numbers = Annotated[Range, BeforeValidator(_range)]


class Entry(Section):
    """One fault of a schedule; what is None is as its kind has it."""

    kind: str
    name: str | None = Field(default=None, min_length=1, max_length=60)
    at_s: Numbers = AT_S
    duration_s: Numbers | None = None
    size: Numbers | None = None
    axis: Literal["beta", "gamma", "both"] | None = None


class Schedule(Section):
    """A whole file."""

    faults: tuple[Entry, ...]


@dataclass(frozen=True)
class Drawn:
    """One fault of one run: of a kind, acting at at_s <= t < until_s; axis: 0 beta, 1 gamma; seed: of its chance."""

    kind: Kind
    at_s: float
    until_s: float
    size: float
    axes: tuple[int, ...]
    seed: int

    def acts(self, t: float) -> bool:
        """Whether it acts at time t."""
        return self.at_s <= t < self.until_s

    def to_json(self) -> dict[str, Any]:
        """For the report of a run; a fault for good has no duration."""
        lasting = math.isinf(self.until_s)
        return {
            "kind": self.kind.name,
            "at_s": round(self.at_s, 4),
            "duration_s": None if lasting else round(self.until_s - self.at_s, 4),
            "size": round(self.size, 4) if self.kind.size is not None else None,
            "unit": self.kind.unit or None,
        }


@dataclass(frozen=True)
class Trial:
    """Faults that act together in one run, under one name."""

    name: str
    entries: tuple[Entry, ...]

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """Of its faults."""
        return tuple(KINDS[entry.kind] for entry in self.entries)

    def to_json(self) -> dict[str, Any]:
        """All that determines it."""
        return {"name": self.name, "entries": [entry.model_dump() for entry in self.entries]}

    def draw(self, seed: int) -> tuple[Drawn, ...]:
        """The faults of the run with this seed: other seeds, other moments, lengths and sizes."""
        return tuple(_drawn(entry, seed, number) for number, entry in enumerate(self.entries))


def every_kind() -> tuple[Trial, ...]:
    """A trial for each kind."""
    return tuple(Trial(name, (Entry(kind=name),)) for name in KINDS)


def at_once(kind: str, now: float, seed: int) -> Drawn:
    """A fault that begins at rig time now, as long and as strong as its kind has it."""
    drawn = _drawn(Entry(kind=kind), seed, 0)
    return replace(drawn, at_s=now, until_s=drawn.until_s + now - drawn.at_s)


def _drawn(entry: Entry, seed: int, number: int) -> Drawn:
    kind = KINDS[entry.kind]
    rng = np.random.default_rng([seed, zlib.crc32(entry.kind.encode()), number])

    def between(given: Range) -> float:
        share = float(rng.random())  # drawn in any case, so that one number in a file does not shift the others
        return given[0] if given[0] == given[1] else given[0] + share * (given[1] - given[0])

    at = between(entry.at_s)
    duration = between(entry.duration_s or kind.duration_s)
    size = between(entry.size or kind.size or (0.0, 0.0))
    axis = int(rng.integers(2))
    axes = {None: (axis,), "beta": (0,), "gamma": (1,), "both": (0, 1)}[entry.axis]
    return Drawn(kind, at, at + duration, size, axes, int(rng.integers(2**31)))


def load_schedule(path: str | Path) -> tuple[Trial, ...]:
    """The trials of a file, in its order. Raises SettingsError with file, line and key."""
    file = Path(path)
    tree = read_yaml(file, error=SettingsError, what="a schedule of faults (YAML)")
    if not isinstance(tree.data, dict):
        raise SettingsError(f"got {shown(tree.data)}, expected `faults:` and a list", file=file, line=1)
    try:
        entries = Schedule.model_validate({key: _tuple(value) for key, value in tree.data.items()}).faults
    except ValidationError as problem:
        first = problem.errors()[0]
        key: Key = tuple(part for part in first["loc"] if not str(part).startswith("function-"))
        raise _at(file, tree, key, _sentence(first, key)) from None
    if not entries:
        raise _at(file, tree, ("faults",), "got nothing, expected at least one fault")
    for i, entry in enumerate(entries):
        if entry.kind not in KINDS:
            allowed = ", ".join(KINDS)
            raise _at(file, tree, ("faults", i, "kind"), f"got {shown(entry.kind)}, expected one of {allowed}")
        if entry.size is not None:
            _check_size(file, tree, i, entry.size, KINDS[entry.kind])
    return _trials(entries)


def _check_size(file: Path, tree: Tree, index: int, size: Range, kind: Kind) -> None:
    key, (least, most) = ("faults", index, "size"), kind.allowed
    if kind.size is None:
        raise _at(file, tree, key, f"{kind.name} has no size")
    for value in size:
        if not least <= value <= most:
            raise _at(file, tree, key, f"got {value:g}, expected {least:g} to {most:g} {kind.unit}")


def _trials(entries: Sequence[Entry]) -> tuple[Trial, ...]:
    together: dict[str, list[Entry]] = {}
    for entry in entries:
        name = entry.name or entry.kind
        if entry.name is None:  # two entries of a kind without names are two trials
            name = next(
                n for n in (name, *(f"{name} {k}" for k in range(2, 1 + 2 * len(entries)))) if n not in together
            )
        together.setdefault(name, []).append(entry)
    return tuple(Trial(name, tuple(members)) for name, members in together.items())


def _tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _at(file: Path, tree: Tree, key: Key, problem: str) -> SettingsError:
    return SettingsError(problem, file=file, line=tree.line(key), key=key_path(key) or None)


def _sentence(error: Any, key: Key) -> str:
    if error["type"] == "extra_forbidden":
        fields = Entry.model_fields if len(key) > 1 else Schedule.model_fields
        return f"unknown key, expected one of {', '.join(fields)}"
    if error["type"] == "missing":
        return "is missing, expected a list of faults" if key == ("faults",) else "it is missing"
    if error["type"] in ("model_type", "dict_type"):
        return f"got {shown(error.get('input'))}, expected `kind: ...`"
    expected = str(error["msg"]).removeprefix("Input should be ")
    return f"got {shown(error.get('input'))}, expected {expected}"
