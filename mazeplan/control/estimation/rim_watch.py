"""Whether the ball has left the maze: it is measured beyond the outermost wall.

The estimator cannot detect this, because its model keeps every ball inside the rim. Therefore this watch uses the
positions that the camera measured. The centre of a ball in ring 1 is at least a ball's radius away from the rim. A ball
counts as outside if it is measured past the middle of the outermost wall, by more than the noise of the camera.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from mazeplan.maze.geometry import Maze

SIGMAS = 4.0  # margin past the middle of the outermost wall, in sigmas of one sample of the camera
SAMPLES, AGREEING = 3, 2  # number of last samples that vote; surplus of votes needed for a decision


@dataclass(frozen=True, slots=True)
class Out:
    """A ball that has left the maze.

    since:   rig time of the first sample outside, s
    x, y:    last position seen outside, m
    beyond:  its distance past the middle of the outermost wall, m"""

    since: float
    x: float
    y: float
    beyond: float

    @property
    def message(self) -> str:
        """Where the ball is, in one line."""
        return f"the ball has left the maze: it is {1e3 * self.beyond:.0f} mm beyond the rim"


def rim_of(maze: Maze) -> float:
    """Radius of the middle of the outermost wall, m."""
    rim = maze.walls[0]
    return 0.5 * (rim.inner_radius + rim.outer_radius)


class RimWatch:
    """Watches one ball. `out`: where the ball is outside; None while it is inside.

    camera_sigma: 1 sigma of one sample, m."""

    def __init__(self, maze: Maze, camera_sigma: float) -> None:
        self._rim, self._margin = rim_of(maze), SIGMAS * camera_sigma
        self._last: deque[tuple[float, int]] = deque(maxlen=SAMPLES)  # t, and 1 outside, -1 inside, 0 not seen
        self._outside = (math.nan, math.nan, math.nan)  # x, y and `Out.beyond` of the last sample outside
        self.out: Out | None = None

    def update(self, t: float, place: tuple[float, float] | None) -> Out | None:
        """Take in one sample. Returns `out`.

        t:      rig time, s
        place:  measured x and y, m; None if the ball was not seen

        The last SAMPLES decide: AGREEING of them must agree, and none may say the opposite. So one wrong position does
        not count as a ball outside, but a ball that flies out of the picture does."""
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
