"""Memory of the measurements of N balls, and the observation "state" made from it.

This module does not smooth, predict or look into the simulation: a rig on a table would give the same. Positions carry
the camera's noise and its delay. While a ball is not seen, its last position and speed stay. Speeds and tilt rates are
differences over two samples; for speeds, only samples that show the ball count.
"""

from __future__ import annotations

import numpy as np

from mazeplan.apps.environment.worlds import Samples
from mazeplan.core.records import Array, IntArray
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
    """Memory of N balls: where each ball was seen last, tilts, commands.

    t (N,): time of the last sample, s."""

    def __init__(self, maze: Maze, rate_hz: float, number: int) -> None:
        self.maze, self._rate, self._past = maze, rate_hz, APART + 1
        self._where = np.zeros((self._past, number, 3))  # t, x, y of the last sights of the ball, the newest first
        self._tilt = np.zeros((self._past, number, 2))
        self._command = np.zeros((number, 2))
        self.t = np.zeros(number)
        edges = [0.5 * (a.inner_radius + b.outer_radius) for a, b in zip(maze.rings, maze.rings[1:], strict=False)]
        self._edges = np.array(edges[::-1])  # radii of the borders between rings, the innermost first, m

    def reset(self, rows: IntArray, samples: Samples, rings: list[int], thetas: list[float]) -> None:
        """Begin with balls at rest, at known rings and angles (rad)."""
        radius = np.array([self.maze.track_radius(ring) for ring in rings])
        theta = np.array(thetas)
        for age in range(self._past):
            t = samples.t - age / self._rate
            self._where[age, rows] = np.column_stack([t, radius * np.cos(theta), radius * np.sin(theta)])
            self._tilt[age, rows] = np.column_stack([samples.beta, samples.gamma])
        self._command[rows], self.t[rows] = 0.0, samples.t
        seen = np.isfinite(samples.x)
        where = np.column_stack([samples.t, samples.x, samples.y])
        self._where[0, rows[seen]] = where[seen]

    def take(self, rows: IntArray, samples: Samples, commands: Array) -> None:
        """Store samples, and the commands (len(rows), 2), rad, that came before them."""
        seen = np.isfinite(samples.x)
        fresh = rows[seen]
        self._where[1:, fresh] = self._where[:-1, fresh]
        self._where[0, fresh] = np.column_stack([samples.t, samples.x, samples.y])[seen]
        self._tilt[1:, rows] = self._tilt[:-1, rows]
        self._tilt[0, rows] = np.column_stack([samples.beta, samples.gamma])
        self._command[rows], self.t[rows] = commands, samples.t

    def place(self, rows: IntArray) -> tuple[Array, Array]:
        """Radius (m) and angle (rad) at which the balls were seen last."""
        x, y = self._where[0, rows, 1], self._where[0, rows, 2]
        return np.hypot(x, y), np.arctan2(y, x)

    def ring(self, radius: Array) -> IntArray:
        """As `Maze.ring_at`, for many radii (m)."""
        return len(self.maze.rings) - np.searchsorted(self._edges, radius, side="left")

    def unseen_s(self, rows: IntArray) -> Array:
        """Time since the balls were seen last, s; 0 for balls in the last sample."""
        return self.t[rows] - self._where[0, rows, 0]

    def state(self, rows: IntArray) -> np.ndarray:
        """The observations (len(rows), 13), see NAMES."""
        limit, rim = self.maze.tilt_limit, self.maze.rings[0].outer_radius
        now, before = self._where[0, rows], self._where[-1, rows]
        apart = np.maximum(now[:, :1] - before[:, :1], 1.0 / self._rate)  # a rig's clock may stand still
        velocity = (now[:, 1:] - before[:, 1:]) / apart
        radius = np.hypot(now[:, 1], now[:, 2])
        safe = np.maximum(radius, 1e-9)
        c, s = np.where(radius > 0.0, now[:, 1] / safe, 1.0), now[:, 2] / safe
        rate = (self._tilt[0, rows] - self._tilt[-1, rows]) * (self._rate / APART)
        columns = (
            radius / rim, c, s,
            (c * velocity[:, 0] + s * velocity[:, 1]) / SPEED, (c * velocity[:, 1] - s * velocity[:, 0]) / SPEED,
            *(self._tilt[0, rows] / limit).T, *(rate / (RATE * limit)).T, *(self._command[rows] / limit).T,
            (self.ring(radius) - 1) / (len(self.maze.rings) - 1), self.unseen_s(rows) / UNSEEN,
        )  # fmt: skip
        return np.clip(np.column_stack(columns).astype(np.float32), LOW, HIGH)
