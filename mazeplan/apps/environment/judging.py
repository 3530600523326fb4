"""Rewards and ends of episodes, for N balls at once, from the measurements of their rigs.

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
from functools import lru_cache

import numpy as np

from mazeplan.apps.environment.senses import Senses
from mazeplan.apps.environment.task import Task
from mazeplan.control.estimation.estimator import EstimatorOptions
from mazeplan.control.estimation.rim_watch import AGREEING, SAMPLES, SIGMAS, rim_of
from mazeplan.core.errors import SettingsError
from mazeplan.core.records import Array, IntArray
from mazeplan.maze.geometry import Maze
from mazeplan.maze.graph import RouteGraph

HOLD = 0.2  # s in the goal ring until the ball has arrived, as for the leaf Settle
LOST = 1.0  # s without a sight of the ball until it is out
ANGLES = 120  # angles of each ring in the table of expected times


@dataclass(frozen=True)
class Verdict:
    """Verdict on the last step; each field has shape (rows,).

    reward: the reward.
    arrived: whether the ball has arrived.
    out: whether the ball was not seen for too long, or has left the maze.
    left: whether the ball has left the maze.
    ring: ring in which the ball was seen last."""

    reward: Array
    arrived: np.ndarray
    out: np.ndarray
    left: np.ndarray
    ring: IntArray


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


class Judge:
    """Judges N balls. Raises SettingsError if there is no way to the goal from a ring in which an episode may begin."""

    def __init__(self, task: Task, senses: Senses, number: int) -> None:
        maze = senses.maze
        self._task, self._senses, self.goal = task, senses, task.goal(maze)
        times = expected_times(maze, self.goal)
        for ring in task.starts(maze):
            if not np.all(np.isfinite(times[ring - 1])):
                raise SettingsError(f"there is no way from ring {ring} to ring {self.goal}", key="goal_ring")
        longest = float(np.max(times[np.isfinite(times)]))
        self._potential = 1.0 - np.where(np.isfinite(times), times, longest) / longest
        self._phi, self._since = np.zeros(number), np.full(number, math.nan)
        self._votes = np.full((number, SAMPLES), -1)  # where the last samples show the ball: 1 out, -1 in, 0 not seen
        self._beyond = rim_of(maze) + SIGMAS * EstimatorOptions().camera_sigma  # m

    def reset(self, rows: IntArray) -> None:
        """Begin new episodes of the balls `rows`, from the present state of the senses."""
        self._since[rows], self._votes[rows] = math.nan, -1
        self._phi[rows] = self.potential(rows)

    def potential(self, rows: IntArray) -> Array:
        """phi at the places where the balls were seen last: 1 at the goal, 0 where the expected time is longest."""
        radius, theta = self._senses.place(rows)
        at = (theta + math.pi) / math.tau * ANGLES
        low = np.minimum(at.astype(np.int64), ANGLES - 1)
        ring = self._senses.ring(radius) - 1
        share = at - low
        return (1.0 - share) * self._potential[ring, low] + share * self._potential[ring, low + 1]

    def judge(self, rows: IntArray) -> Verdict:
        """Judge the balls `rows`. Call this after the senses have taken new samples."""
        senses, t = self._senses, self._senses.t[rows]
        radius, _ = senses.place(rows)
        unseen = senses.unseen_s(rows)
        seen, goal = unseen <= 0.0, senses.maze.ring(self.goal)
        inside = (goal.inner_radius <= radius) & (radius <= goal.outer_radius)
        vote = np.where(seen, np.where(radius > self._beyond, 1, -1), 0)
        self._since[rows] = since = _held(self._since[rows], t, inside)
        arrived = seen & (t - since >= HOLD - 1e-6)
        self._votes[rows] = votes = np.column_stack([self._votes[rows, 1:], vote])
        left = ~arrived & (votes.sum(axis=1) >= AGREEING)
        out = left | (~arrived & (unseen >= LOST - 1e-6))
        reward = arrived.astype(float)
        if self._task.reward == "dense":
            phi = np.where(arrived | out, 0.0, self.potential(rows))
            reward += self._task.discount * phi - self._phi[rows]
            self._phi[rows] = phi
        return Verdict(reward, arrived, out, left, senses.ring(radius))


def _held(since: Array, t: Array, holds: np.ndarray) -> Array:
    """Time since which a condition has held; NaN where it does not hold.

    since: the times so far; t: the present times, s; holds: whether the condition holds now."""
    return np.where(holds, np.where(np.isnan(since), t, since), math.nan)
