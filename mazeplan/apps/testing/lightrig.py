"""The light rig: a rig that the planar model simulates. A run takes some 50 ms.

It shares its equations with the planner on purpose: tests of trees are about decisions, not about physics. To test
physics, use a rig that MuJoCo simulates (`run_tree(..., rig="toy")`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mazeplan.core.errors import RigError
from mazeplan.core.records import Observation
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.dynamics.planar import predict

RATE = 30.0  # Hz
TOLERANCE = 1e-9  # rad, of the tilt limit


def identified(maze: Maze) -> RigModel:
    """The model of the light rig: textbook values, no dry friction, a camera whose delay is known to be zero."""
    model = RigModel.nominal(maze)
    balls = {n: BallModel(tuple(e for e in b.effects if e.name != "dry_friction")) for n, b in model.balls.items()}
    return replace(model, balls=balls, camera_delay_stderr=0.0, data=({"file": "identified.mcap"},))


Mishap = Callable[["LightRig"], object]


class LightRig:
    """See `rigs.interface.Rig`. `mishap(rig)` is called before each sample. It may change the public attributes, and
    call `place`, `put`, `push` and `block`.

    out_s: s that a run waits for a ball that is out, as on a real rig where somebody can put it back
    t: time, s
    levelled, closed: number of calls of `level` and `close`
    commands: all commands so far, rad
    z: x, y, vx, vy, beta, beta_dot, gamma, gamma_dot (m, m/s, rad, rad/s)
    hidden: the camera sees nothing
    glued: the ball keeps its place on the plate
    dead: axes that keep their last command
    u: the present command, rad, shape (1, 2)"""

    rate_hz = RATE
    realtime = False  # time passes only in observe()
    out_s: float | None = None

    def __init__(self, maze: Maze, settings: Mapping[str, Any] | None = None, mishap: Mishap | None = None) -> None:
        self.maze, self.mishap = maze, mishap
        self._model = identified(maze)
        self._blocked: frozenset[str] = frozenset()
        self._planar = self._model.planar(maze)
        self.levelled = self.closed = 0
        self.commands: list[tuple[float, float]] = []
        self.u, self.dead = np.zeros((1, 2)), frozenset[str]()

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator | None) -> None:
        """Start at time 0: the ball rests in the middle of a ring, the plate is level, no mishap acts."""
        self.z = np.zeros(8)
        self.place(ring, theta)
        self.hidden = self.glued = False
        self.dead = frozenset()
        self.block(frozenset())
        self.t, self.u, self._fresh = 0.0, np.zeros((1, 2)), True

    # -- what a mishap may do ---------------------------------------------------------------------------------------

    @property
    def ring(self) -> int:
        """The ring that the ball is in."""
        return self.maze.ring_at(math.hypot(self.z[0], self.z[1]))

    @property
    def theta(self) -> float:
        """Angle of the ball, rad."""
        return math.atan2(self.z[1], self.z[0])

    def place(self, ring: int, theta: float) -> None:
        """Put the ball into the middle of a ring, at rest."""
        self.put(self.maze.track_radius(ring), theta)

    def put(self, r: float, theta: float) -> None:
        """Put the ball at a radius r, m, and an angle theta, rad, at rest."""
        self.z[:4] = r * math.cos(theta), r * math.sin(theta), 0.0, 0.0

    def push(self, speed: float, direction: float) -> None:
        """Kick the ball. speed: change of its speed, m/s; direction: in the plate, rad."""
        self.z[2] += speed * math.cos(direction)
        self.z[3] += speed * math.sin(direction)

    def block(self, openings: frozenset[str]) -> None:
        """Plug these openings, and no others."""
        if openings != self._blocked:
            self._blocked = openings
            free = tuple(opening for opening in self.maze.openings if opening.name not in openings)
            self._planar = self._model.planar(replace(self.maze, openings=free))

    # -- a rig ------------------------------------------------------------------------------------------------------

    def observe(self) -> Observation:
        """The next sample. The first one is at time 0."""
        if not self._fresh:
            before, dt = self.z[:4].copy(), 1.0 / self.rate_hz
            predict(self.z, self.t, self.t + dt, np.array([self.t]), self.u, *self._planar)
            if self.glued:
                self.z[:4] = *before[:2], 0.0, 0.0
            self.t += dt
        self._fresh = False
        if self.mishap is not None:
            self.mishap(self)
        x, y = (None, None) if self.hidden else (float(self.z[0]), float(self.z[1]))
        return Observation(self.t, x, y, float(self.z[4]), float(self.z[6]))

    def command(self, u_beta: float, u_gamma: float) -> None:
        """Hold this tilt. Raises RigError for NaN or beyond the tilt limit."""
        limit = self.maze.tilt_limit + TOLERANCE
        for name, value in (("u_beta", u_beta), ("u_gamma", u_gamma)):
            if not -limit <= value <= limit:  # also refuses NaN
                raise RigError(f"{name}: got {value} rad, expected at most {self.maze.tilt_limit:.4f} rad either way")
        self.commands.append((u_beta, u_gamma))
        self._set(u_beta, u_gamma)

    def level(self) -> None:
        """Level the plate."""
        self.levelled += 1
        self._set(0.0, 0.0)

    def close(self) -> None:
        """Count the call; there is nothing to release."""
        self.closed += 1

    def _set(self, u_beta: float, u_gamma: float) -> None:
        last = self.u[0]
        beta = last[0] if "beta" in self.dead else u_beta
        self.u = np.array([[beta, last[1] if "gamma" in self.dead else u_gamma]])
