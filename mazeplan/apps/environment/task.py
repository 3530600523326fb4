"""The task of the agent: its options; rewards and ends of episodes, from the measurements of a rig.

    sparse    1 on arrival, else 0
    dense     sparse + discount x phi(next) - phi(now),    phi = 1 - (expected time to the goal) / (longest such time)

The expected time is that of the fastest route over the openings (`maze.graph`). The route begins at the ring and the
angle at which the ball is seen. At the end of an episode, phi is 0. A reward that a potential shapes in this way does
not change which policies are best (Ng, Harada and Russell 1999), for a learner with the same discount. Standing still
costs, and costs more near the goal. So returns without discount also rank policies as one would expect.

Arrival: as for `navigate`, the ball's centre was measured inside the goal ring for HOLD s, in each sample that shows
the ball. Out: the ball was not seen for LOST s, or was seen beyond the rim, as for the failure `ball_out` of
`navigate`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from mazeplan.apps.environment.senses import Senses
from mazeplan.control.estimation.estimator import EstimatorOptions
from mazeplan.control.estimation.sample_check import RimWatch
from mazeplan.core.errors import InputError, SettingsError
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze
from mazeplan.maze.graph import RouteGraph
from mazeplan.maze.sections import Section
from mazeplan.run.resolve import ring_number

HOLD = 0.2  # s in the goal ring until the ball has arrived, as for the leaf Settle
LOST = 1.0  # s without a sight of the ball until it is out
ANGLES = np.linspace(-math.pi, math.pi, 121)  # rad, of the table of phi


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


@dataclass(frozen=True)
class Verdict:
    """Verdict on the last step."""

    reward: float
    arrived: bool
    out: bool  # whether the ball was not seen for too long, or has left the maze
    left: bool  # whether the ball has left the maze


def potential(task: Task, maze: Maze) -> Array:
    """phi of a task, (rings, angles): 1 at the goal, 0 where the expected time is longest.

    Raises SettingsError if there is no way to the goal from a ring in which an episode may begin."""
    graph, goal = RouteGraph(maze), task.goal(maze)
    routes = [[graph.route(ring.number, goal, angle) for angle in ANGLES] for ring in maze.rings]
    times = np.array([[math.inf if route is None else route.expected_s for route in row] for row in routes])
    for ring in task.rings(maze, goal):
        if not np.all(np.isfinite(times[ring - 1])):
            raise SettingsError(f"there is no way from ring {ring} to ring {goal}", key="goal_ring")
    longest = float(np.max(times[np.isfinite(times)]))
    return 1.0 - np.where(np.isfinite(times), times, longest) / longest


class Judge:
    """Judges one episode. phi: `potential` of the task"""

    def __init__(self, task: Task, senses: Senses, phi: Array) -> None:
        self._task, self._senses, self._phi = task, senses, phi
        self._goal, self._since = senses.maze.ring(task.goal(senses.maze)), math.nan
        self._phi_now = self._phi_here()
        self._rim = RimWatch(senses.maze, EstimatorOptions().camera_sigma)
        self._rim.update(senses.t, senses.place)

    def judge(self) -> Verdict:
        """Judge the ball. Call this after the senses have taken a new sample."""
        senses, unseen = self._senses, self._senses.unseen_s
        seen = unseen <= 0.0
        inside = self._goal.inner_radius <= senses.radius <= self._goal.outer_radius
        self._since = math.nan if not inside else senses.t if math.isnan(self._since) else self._since
        arrived = seen and senses.t - self._since >= HOLD - 1e-6
        left = self._rim.update(senses.t, senses.place if seen else None) is not None and not arrived
        out = left or (not arrived and unseen >= LOST - 1e-6)
        reward = float(arrived)
        if self._task.reward == "dense":
            phi = 0.0 if arrived or out else self._phi_here()
            reward += self._task.discount * phi - self._phi_now
            self._phi_now = phi
        return Verdict(reward, arrived, out, left)

    def _phi_here(self) -> float:
        return float(np.interp(self._senses.theta, ANGLES, self._phi[self._senses.ring - 1]))
