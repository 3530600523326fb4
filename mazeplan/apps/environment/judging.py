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
from dataclasses import dataclass

import numpy as np

from mazeplan.apps.environment.senses import Senses
from mazeplan.apps.environment.task import Task
from mazeplan.control.estimation.estimator import EstimatorOptions
from mazeplan.control.estimation.rim_watch import RimWatch
from mazeplan.core.errors import SettingsError
from mazeplan.maze.geometry import Maze
from mazeplan.maze.graph import RouteGraph

HOLD = 0.2  # s in the goal ring until the ball has arrived, as for the leaf Settle
LOST = 1.0  # s without a sight of the ball until it is out
ANGLES = np.linspace(-math.pi, math.pi, 121)  # rad, of the table of phi


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


class Potential:
    """phi of a task. Raises SettingsError if there is no way to the goal from a ring in which an episode may begin."""

    def __init__(self, task: Task, maze: Maze) -> None:
        graph, goal = RouteGraph(maze), task.goal(maze)
        routes = [[graph.route(ring.number, goal, angle) for angle in ANGLES] for ring in maze.rings]
        times = np.array([[math.inf if route is None else route.expected_s for route in row] for row in routes])
        for ring in task.rings(maze, goal):
            if not np.all(np.isfinite(times[ring - 1])):
                raise SettingsError(f"there is no way from ring {ring} to ring {goal}", key="goal_ring")
        longest = float(np.max(times[np.isfinite(times)]))
        self._phi = 1.0 - np.where(np.isfinite(times), times, longest) / longest

    def at(self, ring: int, theta: float) -> float:
        """phi at a place: 1 at the goal, 0 where the expected time is longest. theta: rad"""
        return float(np.interp(theta, ANGLES, self._phi[ring - 1]))


class Judge:
    """Judges one episode."""

    def __init__(self, task: Task, senses: Senses, potential: Potential) -> None:
        self._task, self._senses, self._potential = task, senses, potential
        self._goal, self._since = senses.maze.ring(task.goal(senses.maze)), math.nan
        self._phi = potential.at(senses.ring, senses.theta)
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
            phi = 0.0 if arrived or out else self._potential.at(senses.ring, senses.theta)
            reward += self._task.discount * phi - self._phi
            self._phi = phi
        return Verdict(reward, arrived, out, left)
