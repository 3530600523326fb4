"""Words on the command line that several commands understand alike."""

from __future__ import annotations

import math
import re

from mazeplan.errors import InputError
from mazeplan.maze.geometry import Maze


def positive(option: str, value: float) -> float:
    """The value of an option that must be finite and greater than 0. Raises InputError otherwise."""
    if not (math.isfinite(value) and value > 0.0):
        raise InputError(f"{option}: got {value:g}, expected a finite number > 0")
    return value


def parse_ring(text: str, maze: Maze) -> int:
    """Number of a ring written as "ring1", "Ring 1" or "1". Raises InputError if the maze has no such ring."""
    number = re.fullmatch(r"(?:ring[ _-]?)?([0-9]{1,3})", text.strip().lower())
    if number is None or not 1 <= int(number[1]) <= len(maze.rings):
        raise InputError(f"ring: got {text!r}, expected ring1 to ring{len(maze.rings)} (map {maze.name})")
    return int(number[1])


def parse_opening(text: str, maze: Maze) -> str:
    """Name of an opening. Raises InputError, which lists them, if the maze has none of that name."""
    names = [opening.name for opening in maze.openings]
    if text not in names:
        raise InputError(f"opening: got {text!r}, expected one of {', '.join(names)} (map {maze.name})")
    return text
