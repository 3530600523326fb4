"""What is known of N balls from what their rigs measured, and the observation "state" that is made of it.

Nothing here is smoothed, predicted or looked up in the simulation: a rig on a table would give the same. Positions
carry the camera's noise and are as late as its pictures; while the ball is not seen the last position and speed stay.
Speeds are differences over two samples (of those in which the ball was seen), tilt rates the same.
"""

from __future__ import annotations

import numpy as np

from mazeplan.core.records import Array, IntArray
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.sim.fleet import Samples

NAMES = (
    "radius", "cos_theta", "sin_theta", "radial_speed", "tangential_speed", "beta", "gamma", "beta_rate",
    "gamma_rate", "u_beta", "u_gamma", "ring", "unseen",
)  # fmt: skip
HIGH = np.array([2.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 5.0, 5.0, 1.0, 1.0, 1.0, 1.0], dtype=np.float32)
LOW = np.where(np.isin(NAMES, ("radius", "ring", "unseen")), np.float32(0.0), -HIGH).astype(np.float32)
SPEED = 1.0  # m/s
RATE = 10.0  # tilt limits a second
UNSEEN = 1.0  # s; longer is all one
APART = 2  # samples between those of a difference


class Senses:
    """Memory of N balls. x, y: m, where each was seen last; ring: by that; unseen_s: since then; t: s."""

    def __init__(self, maze: Maze, rate_hz: float, number: int) -> None:
        self.maze, self._rate, self._past = maze, rate_hz, APART + 1
        self._where = np.zeros((self._past, number, 3))  # t, x, y where the ball was seen, the newest first
        self._tilt = np.zeros((self._past, number, 2))
        self._command = np.zeros((number, 2))
        self.t = np.zeros(number)
        edges = [0.5 * (a.inner_radius + b.outer_radius) for a, b in zip(maze.rings, maze.rings[1:], strict=False)]
        self._edges = np.array(edges[::-1])  # between rings, the innermost first

    def reset(self, rows: IntArray, samples: Samples, rings: list[int], thetas: list[float]) -> None:
        """Balls were placed at rest, and it is known where."""
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
        """Take in samples and the commands (len(rows), 2), rad, that led to them."""
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
        """As `Maze.ring_at`, of many."""
        return len(self.maze.rings) - np.searchsorted(self._edges, radius, side="left")

    def unseen_s(self, rows: IntArray) -> Array:
        """s since the balls were seen; 0 for those that are."""
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
        told = (
            radius / rim, c, s,
            (c * velocity[:, 0] + s * velocity[:, 1]) / SPEED, (c * velocity[:, 1] - s * velocity[:, 0]) / SPEED,
            *(self._tilt[0, rows] / limit).T, *(rate / (RATE * limit)).T, *(self._command[rows] / limit).T,
            (self.ring(radius) - 1) / (len(self.maze.rings) - 1), self.unseen_s(rows) / UNSEEN,
        )  # fmt: skip
        return np.clip(np.column_stack(told).astype(np.float32), LOW, HIGH)
