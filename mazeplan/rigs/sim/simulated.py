"""A simulated rig: the machine of `machine`, and a camera with delay and noise.

The simulation sets the time. Samples come `rate_hz` times a second.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from mazeplan.core.errors import SettingsError
from mazeplan.core.records import Array, Observation
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.files import validated
from mazeplan.rigs.interface import check_command
from mazeplan.rigs.sim.machine import CHUNKS, Build, Machine
from mazeplan.rigs.sim.settings import Fault, SimulatedSettings

Given = Mapping[str, Any] | SimulatedSettings


class _Trail:
    """Memory of the camera for one ball."""

    def __init__(self, scene: Array, chunks: int, pictures: int) -> None:
        self.path: deque[Array] = deque([scene] * chunks, maxlen=chunks)  # at the ends of the last chunks
        self.seen: deque[Array] = deque(maxlen=pictures)  # scenes of the last pictures; a sample shows the oldest one
        self.lost = 0  # number of samples for which the ball stays lost


class SimulatedRig:
    """See `interface.Rig`. settings: keys of a file such as ideal.yaml; build: see `Machine`."""

    realtime = False  # time advances only in observe(), so it needs no watchdog

    def __init__(self, maze: Maze, settings: Given | None = None, build: Build | None = None) -> None:
        self.maze = maze
        given = isinstance(settings, SimulatedSettings)
        self.settings = settings if given else validated(SimulatedSettings, settings or {})
        self.rate_hz = self.settings.rate_hz
        self.balls = maze.balls
        self.machine = Machine(maze, self.settings, build)
        if maze.balls > 1 and (build is not None or self.machine.forces.any):
            one = "a model of its own" if build is not None else "forces along the way of the ball"
            raise SettingsError(f"got {maze.balls}, expected 1: a rig with {one} has one ball", key="balls")
        self._samples = 0
        self._rng = np.random.default_rng(0)

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        """Place the ball at rest in the middle of a ring, level the plate, and set time to 0."""
        self.machine.reset(ring=ring, theta=theta)
        self._rng = rng
        self._samples = 0
        late = 1e-3 * self.settings.camera_late_ms * self.rate_hz * CHUNKS
        self._late = late - math.floor(late)  # fraction of a chunk
        frames = self.settings.camera_delay_frames + 1
        self._balls = [_Trail(scene, math.floor(late) + 2, frames) for scene in self.machine.scenes()]

    def close(self) -> None:
        """Release memory. A second call does nothing."""
        self.machine.close()

    def observe(self) -> Observation:
        """The next sample. The first is at time 0, the others follow 1 / rate_hz apart."""
        machine, gimbal = self.machine, self.machine.gimbal
        if self._samples > 0:
            for _ in range(CHUNKS):
                machine.step()
                for ball, scene in zip(self._balls, machine.scenes(), strict=True):
                    ball.path.append(scene)
        t = self._samples / self.rate_hz
        self._samples += 1
        for ball in self._balls:
            ball.seen.append((1.0 - self._late) * ball.path[1] + self._late * ball.path[0])
        x, y = self._picture(t, self._balls[0])
        noise = math.radians(self.settings.tilt_noise_deg) * self._rng.standard_normal(2)
        beta, gamma = gimbal.tilt
        if self.settings.tilt_scale != (1.0, 1.0):
            beta, gamma = self.settings.tilt_scale[0] * beta, self.settings.tilt_scale[1] * gamma
        beta, gamma = float(beta + noise[0]), float(gamma + noise[1])
        others = [Observation(t, *self._picture(t, ball), beta, gamma) for ball in self._balls[1:]]
        return Observation(t, x, y, beta, gamma, tuple(others))

    def command(self, u_beta: float, u_gamma: float) -> None:
        """Hold this tilt from now on. Raises RigError for NaN and for a tilt beyond the limit."""
        check_command(self.maze, u_beta, u_gamma)
        self.machine.command(u_beta, u_gamma)

    def level(self) -> None:
        """Level the plate now, and drop delayed commands."""
        self.machine.level()

    def _picture(self, t: float, ball: _Trail) -> tuple[float | None, float | None]:
        """Measured x, y of a ball, m, or None. Each sample draws the same random numbers, whatever the settings."""
        settings, rng = self.settings, self._rng
        noise, wrong = rng.standard_normal(2), rng.standard_normal(2)
        lost, outlier = rng.random(2)
        if ball.lost > 0:
            ball.lost -= 1
        elif lost < settings.ball_lost_probability:
            ball.lost = settings.ball_lost_frames
        if ball.lost > 0 or self.machine.faults.active("blackout", t):
            return None, None
        turn = math.radians(settings.camera_rotation_deg)
        place = (float(ball.seen[0][0]), float(ball.seen[0][1]))
        if math.isnan(place[0]):  # the picture has no ball
            return None, None
        x, y = (settings.camera_scale * part for part in place) if settings.camera_scale != 1.0 else place
        position = np.array([math.cos(turn) * x - math.sin(turn) * y, math.sin(turn) * x + math.cos(turn) * y])
        position = position + 1e-3 * (np.array(settings.camera_offset_mm) + settings.camera_noise_mm * noise)
        if settings.lens_per_m2 != 0.0:
            away = position - 1e-3 * settings.camera_noise_mm * noise - 1e-3 * np.array(settings.lens_mm)
            position = position + settings.lens_per_m2 * float(away @ away) * away
        if outlier < settings.outlier_probability:
            position = position + 1e-3 * settings.outlier_mm * wrong
        return float(position[0]), float(position[1])

    def inject(self, fault: Fault) -> None:
        """See `Machine.inject`."""
        self.machine.inject(fault)

    def truth(self) -> Array:
        """See `Machine.truth`."""
        return self.machine.truth()
