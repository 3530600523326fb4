"""What else pulls at the ball of the simulated rig: a magnet under the plate, a plate that is not flat.

magnet   A c (s / d) (1 + s^2 / d^2)^-4 towards its spot, s away from it, at depth d: the gradient of the squared
         field of a dipole; c makes the strongest pull, at s = d / sqrt(7), A
saddle   height H (r / R)^2 cos 2 (theta - phi), R the outer radius of the maze; downhill with g times the slope
"""

from __future__ import annotations

import math

import numpy as np

from mazeplan.maze.geometry import Maze
from mazeplan.records import Array
from mazeplan.rigs.settings import SimulatedSettings

GRAVITY = 9.81  # m/s^2
PULL = math.sqrt(7.0) * (8.0 / 7.0) ** 4  # makes the strongest pull along the plate 1


class PlateForces:
    """Forces on the ball in the plate frame; false where there are none."""

    def __init__(self, settings: SimulatedSettings, maze: Maze) -> None:
        self._mass, self._settings = maze.ball.mass, settings
        self._spot = 1e-3 * np.array(settings.magnet_mm)
        self._depth, self._edge = 1e-3 * settings.magnet_depth_mm, maze.rings[0].outer_radius
        self._cos, self._sin = (f(2.0 * math.radians(settings.warp_deg)) for f in (math.cos, math.sin))

    def __bool__(self) -> bool:
        return self._settings.magnet_m_s2 > 0.0 or self._settings.warp_mm > 0.0

    def on(self, position: Array) -> Array:
        """Force (3,), N, at a position (3,), m."""
        out = np.zeros(3)
        s = (position[:2] - self._spot) / self._depth
        out[:2] -= self._settings.magnet_m_s2 * PULL * s / (1.0 + float(s @ s)) ** 4
        x, y = position[:2] / self._edge
        slope = 2e-3 * self._settings.warp_mm / self._edge
        out[:2] -= GRAVITY * slope * np.array([x * self._cos + y * self._sin, x * self._sin - y * self._cos])
        return self._mass * out
