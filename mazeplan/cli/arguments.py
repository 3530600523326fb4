"""Words on the command line that several commands understand alike."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path
from typing import Annotated

import typer

from mazeplan.errors import InputError
from mazeplan.maze.geometry import Maze

BehaviorModule = Annotated[
    list[str] | None,
    typer.Option("--behavior-module", help="Python module with leaves of your own; repeatable."),
]


EffectModule = Annotated[
    str | None,
    typer.Option("--effects", metavar="MODULE:FUNCTION", help="Effects of your own that the model has."),
]


def check_folder(option: str, folder: Path) -> None:
    """Whether a folder could be made and written to, before long work is lost for want of it. Raises InputError."""
    there = next(place for place in (folder.absolute(), *folder.absolute().parents) if place.exists())
    if not (there.is_dir() and os.access(there, os.W_OK)):
        why = "may not be written to" if there.is_dir() else "is a file"
        raise InputError(f"{option}: got {folder}, but {there} {why}; expected a folder that can be made or written to")


def positive(option: str, value: float) -> float:
    """The value of an option that must be finite and greater than 0. Raises InputError otherwise."""
    if not (math.isfinite(value) and value > 0.0):
        raise InputError(f"{option}: got {value:g}, expected a finite number > 0")
    return value


def finite(option: str, value: float, unit: str) -> float:
    """The value of an option that must be finite. Raises InputError otherwise."""
    if not math.isfinite(value):
        raise InputError(f"{option}: got {value:g}, expected a finite number of {unit}")
    return value


def parse_ring(text: str, maze: Maze) -> int:
    """Number of a ring written as "ring1", "Ring 1" or "1". Raises InputError if the maze has no such ring."""
    number = re.fullmatch(r"(?:ring[ _-]?)?([0-9]{1,3})", text.strip().lower())
    if number is None or not 1 <= int(number[1]) <= len(maze.rings):
        raise InputError(f"ring: got {text!r}, expected ring1 to ring{len(maze.rings)} (map {maze.name})")
    return int(number[1])


def check_channel(ring: int, maze: Maze) -> None:
    """Whether the maze has such a ring, and it is no disc. Raises InputError."""
    if ring > len(maze.rings):
        raise InputError(f"--ring: got {ring}, expected 1 to {len(maze.rings)} (map {maze.name})")
    if maze.ring(ring).is_disc:
        raise InputError(f"--ring: got {ring}, a disc, expected a ring with a channel (map {maze.name})")


def parse_opening(text: str, maze: Maze) -> str:
    """Name of an opening. Raises InputError, which lists them, if the maze has none of that name."""
    names = [opening.name for opening in maze.openings]
    if text not in names:
        raise InputError(f"opening: got {text!r}, expected one of {', '.join(names)} (map {maze.name})")
    return text


def logged_map_text(maze: Maze, name: str | None, log: Path) -> str:
    """The text of a map that `logged_map` found: of its file, or out of the log."""
    from mazeplan.data.runlog import read_log

    if name is None and log.suffix == ".mcap":
        text = read_log(log).header.get("map")
        if isinstance(text, str):
            return text
    return Path(str(maze.source)).read_text(encoding="utf-8")


def logged_map(name: str | None, log: Path) -> tuple[Maze, bool]:
    """The map that is named, else that of a run log, else cme; and whether its openings are those of the data: a table
    does not tell, a log or a person does. Raises MapError."""
    from mazeplan.data.runlog import read_log
    from mazeplan.maze.mapfile import check_text, load_map

    if name is not None:
        return load_map(name), True
    if log.suffix == ".mcap" and log.is_file():
        text = read_log(log).header.get("map")
        maze = check_text(text, file=log).maze if isinstance(text, str) else None
        if maze is not None:
            return maze, True
    return load_map("cme"), False
