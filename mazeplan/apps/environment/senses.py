"""Memory of the measurements of a rig, and the observation made from it.

This module does not smooth, predict or look into the simulation: a rig on a table would give the same. Positions carry
the camera's noise and its delay. While the ball is not seen, its last position and speed stay. Speeds and tilt rates
are differences over two samples; for speeds, only samples that show the ball count.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from mazeplan.core.records import Observation
from mazeplan.maze.geometry import Maze

NAMES = (
    "radius", "cos_theta", "sin_theta", "radial_speed", "tangential_speed", "beta", "gamma", "beta_rate",
    "gamma_rate", "u_beta", "u_gamma", "ring", "unseen",
)  # fmt: skip
HIGH = np.array([2.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 5.0, 5.0, 1.0, 1.0, 1.0, 1.0], dtype=np.float32)
LOW = np.where(np.isin(NAMES, ("radius", "ring", "unseen")), np.float32(0.0), -HIGH).astype(np.float32)
SPEED = 1.0  # m/s
RATE = 10.0  # tilt limits a second
UNSEEN = 1.0  # s; longer times without the ball give the same observation
APART = 2  # samples from one end of a difference to the other


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
