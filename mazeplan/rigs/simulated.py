"""A simulated rig: the machine of `machine`, and a camera that is late and noisy.

Time is the simulation's; one sample is `rate_hz`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.errors import RigError
from mazeplan.maze.geometry import Maze
from mazeplan.records import Array, Observation
from mazeplan.rigs.gimbal import Gimbal
from mazeplan.rigs.machine import CHUNKS, Machine, Snapshot
from mazeplan.rigs.settings import Fault, SimulatedSettings, in_run, settings_from
from mazeplan.rigs.surprise import answer, surprised

if TYPE_CHECKING:
    from mazeplan.rigs.camera.sensing import CameraSense

TOLERANCE = 1e-9  # rad, of the tilt limit


class SimulatedRig:
    """See `interface.Rig`. settings: a mapping as in rigs/ideal.yaml, or SimulatedSettings; build: see `Machine`."""

    realtime = False  # its time passes in observe() only: no watchdog

    def __init__(
        self,
        maze: Maze,
        settings: Mapping[str, Any] | SimulatedSettings | None = None,
        build: Callable[[], Gimbal] | None = None,
    ) -> None:
        self.maze = maze
        given = settings if isinstance(settings, SimulatedSettings) else settings_from(settings or {})
        self.surprise = answer(given, maze)  # for who asks afterwards
        self.settings = self._at_first = surprised(given, maze)
        self.rate_hz = self.settings.rate_hz
        self.machine = Machine(maze, self.settings, build)
        self._samples = 0
        self._rng = np.random.default_rng(0)
        self._sense: CameraSense | None = None

    def begin_run(self, number: int) -> None:
        """From the next `reset` on be as in this run of a campaign, the first being 1 (`changes` in the settings)."""
        settings = in_run(self._at_first, number)
        if settings != self.settings:
            self.machine.close()
            self.settings, self.machine = settings, Machine(self.maze, settings)

    # -- life -------------------------------------------------------------------------------------------------------

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        """Place the ball at rest in the middle of a ring, level the plate, time 0."""
        self.machine.reset(ring=ring, theta=theta)
        self._rng, self._samples, self._lost = rng, 0, 0
        self._seen: deque[Array] = deque(maxlen=self.settings.camera_delay_frames + 1)
        late = 1e-3 * self.settings.camera_late_ms * self.rate_hz * CHUNKS
        self._late = late - math.floor(late)  # of a chunk
        self._path = deque([self.machine.scene()] * (math.floor(late) + 2), maxlen=math.floor(late) + 2)
        if self.settings.sense == "camera":
            self._light = rng.spawn(1)[0]  # of pictures only: the other noise stays what it is without

    def close(self) -> None:
        """Give memory back; may be called twice."""
        self.machine.close()

    # -- the loop ---------------------------------------------------------------------------------------------------

    def observe(self) -> Observation:
        """The next sample: the first at time 0, each further one 1 / rate_hz later."""
        machine = self.machine
        machine.check()
        if self._samples > 0:
            for _ in range(CHUNKS):
                machine.step()
                self._path.append(self.machine.scene())
        t = self._samples / self.rate_hz
        self._samples += 1
        self._seen.append((1.0 - self._late) * self._path[1] + self._late * self._path[0])
        x, y = self._picture(t)
        noise = math.radians(self.settings.tilt_noise_deg) * self._rng.standard_normal(2)
        beta, gamma = machine.tilt
        if self.settings.tilt_scale != (1.0, 1.0):
            beta, gamma = self.settings.tilt_scale[0] * beta, self.settings.tilt_scale[1] * gamma
        return Observation(t, x, y, float(beta + noise[0]), float(gamma + noise[1]))

    def command(self, u_beta: float, u_gamma: float) -> None:
        """Hold this tilt from now on. Raises RigError for NaN or beyond the tilt limit."""
        self.machine.check()
        limit = self.maze.tilt_limit + TOLERANCE
        for name, value in (("u_beta", u_beta), ("u_gamma", u_gamma)):
            if not -limit <= value <= limit:  # also refuses NaN
                raise RigError(f"{name}: got {value} rad, expected at most {self.maze.tilt_limit:.4f} rad either way")
        self.machine.command(u_beta, u_gamma)

    def level(self) -> None:
        """Level the plate, now: the queue of delayed commands is dropped."""
        if self.machine.ready:
            self.machine.level()

    # -- camera -----------------------------------------------------------------------------------------------------

    def _picture(self, t: float) -> tuple[float | None, float | None]:
        """Where the camera says the ball is. Each sample draws the same numbers, so that settings do not shift one
        another's."""
        settings, rng = self.settings, self._rng
        noise, wrong = rng.standard_normal(2), rng.standard_normal(2)
        lost, outlier = rng.random(2)
        if self._lost > 0:
            self._lost -= 1
        elif lost < settings.ball_lost_probability:
            self._lost = settings.ball_lost_frames
        if self._lost > 0 or self.machine.blind(t):
            return None, None
        turn = math.radians(settings.camera_rotation_deg)
        place: tuple[float, float] | None = (float(self._seen[0][0]), float(self._seen[0][1]))
        if settings.sense == "camera":
            place, noise, outlier = self._found(), np.zeros(2), 1.0
        if place is None or math.isnan(place[0]):  # there was no ball when the picture was taken
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
        """By how much (2,) the lens shifts a place in the picture, m."""
        away = position - 1e-3 * np.array(self.settings.lens_mm)
        return self.settings.lens_per_m2 * float(away @ away) * away

    def _found(self) -> tuple[float, float] | None:
        """Where the ball is found in a rendered picture."""
        if self._sense is None:
            from mazeplan.rigs.camera.sensing import CameraSense

            self._sense = CameraSense(self.maze)
        x, y, z, beta, gamma = (float(value) for value in self._seen[0])
        sighting = self._sense.look(None if math.isnan(x) else np.array([x, y, z]), beta, gamma, self._light)
        return None if sighting.x is None or sighting.y is None else (sighting.x, sighting.y)

    def inject(self, fault: Fault) -> None:
        """See `Machine.inject`."""
        self.machine.inject(fault)

    # -- what only a simulation knows ------------------------------------------------------------------------------

    def truth(self) -> Array:
        """See `Machine.truth`."""
        return self.machine.truth()

    def pictured(self) -> Array:
        """What the picture of the last sample shows, with its delay: x, y (NaN without a ball), z of the ball in the
        plate frame, m, beta, gamma, rad; (5,)."""
        return self._seen[0].copy()

    def ball(self) -> tuple[Array, Array, Array]:
        """See `Machine.ball`."""
        return self.machine.ball()

    def set_ball(self, position: Array, velocity: Array, spin: Array) -> None:
        """See `Machine.set_ball`."""
        self.machine.set_ball(position, velocity, spin)

    def snapshot(self) -> Snapshot:
        """The machine as it is, to come back to; what the camera has seen and will draw is not in it."""
        return self.machine.snapshot()

    def restore(self, snapshot: Snapshot) -> None:
        """Back to a snapshot of this very rig. Faults that were injected in between stay."""
        self.machine.restore(snapshot)
