"""`compare`: kinds of ball models on the same data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from mazeplan.core.errors import InputError
from mazeplan.core.logs.columns import parse_columns
from mazeplan.core.logs.table import as_table, several
from mazeplan.core.progress import Advance, Words, no_advance, no_words
from mazeplan.core.results import DocumentResult
from mazeplan.learning import comparison
from mazeplan.learning.comparison import CompareOptions
from mazeplan.learning.fitting import KINDS, FitOptions
from mazeplan.learning.samples import SampleOptions
from mazeplan.maze.geometry import Maze
from mazeplan.run.commands.log_context import check_channel, check_radius, logged_map


@dataclass(frozen=True)
class Comparison(DocumentResult):
    """Kinds of models on the same data: the document of `compare --json`."""

    kind: ClassVar[str] = "comparison"

    def facts(self) -> dict[str, Any]:
        """The nRMSE of each kind on the test rows, ring by ring."""
        return {f"{ring}, nRMSE": entry["nrmse_test"] for ring, entry in self.document.items()}


def compare(
    logs: Any,
    *,
    test: Any = None,
    map: str | Path | Maze | None = None,
    columns: Iterable[str] | Mapping[str, str] = (),
    ring: int | None = None,
    radius: float | None = None,
    kinds: Iterable[str] = ("rf", "p", "pi", "np", "sp"),
    most: int = 5000,
    seed: int = 0,
    progress: Words = no_words,
    advance: Advance = no_advance,
    say: Words = no_words,
) -> Comparison:
    """Compare kinds of ball models in each ring: nRMSE of theta_dd and roll-out errors.

    logs, test, columns: as of `mazeplan.learn`
    test: None: every fourth block of 5 s is tested on
    ring: only this ring; radius: of its track, m
    most: most training rows of a Gaussian process
    say: gets what is left out

    Raises InputError, TableError."""
    named_kinds = kinds.split(",") if isinstance(kinds, str) else kinds
    chosen = tuple(dict.fromkeys(kind.strip() for kind in named_kinds))
    if wrong := [kind for kind in chosen if kind not in KINDS]:
        raise InputError(f"--kinds: got {wrong[0]!r}, expected one or more of {','.join(KINDS)}")
    given, named = (several(logs), several(test)), parse_columns(columns)
    found = logged_map(map, *given[0], *given[1])
    if ring is not None and radius is None:
        check_channel(ring, found.maze)
    fit = FitOptions(most=most, training=comparison.THOROUGH, seed=seed)
    options = CompareOptions(samples=SampleOptions(ring=ring, radius=radius), fit=fit, kinds=chosen)
    progress("reading")
    tables, held_out = ([as_table(log, named) for log in group] for group in given)
    if radius is not None:
        for table in (*tables, *held_out):
            check_radius(table, radius, ring)
    shown: dict[str, Any] = {"progress": progress, "advance": advance, "left_out": say}
    scores = comparison.compare(tables, held_out, found.maze, options, openings_known=found.known, **shown)
    return Comparison({f"ring{number}": found for number, found in scores.items()})
