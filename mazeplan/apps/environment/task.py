"""The options of an environment."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from mazeplan.core.errors import InputError, SettingsError
from mazeplan.maze.geometry import Maze
from mazeplan.maze.sections import Section
from mazeplan.run.resolve import ring_number


class Start(Section):
    """Where an episode begins; the options of `reset`.

    start_ring: a ring, or "any": drawn for each episode from all rings except the goal ring.
    start_angle_deg: None: drawn for each episode."""

    start_ring: int | str = 1
    start_angle_deg: float | None = None

    def rings(self, maze: Maze, goal: int) -> tuple[int, ...]:
        """Numbers of the rings in which an episode may begin. Raises SettingsError if there is none."""
        if self.start_ring == "any":
            return tuple(ring.number for ring in maze.rings if ring.number != goal)
        start = _ring("start_ring", self.start_ring, maze)
        if start == goal:
            raise SettingsError(f"got ring {start}, which is the goal", key="start_ring")
        return (start,)


class Task(Start):
    """Options of an environment.

    map, rig: as `navigate` takes them.
    goal_ring: a ring; None: the innermost.
    discount: discount of the learner; the dense reward uses it."""

    map: str = "cme"
    rig: str = "toy"
    reward: Literal["sparse", "dense"] = "sparse"
    goal_ring: int | str | None = None
    discount: float = Field(default=0.99, gt=0.0, le=1.0)

    def goal(self, maze: Maze) -> int:
        """Number of the goal ring. Raises SettingsError for a ring that the maze lacks."""
        return len(maze.rings) if self.goal_ring is None else _ring("goal_ring", self.goal_ring, maze)


def _ring(key: str, ring: int | str, maze: Maze) -> int:
    try:
        return ring_number(ring, maze)
    except InputError as problem:
        raise SettingsError(problem.problem, key=key) from None
