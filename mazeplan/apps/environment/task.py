"""The options of an environment."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

from mazeplan.core.errors import InputError, SettingsError
from mazeplan.core.gymnasium_names import STEPS as STEPS
from mazeplan.core.name_hints import one_of
from mazeplan.maze.geometry import Maze
from mazeplan.run.resolve import ring_number

OBSERVATIONS = ("state", "pixels")
REWARDS = ("sparse", "dense")
ANY = "any"  # start ring that is drawn at random from all rings except the goal
SIZES = (16, 480)  # px, minimum and maximum side of a picture


@dataclass(frozen=True)
class Task:
    """Options of an environment. Raises SettingsError for an option that cannot be used.

    map, rig: as `navigate` takes them.
    observation: "state" or "pixels".
    reward: "sparse" or "dense".
    start_ring: a ring, or "any".
    goal_ring: a ring; None: the innermost.
    start_angle_deg: None: drawn anew for each episode.
    discount: discount of the learner; the dense reward uses it.
    size: side of a picture, px."""

    map: str = "cme"
    rig: str = "toy"
    observation: str = "state"
    reward: str = "sparse"
    start_ring: int | str = 1
    goal_ring: int | str | None = None
    start_angle_deg: float | None = None
    discount: float = 0.99
    size: int = 96

    def __post_init__(self) -> None:
        for key in ("map", "rig"):
            if not isinstance(getattr(self, key), str):
                raise SettingsError(f"got {getattr(self, key)!r}, expected a name or a file", key=key)
        for key, kinds in (("discount", int | float), ("size", int), ("start_angle_deg", int | float | None)):
            if isinstance(value := getattr(self, key), bool) or not isinstance(value, kinds):
                whole = "a whole number" if kinds is int else "a number"
                raise SettingsError(f"got {value!r}, expected {whole}", key=key)
        for key, known in (("observation", OBSERVATIONS), ("reward", REWARDS)):
            if getattr(self, key) not in known:
                raise SettingsError(f"got {getattr(self, key)!r}, expected {' or '.join(known)}", key=key)
        if not 0.0 < self.discount <= 1.0:
            raise SettingsError(f"got {self.discount!r}, expected 0 < discount <= 1", key="discount")
        if not SIZES[0] <= self.size <= SIZES[1]:
            raise SettingsError(f"got {self.size!r}, expected {SIZES[0]} to {SIZES[1]} px", key="size")
        if self.start_angle_deg is not None and not math.isfinite(self.start_angle_deg):
            raise SettingsError(f"got {self.start_angle_deg}, expected a finite number", key="start_angle_deg")

    @classmethod
    def of(cls, options: dict[str, Any]) -> Task:
        """A task from keywords. Raises SettingsError for an unknown keyword."""
        known = [field.name for field in fields(cls)]
        for name in options:
            if name not in known:
                raise SettingsError(f"unknown option, expected {one_of([*known, 'render_mode'], name)}", key=name)
        return cls(**options)

    def goal(self, maze: Maze) -> int:
        """Number of the goal ring. Raises SettingsError for a ring that the maze lacks."""
        return len(maze.rings) if self.goal_ring is None else _ring("goal_ring", self.goal_ring, maze)

    def starts(self, maze: Maze, ring: int | str | None = None) -> tuple[int, ...]:
        """Numbers of the rings in which an episode may begin. Raises SettingsError if there is none.

        ring: replaces `start_ring`."""
        goal, asked = self.goal(maze), self.start_ring if ring is None else ring
        if asked == ANY:
            return tuple(r.number for r in maze.rings if r.number != goal)
        start = _ring("start_ring", asked, maze)
        if start == goal:
            raise SettingsError(f"got ring {start}, which is the goal", key="start_ring")
        return (start,)


def _ring(key: str, ring: int | str, maze: Maze) -> int:
    try:
        return ring_number(ring, maze)
    except InputError as problem:
        raise SettingsError(problem.problem, key=key) from None
