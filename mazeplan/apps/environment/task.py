"""The task of the agent: its options; observations, rewards and ends of episodes, from the measurements of a rig.

Observation: nothing smooths, predicts or looks into the simulation; a rig on a table would give the same. Positions
carry the camera's noise and its delay. While the ball is not seen, its last position and speed stay. Speeds and tilt
rates are differences over two samples; for speeds, only samples that show the ball count.

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
from typing import Literal

import numpy as np
from pydantic import Field

from mazeplan.control.estimation.estimator import EstimatorOptions
from mazeplan.control.estimation.sample_check import RimWatch
from mazeplan.core.errors import InputError, SettingsError
from mazeplan.core.records import Array, Observation
from mazeplan.maze.geometry import Maze
from mazeplan.maze.graph import RouteGraph
from mazeplan.maze.sections import Section
from mazeplan.run.resolve import ring_number

NAMES = (
    "radius", "cos_theta", "sin_theta", "radial_speed", "tangential_speed", "beta", "gamma", "beta_rate",
    "gamma_rate", "u_beta", "u_gamma", "ring", "unseen",
)  # fmt: skip
HIGH = np.array([2.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 5.0, 5.0, 1.0, 1.0, 1.0, 1.0], dtype=np.float32)
LOW = np.where(np.isin(NAMES, ("radius", "ring", "unseen")), np.float32(0.0), -HIGH).astype(np.float32)
SPEED = 1.0  # m/s, the unit of speeds in an observation
RATE = 10.0  # tilt limits a second, the unit of tilt rates
UNSEEN = 1.0  # s; longer times without the ball give the same observation
APART = 2  # samples from one end of a difference to the other
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


class Senses:
    """Memory of a ball: where it was seen last, tilts, commands. It begins at rest, at a ring and an angle (rad)."""

    def __init__(self, maze: Maze, rate_hz: float, first: Observation, ring: int, theta: float) -> None:
        self.maze, self._rate = maze, rate_hz
        x, y = (float(maze.track_radius(ring) * turn(theta)) for turn in (np.cos, np.sin))
        ages = range(APART, -1, -1)
        self._seen = deque(((first.t - age / rate_hz, x, y) for age in ages), APART + 1)  # t, x, y of the last sights
        self._tilts = deque(((first.beta, first.gamma) for _ in ages), APART + 1)
        self._command, self.t = np.zeros(2), first.t
        if first.x is not None and first.y is not None:
            self._seen[-1] = (first.t, first.x, first.y)

    def take(self, sample: Observation, command: np.ndarray) -> None:
        """Store a sample, and the command (2,), rad, that came before it."""
        if sample.x is not None and sample.y is not None:
            self._seen.append((sample.t, sample.x, sample.y))
        self._tilts.append((sample.beta, sample.gamma))
        self._command, self.t = command, sample.t

    @property
    def place(self) -> tuple[float, float]:
        """x, y at which the ball was seen last, m."""
        return self._seen[-1][1:]

    @property
    def radius(self) -> float:
        """Radius at which the ball was seen last, m."""
        return float(np.hypot(*self.place))

    @property
    def theta(self) -> float:
        """Angle at which the ball was seen last, rad."""
        x, y = self.place
        return float(np.arctan2(y, x))

    @property
    def ring(self) -> int:
        """Ring in which the ball was seen last."""
        return self.maze.ring_at(self.radius)

    @property
    def unseen_s(self) -> float:
        """Time since the ball was seen last, s; 0 for a ball in the last sample."""
        return self.t - self._seen[-1][0]

    def state(self) -> np.ndarray:
        """The observation (13,), see NAMES."""
        limit, rim = self.maze.tilt_limit, self.maze.rings[0].outer_radius
        now, before = np.array(self._seen[-1]), np.array(self._seen[0])
        vx, vy = (now[1:] - before[1:]) / max(now[0] - before[0], 1.0 / self._rate)  # a rig's clock may stand still
        radius = self.radius
        c, s = (now[1] / radius, now[2] / radius) if radius > 0.0 else (1.0, 0.0)
        tilt = np.array(self._tilts[-1])
        rate = (tilt - np.array(self._tilts[0])) * (self._rate / APART)
        values = (
            radius / rim, c, s, (c * vx + s * vy) / SPEED, (c * vy - s * vx) / SPEED, *(tilt / limit),
            *(rate / (RATE * limit)), *(self._command / limit), (self.ring - 1) / (len(self.maze.rings) - 1),
            self.unseen_s / UNSEEN,
        )  # fmt: skip
        return np.clip(np.array(values, dtype=np.float32), LOW, HIGH)


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
