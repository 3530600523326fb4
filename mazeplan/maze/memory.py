"""Memory of the openings: counts of successes and failures for a Beta posterior, which fade with time.

A failure may be temporary. Therefore the counts decay with rig time by exp(-t / fading_s), and by KEPT from run to run.
Recent attempts count most, and an opening that is no longer tried returns to the prior. A file can keep the counts for
the next run.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from pydantic import Field

from mazeplan.core.errors import InputError
from mazeplan.core.name_hints import one_of
from mazeplan.core.whole_file import whole_file
from mazeplan.maze.sections import Section, read_section
from mazeplan.maze.yamltree import Key, key_path, read_yaml, shown

FORMAT = 1
FADING_S = 120.0  # s of rig time in which counts fall to 1/e
KEPT = 0.8  # share of the counts kept for the next run
MOST = 1e6  # maximum count in a file
NOTE = "# What happened at the openings of the map, fading. Written by `mazeplan navigate --memory`; may be deleted.\n"


class Counts(Section):
    """What happened at one opening."""

    successes: float = Field(default=0.0, ge=0.0, le=MOST)
    failures: float = Field(default=0.0, ge=0.0, le=MOST)


class MemoryFile(Section):
    """A whole file."""

    map: str | None = None
    openings: dict[str, Counts] | None = None


@dataclass
class OpeningMemory:
    """Counts of successes and failures by opening.

    fading_s: rig time until counts fall to 1/e, s
    attempts: number of recorded attempts, without fading
    """

    fading_s: float = FADING_S
    _counts: dict[str, tuple[float, float, float]] = field(default_factory=dict)  # successes, failures, when
    attempts: int = field(default=0, compare=False)

    def record(self, name: str, success: bool, now: float) -> None:
        """Record one attempt at an opening at rig time now, s."""
        successes, failures = self.tries(name, now)
        self._counts[name] = (successes + success, failures + (not success), now)
        self.attempts += 1

    def tries(self, name: str, now: float) -> tuple[float, float]:
        """Faded successes and failures of an opening at rig time now, s."""
        successes, failures, when = self._counts.get(name, (0.0, 0.0, now))
        kept = math.exp(-max(now - when, 0.0) / self.fading_s)
        return successes * kept, failures * kept

    def at_end(self, now: float) -> dict[str, tuple[float, float]]:
        """Faded successes and failures of all tried openings at rig time now, s."""
        return {name: self.tries(name, now) for name in self._counts}

    def document(self) -> dict[str, Any]:
        """All counts as plain data, exact to the last bit; `memory_from_document` reads it."""
        names = ("successes", "failures", "when")
        counts = {name: dict(zip(names, values, strict=True)) for name, values in self._counts.items()}
        return {"fading_s": self.fading_s, "openings": counts}


def memory_from_document(document: dict[str, Any]) -> OpeningMemory:
    """Inverse of `OpeningMemory.document`. Raises KeyError, TypeError, ValueError or AttributeError for other data."""
    counts = {
        str(name): (float(c["successes"]), float(c["failures"]), float(c["when"]))
        for name, c in document["openings"].items()
    }
    return OpeningMemory(float(document["fading_s"]), counts)


def load_memory(path: Path, openings: Iterable[str], map_name: str = "") -> OpeningMemory:
    """The counts in a file, faded by one run; empty if the file does not exist.

    openings: names of the map's openings
    map_name: name of the map; a file for another map is refused. "" accepts any map

    Raises InputError with file, line and key."""
    memory = OpeningMemory()
    if not path.exists():
        return memory
    tree = read_yaml(path, error=InputError, what="a file of `navigate --memory` (YAML)")
    found, known = read_section(MemoryFile, tree, path, InputError, FORMAT), list(openings)
    made_for = map_name if found.map is None else found.map
    if map_name and made_for != map_name:
        expected = f"{map_name!r}, the map of this run; give another file, which is made where there is none"
        raise InputError(f"got {shown(made_for)}, expected {expected}", file=path, line=tree.line(("map",)), key="map")
    for name, counts in (found.openings or {}).items():
        if name not in known:
            key: Key = ("openings", name)
            expected = f"unknown key, expected {one_of(known, name)}"
            raise InputError(expected, file=path, line=tree.line(key), key=key_path(key))
        memory._counts[name] = (KEPT * counts.successes, KEPT * counts.failures, 0.0)
    return memory


def save_memory(memory: OpeningMemory, path: Path, now: float, map_name: str = "") -> None:
    """Write the counts at rig time now (s), for the map of this name, atomically. Raises InputError."""
    openings = {
        name: {"successes": round(successes, 4), "failures": round(failures, 4)}
        for name, (successes, failures) in sorted(memory.at_end(now).items())
    }
    named = f"map: {_quoted(map_name)}\n" if map_name else ""
    lines = [NOTE, f"format: {FORMAT}\n", named, "openings:\n" if openings else "openings: {}\n"]
    for name, counts in openings.items():
        key = name if re.fullmatch(r"\w[\w@.-]*", name) else _quoted(name)
        lines.append(f"  {key}: {{successes: {counts['successes']}, failures: {counts['failures']}}}\n")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as beside:
            beside.write_text("".join(lines), encoding="utf-8")
    except OSError as problem:
        raise InputError(f"cannot be written: {problem.strerror}", file=path) from None


def _quoted(name: str) -> str:
    """A name as YAML text, on one line."""
    return yaml.safe_dump(name, default_style='"', width=math.inf).strip()
