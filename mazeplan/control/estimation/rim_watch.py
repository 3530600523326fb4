"""Whether the ball has left the maze: it is measured beyond the outermost wall.

The estimator cannot tell: its model knows walls, and leaves every ball inside the rim. So this goes by what the camera
measured. The centre of a ball in ring 1 is a ball's radius from the rim; one that is measured past the middle of that
wall (as between two rings), and further by more than the camera's noise, is no ball in ring 1.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from mazeplan.maze.geometry import Maze

SIGMAS = 4.0  # of one sample of the camera, past the middle of the outermost wall
SAMPLES, AGREEING = 3, 2  # of so many samples so many more say it than say the opposite


@dataclass(frozen=True, slots=True)
class Out:
    """A ball that has left the maze. since: rig time of the first sample that saw it outside, s; x, y: where it was
    seen there last, m; beyond: by how much past the middle of the outermost wall, m."""

    since: float
    x: float
    y: float
    beyond: float

    @property
    def told(self) -> str:
        """What happened, in a line for people."""
        return f"the ball has left the maze: it is {1e3 * self.beyond:.0f} mm beyond the rim"


def rim_of(maze: Maze) -> float:
    """Radius of the middle of the outermost wall, m."""
    rim = maze.walls[0]
    return 0.5 * (rim.inner_radius + rim.outer_radius)


class RimWatch:
    """Watches one ball. camera_sigma: m, 1 sigma of one sample. `out`: how far it is out, None: it is not."""

    def __init__(self, maze: Maze, camera_sigma: float) -> None:
        self._rim, self._margin = rim_of(maze), SIGMAS * camera_sigma
        self._last: deque[tuple[float, int]] = deque(maxlen=SAMPLES)  # t, and 1 outside, -1 inside, 0 not seen
        self._outside = (math.nan, math.nan, math.nan)  # x, y and by how much it is beyond, where it was outside last
        self.out: Out | None = None

    def take(self, t: float, place: tuple[float, float] | None) -> Out | None:
        """Take in where the ball was measured, x and y in m, None: it was not seen; rig time in s. Returns `out`.

        The last SAMPLES decide, either way: AGREEING of them, none against. So one wrong position is no ball outside,
        and a ball that flies out of the picture is."""
        beyond = math.nan if place is None else math.hypot(*place) - self._rim
        self._last.append((t, 0 if place is None else 1 if beyond > self._margin else -1))
        votes, out = sum(vote for _, vote in self._last), self.out
        if place is not None and beyond > self._margin:
            self._outside = (*place, beyond)
        if votes >= AGREEING:
            since = next(then for then, vote in self._last if vote > 0) if out is None else out.since
            self.out = Out(since, *self._outside)
        elif votes <= -AGREEING:
            self.out = None
        return self.out
