"""Rewards and ends of episodes, of N balls at once, by what their rigs measured.

    sparse    1 on arrival, else 0
    dense     sparse + discount x phi(next) - phi(now),    phi = 1 - (expected s to the goal) / (the longest there is)

The expected time is that of the fastest route over the openings (`maze.graph`), from the ring and the angle at which
the ball is seen; phi is 0 where an episode ends. A reward shaped so by a potential leaves the best policies what they
are (Ng, Harada and Russell 1999), for a learner with the same discount. Standing still costs, the nearer to the goal
the more, so that returns without discount rank policies as one would.

Arrival is what it is for `navigate`: the ball's centre was measured inside the goal ring for HOLD s, in each sample in
which it was seen. Out is a ball that was not seen for LOST s, or was seen beyond the rim, as `navigate`
tells `ball_out`.
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

HOLD = 0.2  # s, as the leaf Settle
LOST = 1.0  # s
ANGLES = 120  # of the table of expected times, per ring


@dataclass(frozen=True)
class Verdict:
    """Each (rows,): reward, whether the ball has arrived, whether it is out (unseen, or out of the maze), whether it
    has left the maze, in which ring it was seen."""

    reward: Array
    arrived: np.ndarray
    out: np.ndarray
    left: np.ndarray
    ring: IntArray


@lru_cache(maxsize=8)
def expected_times(maze: Maze, goal: int) -> Array:
    """(rings, ANGLES + 1): s to the goal ring from angles -pi to pi; infinite where there is no way."""
    graph, table = RouteGraph(maze), np.full((len(maze.rings), ANGLES + 1), math.inf)
    for ring in maze.rings:
        for k in range(ANGLES):
            route = graph.route(ring.number, goal, -math.pi + math.tau * k / ANGLES)
            table[ring.number - 1, k] = math.inf if route is None else route.expected_s
    table[:, -1] = table[:, 0]
    return table


class Judge:
    """Judges N balls. Raises SettingsError where there is no way from a ring that an episode may begin in."""

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
        self._votes = np.full((number, SAMPLES), -1)  # of the last samples: 1 outside, -1 inside, 0 not seen
        self._beyond = rim_of(maze) + SIGMAS * EstimatorOptions().camera_sigma  # m

    def reset(self, rows: IntArray) -> None:
        """Begin anew, with what the senses know."""
        self._since[rows], self._votes[rows] = math.nan, -1
        self._phi[rows] = self.potential(rows)

    def potential(self, rows: IntArray) -> Array:
        """phi of where the balls were seen last; 1 at the goal, 0 where it is farthest."""
        radius, theta = self._senses.place(rows)
        at = (theta + math.pi) / math.tau * ANGLES
        low = np.minimum(at.astype(np.int64), ANGLES - 1)
        ring = self._senses.ring(radius) - 1
        share = at - low
        return (1.0 - share) * self._potential[ring, low] + share * self._potential[ring, low + 1]

    def judge(self, rows: IntArray) -> Verdict:
        """After the senses have taken in new samples."""
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
    """Since when something holds, NaN where it does not."""
    return np.where(holds, np.where(np.isnan(since), t, since), math.nan)
