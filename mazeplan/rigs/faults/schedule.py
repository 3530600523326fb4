"""Schedules of faults, from YAML: which faults, when, how long, how strong.

    faults:
      - kind: frames_lost          # one of kinds.KINDS
        at_s: [0.3, 1.5]           # a number, or minimum and maximum: each run draws between them by its seed
        duration_s: 0.8            # default: the duration of the kind
      - {kind: servo_slow, size: 10, axis: beta, name: tired servo}

Each entry is a trial. Entries with the same `name` are one trial: their faults act together in one run.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, field_validator

from mazeplan.core.errors import SettingsError, one_of
from mazeplan.maze.sections import Section, as_tuples, read_section
from mazeplan.maze.yamltree import Tree, read_yaml, shown
from mazeplan.rigs.faults.kinds import AT_S, KINDS, Drawn, FaultKind, Range

MAX_TIME_S = 1e3  # s, maximum of any time in a schedule


def _pair(value: Any) -> Any:
    """A single number as its own least and most."""
    return tuple(value) if isinstance(value, list | tuple) else (value, value)


def _ordered(pair: Range) -> Range:
    if pair[0] > pair[1]:
        raise ValueError(f"got [{pair[0]:g}, {pair[1]:g}], expected [least, most], the smaller number first")
    return pair


Time = Annotated[float, Field(ge=0.0, le=MAX_TIME_S)]
Times = Annotated[tuple[Time, Time], BeforeValidator(_pair), AfterValidator(_ordered)]
Sizes = Annotated[Range, BeforeValidator(_pair), AfterValidator(_ordered)]  # `FaultKind.allowed` has their limits


class Entry(Section):
    """One fault of a schedule. A field that is None takes the default of the fault's kind."""

    kind: str
    name: str | None = Field(default=None, min_length=1, max_length=60)
    at_s: Times = AT_S
    duration_s: Times | None = None
    size: Sizes | None = None
    axis: Literal["beta", "gamma", "both"] | None = None

    @field_validator("kind")
    @classmethod
    def _known(cls, kind: str) -> str:
        if kind not in KINDS:
            raise ValueError(f"got {shown(kind)}, expected {one_of(KINDS, kind)}")
        return kind

    @field_validator("size")
    @classmethod
    def _allowed(cls, size: Range | None, info: Any) -> Range | None:
        kind = KINDS.get(info.data.get("kind", ""))
        if size is None or kind is None:
            return size
        if kind.size is None:
            raise ValueError(f"{kind.name} has no size")
        least, most = kind.allowed
        for value in size:
            if not least <= value <= most:
                raise ValueError(f"got {value:g}, expected {least:g} to {most:g} {kind.unit}")
        return size


class Schedule(Section):
    """All entries of a schedule's file."""

    faults: tuple[Entry, ...] = Field(min_length=1)


@dataclass(frozen=True)
class FaultTrial:
    """Faults that act together in one run, under one name."""

    name: str
    entries: tuple[Entry, ...]

    @property
    def kinds(self) -> tuple[FaultKind, ...]:
        """The kinds of the trial's faults."""
        return tuple(KINDS[entry.kind] for entry in self.entries)

    def to_json(self) -> dict[str, Any]:
        """Name and entries, which determine the trial."""
        return {"name": self.name, "entries": [entry.model_dump() for entry in self.entries]}

    def draw(self, seed: int) -> tuple[Drawn, ...]:
        """The faults of the run with this seed. The seed determines their times, durations, sizes and axes."""
        return tuple(_drawn(entry, seed, number) for number, entry in enumerate(self.entries))


def every_kind() -> tuple[FaultTrial, ...]:
    """One trial for each kind of fault."""
    return tuple(FaultTrial(name, (Entry(kind=name),)) for name in KINDS)


def at_once(kind: str, now: float, seed: int) -> Drawn:
    """A fault that begins at rig time `now`, with the duration and size of its kind."""
    drawn = _drawn(Entry(kind=kind), seed, 0)
    return replace(drawn, at_s=now, until_s=drawn.until_s + now - drawn.at_s)


def _drawn(entry: Entry, seed: int, number: int) -> Drawn:
    kind = KINDS[entry.kind]
    rng = np.random.default_rng([seed, zlib.crc32(entry.kind.encode()), number])

    def between(given: Range) -> float:
        share = float(rng.random())  # also drawn for a fixed value, so that the later random numbers stay the same
        return given[0] if given[0] == given[1] else given[0] + share * (given[1] - given[0])

    at = between(entry.at_s)
    duration = between(entry.duration_s or kind.duration_s)
    size = between(entry.size or kind.size or (0.0, 0.0))
    axis = int(rng.integers(2))
    axes = {None: (axis,), "beta": (0,), "gamma": (1,), "both": (0, 1)}[entry.axis]
    return Drawn(kind, at, at + duration, size, axes, int(rng.integers(2**31)))


def load_schedule(path: str | Path) -> tuple[FaultTrial, ...]:
    """The trials of a file, in its order. Raises SettingsError with file, line and key."""
    tree = read_yaml(Path(path), error=SettingsError, what="a schedule of faults (YAML)")
    entries = read_section(Schedule, Tree(as_tuples(tree.data), tree.lines), path, SettingsError).faults
    together: dict[str, list[Entry]] = {}
    for entry in entries:
        name = entry.name or entry.kind
        if entry.name is None:  # two entries of a kind without names are two trials
            names = (name, *(f"{name} {k}" for k in range(2, 1 + 2 * len(entries))))
            name = next(n for n in names if n not in together)
        together.setdefault(name, []).append(entry)
    return tuple(FaultTrial(name, tuple(members)) for name, members in together.items())
