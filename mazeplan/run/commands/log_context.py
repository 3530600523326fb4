"""Map, rig and ring of a record: from its log, or from the options given with it."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mazeplan.core import file_kinds
from mazeplan.core.errors import InputError, ShortWarning, TableError
from mazeplan.maze.geometry import Maze

if TYPE_CHECKING:
    from mazeplan.core.logs.table import Table

# NEAR: a ball is near a radius if it is off by less than this share of the radius
# MOSTLY: share of the samples in which the ball has to be near the radius
NEAR, MOSTLY = 0.2, 0.9


@dataclass(frozen=True)
class LoggedMap:
    """A map for a record."""

    maze: Maze
    source: str  # where the map comes from, in words
    known: bool = True  # whether its openings are known to be those of the record


def logged_map(name: str | Path | Maze | None, *logs: object) -> LoggedMap:
    """The named map, otherwise the map in the run logs, otherwise cme. Tables have no map.

    Raises MapError, and InputError for logs of several maps. Warns (ShortWarning) of a log that was recorded on another
    map than the named map."""
    from mazeplan.core.logs.run_log_reader import read_header
    from mazeplan.maze.mapfile import check_text, load_map

    given = LoggedMap(name, f"map {name.name}") if isinstance(name, Maze) else None
    given = LoggedMap(load_map(name), f"map {name}") if isinstance(name, str | Path) else given
    found: dict[Path, LoggedMap] = {}
    for log in (Path(log) for log in logs if isinstance(log, str | Path)):
        if file_kinds.got(log) == file_kinds.LOG:
            text = read_header(log).get("map")
            maze = check_text(text, file=log).maze if isinstance(text, str) else None
            if given is not None and maze is not None and not _same(maze, given.maze):
                warning = f"{log}: recorded on another map, {maze.name}, used with --map {name}"
                warnings.warn(warning, ShortWarning, stacklevel=2)
            if maze is not None:
                found[log] = LoggedMap(maze, f"the log's map {maze.name}")
    if given is not None:
        return given
    if not found:
        return LoggedMap(load_map("cme"), "the packaged map cme", known=False)
    (first, logged), *others = found.items()
    for log, other in others:
        if not _same(other.maze, logged.maze):
            both = f"recorded on the map {other.maze.name}, but {first} on another, {logged.maze.name}"
            raise InputError(f"{both}; expected logs of one map, or --map", file=log)
    return logged


def _same(one: Maze, other: Maze) -> bool:
    from mazeplan.maze.mapfile import dump_map

    return dump_map(one) == dump_map(other)  # as text: a number of a log's map may differ by one bit


def check_radius(table: Table, radius: float, ring: int | None = None) -> None:
    """Raises InputError unless the ball is near a radius, m, in most samples. A table without r may have any radius.

    ring: if the table has a column `ring`, only rows of this ring count"""
    import numpy as np

    r = table["r"] if "r" in table else np.zeros(0)
    if ring is not None and "ring" in table:
        r = r[table["ring"] == ring] if r.size else r
    r = r[np.isfinite(r)]
    if not r.size or np.mean(np.abs(r / radius - 1.0) < NEAR) > MOSTLY:
        return
    low, high = np.quantile(r, (0.05, 0.95))
    raise InputError(
        f"--radius: got {radius:g} m, expected where the ball is: {low:.3g} to {high:.3g} m from the centre; "
        "of a record of several rings name one with --ring"
    )


def check_channel(ring: int, maze: Maze) -> None:
    """Raises InputError if the map has no such ring, or if it is a disc."""
    if ring > len(maze.rings):
        raise InputError(f"--ring: got {ring}, expected 1 to {len(maze.rings)} (map {maze.name})")
    if maze.ring(ring).is_disc:
        raise InputError(f"--ring: got {ring}, a disc, expected a ring with a channel (map {maze.name})")


def check_wiring(table: Table, maze: Maze | None) -> None:
    """Raises TableError if tilts do not follow their commands, or the ball does not follow the tilts.

    maze: None if the ball is not to be checked"""
    from mazeplan.learning.identification import check_record
    from mazeplan.learning.unmeasured_tilt import tilt_is_measured

    if tilt_is_measured(table):
        try:
            check_record(table, maze)
        except ValueError as problem:
            raise TableError(str(problem), file=table.place) from None
