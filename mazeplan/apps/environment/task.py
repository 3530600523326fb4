"""The options of an environment."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from mazeplan.core.errors import InputError, SettingsError
from mazeplan.maze.geometry import Maze
from mazeplan.maze.sections import Section
from mazeplan.rigs.files import validated
from mazeplan.run.resolve import ring_number

ANY = "any"  # start ring that is drawn at random from all rings except the goal


class Task(Section):
    """Options of an environment.

    map, rig: as `navigate` takes them.
    start_ring: a ring, or "any".
    goal_ring: a ring; None: the innermost.
    start_angle_deg: None: drawn anew for each episode.
    discount: discount of the learner; the dense reward uses it."""

    map: str = "cme"
    rig: str = "toy"
    reward: Literal["sparse", "dense"] = "sparse"
    start_ring: int | str = 1
    goal_ring: int | str | None = None
    start_angle_deg: float | None = None
    discount: float = Field(default=0.99, gt=0.0, le=1.0)

    @classmethod
    def of(cls, options: dict[str, Any]) -> Task:
        """A task from keywords. Raises SettingsError for an option that cannot be used."""
        return validated(cls, options)

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
