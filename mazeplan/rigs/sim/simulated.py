"""A simulated rig: the machine of `machine`, and a camera with delay and noise.

The simulation sets the time. Samples come `rate_hz` times a second.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mazeplan.core.errors import RigError, SettingsError
from mazeplan.core.records import Array, Observation
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.sim.forces import BallForces, FloorFriction, Kerb, PlateForces
from mazeplan.rigs.sim.gimbal import Gimbal
from mazeplan.rigs.sim.machine import CHUNKS, Machine
from mazeplan.rigs.sim.settings import Fault, SimulatedSettings, settings_from

TOLERANCE = 1e-9  # rad by which a command may exceed the tilt limit


class _Trail:
    """Memory of the camera for one ball.

    path: `Machine.scene` at the ends of the last chunks.
    seen: scenes of the last pictures; the present sample shows the oldest of them.
    lost: number of samples for which the ball stays lost."""

    def __init__(self, scene: Array, chunks: int, pictures: int) -> None:
        self.path: deque[Array] = deque([scene] * chunks, maxlen=chunks)
        self.seen: deque[Array] = deque(maxlen=pictures)
        self.lost = 0


class SimulatedRig:
    """See `interface.Rig`. settings: keys of a file such as ideal.yaml, or SimulatedSettings; build: see `Machine`."""

    realtime = False  # time advances only in observe(), so it needs no watchdog

    def __init__(
        self,
        maze: Maze,
        settings: Mapping[str, Any] | SimulatedSettings | None = None,
        build: Callable[[], Gimbal] | None = None,
    ) -> None:
        self.maze = maze
        self.settings = settings if isinstance(settings, SimulatedSettings) else settings_from(settings or {})
        self.rate_hz, self.balls = self.settings.rate_hz, maze.balls
        if maze.balls > 1:
            _check_several(self.settings, maze, build)
        self.machine = Machine(maze, self.settings, build)
        self._samples = 0
        self._rng = np.random.default_rng(0)

    # -- life -------------------------------------------------------------------------------------------------------

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        """Place the ball at rest in the middle of a ring, level the plate, and set time to 0."""
        self.machine.reset(ring=ring, theta=theta)
        self._rng, self._samples = rng, 0
        late = 1e-3 * self.settings.camera_late_ms * self.rate_hz * CHUNKS
        self._late = late - math.floor(late)  # fraction of a chunk
        frames = self.settings.camera_delay_frames + 1
        self._balls = [_Trail(scene, math.floor(late) + 2, frames) for scene in self._scenes()]

    def close(self) -> None:
        """Release memory. A second call does nothing."""
        self.machine.close()

    # -- the loop ---------------------------------------------------------------------------------------------------

    def observe(self) -> Observation:
        """The next sample. The first is at time 0, the others follow 1 / rate_hz apart."""
        machine = self.machine
        machine.check()
        if self._samples > 0:
            for _ in range(CHUNKS):
                machine.step()
                for ball, scene in zip(self._balls, self._scenes(), strict=True):
                    ball.path.append(scene)
        t = self._samples / self.rate_hz
        self._samples += 1
        for ball in self._balls:
            ball.seen.append((1.0 - self._late) * ball.path[1] + self._late * ball.path[0])
        x, y = self._picture(t, self._balls[0])
        noise = math.radians(self.settings.tilt_noise_deg) * self._rng.standard_normal(2)
        beta, gamma = machine.tilt
        if self.settings.tilt_scale != (1.0, 1.0):
            beta, gamma = self.settings.tilt_scale[0] * beta, self.settings.tilt_scale[1] * gamma
        beta, gamma = float(beta + noise[0]), float(gamma + noise[1])
        others = [Observation(t, *self._picture(t, ball), beta, gamma) for ball in self._balls[1:]]
        return Observation(t, x, y, beta, gamma, tuple(others))

    def _scenes(self) -> list[Array]:
        """`Machine.scene` of each ball."""
        return [self.machine.scene(), *self.machine.others()]

    def command(self, u_beta: float, u_gamma: float) -> None:
        """Hold this tilt from now on. Raises RigError for NaN and for a tilt beyond the limit."""
        self.machine.check()
        limit = self.maze.tilt_limit + TOLERANCE
        for name, value in (("u_beta", u_beta), ("u_gamma", u_gamma)):
            if not -limit <= value <= limit:  # also refuses NaN
                raise RigError(f"{name}: got {value} rad, expected at most {self.maze.tilt_limit:.4f} rad either way")
        self.machine.command(u_beta, u_gamma)

    def level(self) -> None:
        """Level the plate now, and drop delayed commands."""
        if self.machine.ready:
            self.machine.level()

    # -- camera -----------------------------------------------------------------------------------------------------

    def _picture(self, t: float, ball: _Trail) -> tuple[float | None, float | None]:
        """Measured x, y of a ball, m, or None. Each sample draws the same random numbers, whatever the settings."""
        settings, rng = self.settings, self._rng
        noise, wrong = rng.standard_normal(2), rng.standard_normal(2)
        lost, outlier = rng.random(2)
        if ball.lost > 0:
            ball.lost -= 1
        elif lost < settings.ball_lost_probability:
            ball.lost = settings.ball_lost_frames
        if ball.lost > 0 or self.machine.blind(t):
            return None, None
        turn = math.radians(settings.camera_rotation_deg)
        place = (float(ball.seen[0][0]), float(ball.seen[0][1]))
        if math.isnan(place[0]):  # the picture has no ball
            return None, None
        x, y = (settings.camera_scale * part for part in place) if settings.camera_scale != 1.0 else place
        position = np.array([math.cos(turn) * x - math.sin(turn) * y, math.sin(turn) * x + math.cos(turn) * y])
        position = position + 1e-3 * (np.array(settings.camera_offset_mm) + settings.camera_noise_mm * noise)
        if settings.lens_per_m2 != 0.0:
            position = position + self._bent(position - 1e-3 * settings.camera_noise_mm * noise)
        if outlier < settings.outlier_probability:
            position = position + 1e-3 * settings.outlier_mm * wrong
        return float(position[0]), float(position[1])

    def _bent(self, position: Array) -> Array:
        """Shift (2,) of a position by the lens, m."""
        away = position - 1e-3 * np.array(self.settings.lens_mm)
        return self.settings.lens_per_m2 * float(away @ away) * away

    def inject(self, fault: Fault) -> None:
        """See `Machine.inject`."""
        self.machine.inject(fault)

    # -- true state, which only a simulation has -------------------------------------------------------------------

    def truth(self) -> Array:
        """See `Machine.truth`."""
        return self.machine.truth()

    def others(self) -> list[Array]:
        """See `Machine.others`."""
        return self.machine.others()

    def ball(self) -> tuple[Array, Array, Array]:
        """See `Machine.ball`."""
        return self.machine.ball()

    def set_ball(self, position: Array, velocity: Array, spin: Array) -> None:
        """See `Machine.set_ball`."""
        self.machine.set_ball(position, velocity, spin)


def _check_several(settings: SimulatedSettings, maze: Maze, build: Callable[[], Gimbal] | None) -> None:
    """Raises SettingsError for several balls with a user's model, or forces on one ball only."""
    parts = (
        PlateForces(settings, maze),
        BallForces(settings, maze),
        FloorFriction(settings, maze),
        Kerb(settings, maze),
    )
    one = None
    if build is not None:
        one = "a model of its own"
    elif any(parts):
        one = "forces along the way of the ball"
    if one is not None:
        raise SettingsError(f"got {maze.balls}, expected 1: a rig with {one} has one ball", key="balls")
