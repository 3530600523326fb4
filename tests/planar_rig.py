"""A rig for tests of behaviour: the planar model played as a machine, with mishaps on order.

It shares its equations with the planner on purpose (these tests are about decisions, not about physics) and is fast.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mazeplan.maze.geometry import Maze
from mazeplan.models.ball import BallModel
from mazeplan.models.modelfile import RigModel
from mazeplan.models.planar import PlanarModel, predict
from mazeplan.records import Observation
from mazeplan.settings import load_settings

DT = 1.0 / 30.0


# no deadline in wall time: or what a run does would depend on how busy the machine is
PATIENT = load_settings().with_values({"travel": {"deadline_ms": 1e6}})


def known(maze):
    """The model of a rig that has been identified: textbook values, no dry friction, surely no delay of the camera."""
    model = RigModel.nominal(maze)
    balls = {n: BallModel(tuple(e for e in b.effects if e.name != "dry_friction")) for n, b in model.balls.items()}
    return replace(model, balls=balls, data=({"file": "identified.mcap"},))


class PlanarRig:
    """`mishap(rig)` is called before each sample and may change `z`, `hidden` or `glued`."""

    rate_hz = 30.0
    realtime = False

    def __init__(self, maze: Maze, settings=None, mishap: Callable[[PlanarRig], None] | None = None) -> None:
        self.maze, self.mishap = maze, mishap
        self.planar = PlanarModel.build(maze, known(maze))
        self.hidden = self.glued = False
        self.levelled = self.closed = 0
        self.commands: list[tuple[float, float]] = []

    def reset(self, *, ring: int, theta: float, rng) -> None:
        radius = self.maze.track_radius(ring)
        self.z = np.zeros(8)
        self.z[:2] = radius * math.cos(theta), radius * math.sin(theta)
        self.t, self.u, self.fresh = 0.0, np.zeros((1, 2)), True

    def place(self, ring: int, theta: float) -> None:
        """Put the ball elsewhere, at rest."""
        radius = self.maze.track_radius(ring)
        self.z[:4] = radius * math.cos(theta), radius * math.sin(theta), 0.0, 0.0

    @property
    def ring(self) -> int:
        return self.maze.ring_at(math.hypot(self.z[0], self.z[1]))

    def observe(self) -> Observation:
        if not self.fresh:
            stuck = self.z[:4].copy()
            predict(self.z, self.t, self.t + DT, np.array([self.t]), self.u, *self.planar.arrays())
            if self.glued:
                self.z[:4] = *stuck[:2], 0.0, 0.0
            self.t += DT
        self.fresh = False
        if self.mishap is not None:
            self.mishap(self)
        x, y = (None, None) if self.hidden else (float(self.z[0]), float(self.z[1]))
        return Observation(self.t, x, y, float(self.z[4]), float(self.z[6]))

    def command(self, u_beta: float, u_gamma: float) -> None:
        limit = self.maze.tilt_limit + 1e-9
        assert abs(u_beta) <= limit
        assert abs(u_gamma) <= limit
        self.commands.append((u_beta, u_gamma))
        self.u = np.array([[u_beta, u_gamma]])

    def level(self) -> None:
        self.levelled += 1
        self.u = np.zeros((1, 2))

    def close(self) -> None:
        self.closed += 1
