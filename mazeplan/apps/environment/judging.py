"""Rewards and ends of episodes, from the measurements of a rig.

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
from collections import deque
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mazeplan.apps.environment.senses import Senses
from mazeplan.apps.environment.task import Task
from mazeplan.control.estimation.estimator import EstimatorOptions
from mazeplan.control.estimation.rim_watch import AGREEING, SAMPLES, SIGMAS, rim_of
from mazeplan.core.errors import SettingsError
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze
from mazeplan.maze.graph import RouteGraph

HOLD = 0.2  # s in the goal ring until the ball has arrived, as for the leaf Settle
LOST = 1.0  # s without a sight of the ball until it is out
ANGLES = 120  # angles of each ring in the table of expected times


@dataclass(frozen=True)
class Verdict:
    """Verdict on the last step.

    arrived: whether the ball has arrived.
    out: whether the ball was not seen for too long, or has left the maze.
    left: whether the ball has left the maze."""

    reward: float
    arrived: bool
    out: bool
    left: bool


@lru_cache(maxsize=8)
def expected_times(maze: Maze, goal: int) -> Array:
    """Expected time to the goal ring, s, (rings, ANGLES + 1), from angles -pi to pi; infinite where there is no way."""
    graph, table = RouteGraph(maze), np.full((len(maze.rings), ANGLES + 1), math.inf)
    for ring in maze.rings:
        for k in range(ANGLES):
            route = graph.route(ring.number, goal, -math.pi + math.tau * k / ANGLES)
            table[ring.number - 1, k] = math.inf if route is None else route.expected_s
    table[:, -1] = table[:, 0]
    return table


class Potential:
    """phi of a task. Raises SettingsError if there is no way to the goal from a ring in which an episode may begin."""

    def __init__(self, task: Task, maze: Maze) -> None:
        goal = task.goal(maze)
        times = expected_times(maze, goal)
        for ring in task.starts(maze):
            if not np.all(np.isfinite(times[ring - 1])):
                raise SettingsError(f"there is no way from ring {ring} to ring {goal}", key="goal_ring")
        longest = float(np.max(times[np.isfinite(times)]))
        self._phi = 1.0 - np.where(np.isfinite(times), times, longest) / longest

    def at(self, ring: int, theta: float) -> float:
        """phi at a place: 1 at the goal, 0 where the expected time is longest. theta: rad"""
        return float(np.interp(theta, np.linspace(-math.pi, math.pi, ANGLES + 1), self._phi[ring - 1]))


class Judge:
    """Judges one episode."""

    def __init__(self, task: Task, senses: Senses, potential: Potential) -> None:
        self._task, self._senses, self._potential = task, senses, potential
        self._goal, self._since = senses.maze.ring(task.goal(senses.maze)), math.nan
        self._phi = potential.at(senses.ring, senses.theta)
        self._votes = deque([-1] * SAMPLES, SAMPLES)  # where the samples show the ball: 1 out, -1 in, 0 not seen
        self._beyond = rim_of(senses.maze) + SIGMAS * EstimatorOptions().camera_sigma  # m

    def judge(self) -> Verdict:
        """Judge the ball. Call this after the senses have taken a new sample."""
        senses, radius, unseen = self._senses, self._senses.radius, self._senses.unseen_s
        seen = unseen <= 0.0
        inside = self._goal.inner_radius <= radius <= self._goal.outer_radius
        self._since = math.nan if not inside else senses.t if math.isnan(self._since) else self._since
        self._votes.append((1 if radius > self._beyond else -1) if seen else 0)
        arrived = seen and senses.t - self._since >= HOLD - 1e-6
        left = not arrived and sum(self._votes) >= AGREEING
        out = left or (not arrived and unseen >= LOST - 1e-6)
        reward = float(arrived)
        if self._task.reward == "dense":
            phi = 0.0 if arrived or out else self._potential.at(senses.ring, senses.theta)
            reward += self._task.discount * phi - self._phi
            self._phi = phi
        return Verdict(reward, arrived, out, left)
