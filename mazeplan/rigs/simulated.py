"""A simulated rig on MuJoCo: contacts, a gimbal with servos, a ball that rolls and spins, and a camera that is late
and noisy.

It shares no equation with the planner's models. Time is the simulation's; one sample is `rate_hz`. Commands go to
the servo in
`CHUNKS` parts a sample, so that slew limit, command delay and faults act on a finer grid than the samples.
"""

from __future__ import annotations

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module tells type checkers nothing of its names)
import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from mazeplan.errors import RigError
from mazeplan.maze.geometry import Maze
from mazeplan.records import Array, Observation
from mazeplan.rigs.faults import FaultBox
from mazeplan.rigs.forces import PlateForces
from mazeplan.rigs.mjcf import SUBSTEPS, mjcf
from mazeplan.rigs.settings import SimulatedSettings, settings_from
from mazeplan.rigs.surprise import answer, surprised

CHUNKS = 5  # per sample; 1/150 s at 30 Hz
AXES = ("beta", "gamma")
TOLERANCE = 1e-9  # rad, of the tilt limit
_WHOLE = mujoco.mjtState.mjSTATE_INTEGRATION


@dataclass(frozen=True)
class Snapshot:
    """MuJoCo's state, and of the servos what they are told, where their drive is, what their gears pass on, and the
    commands under way."""

    state: Array
    target: Array
    ctrl: Array
    played: Array
    queue: tuple[tuple[float, Array], ...]


class SimulatedRig:
    """See `interface.Rig`. settings: a mapping as in rigs/ideal.yaml, or SimulatedSettings."""

    realtime = False  # its time passes in observe() only: no watchdog

    def __init__(self, maze: Maze, settings: Mapping[str, Any] | SimulatedSettings | None = None) -> None:
        self.maze = maze
        given = settings if isinstance(settings, SimulatedSettings) else settings_from(settings or {})
        self.surprise = answer(given, maze)  # for who asks afterwards
        self.settings = surprised(given, maze)
        self.rate_hz = self.settings.rate_hz
        self._model: mujoco.MjModel | None = None
        self._data: mujoco.MjData | None = None
        self._samples = 0
        self._rng = np.random.default_rng(0)

    # -- life -------------------------------------------------------------------------------------------------------

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        """Place the ball at rest in the middle of a ring, level the plate, time 0."""
        if self._model is None:
            self._model = mujoco.MjModel.from_xml_string(mjcf(self.maze, self.settings))
            self._data = mujoco.MjData(self._model)
        model, data = self._model, self._machine()
        mujoco.mj_resetData(model, data)
        radius = self.maze.track_radius(ring)
        data.qpos[2:5] = radius * math.cos(theta), radius * math.sin(theta), self.maze.ball.radius
        data.qpos[5] = 1.0
        mujoco.mj_forward(model, data)
        self._rng, self._samples, self._lost = rng, 0, 0
        self._target = self._ctrl = np.zeros(2)
        self._queue: deque[tuple[float, Array]] = deque()
        self._played = np.zeros(2)
        both = self.settings.backlash_axis == "both"
        play = [
            math.radians(self.settings.backlash_deg) * (both or self.settings.backlash_axis == axis) for axis in AXES
        ]
        self._half_play = 0.5 * np.array(play)
        self._forces = PlateForces(self.settings, self.maze)
        self._seen: deque[Array] = deque(maxlen=self.settings.camera_delay_frames + 1)
        late = 1e-3 * self.settings.camera_late_ms * self.rate_hz * CHUNKS
        self._late = late - math.floor(late)  # of a chunk
        self._path = deque([self.truth()[:2]] * (math.floor(late) + 2), maxlen=math.floor(late) + 2)
        self._faults = FaultBox(self.settings.faults, model, data, self.maze)

    def close(self) -> None:
        """Give memory back; may be called twice."""
        self._model = self._data = None

    def _machine(self) -> mujoco.MjData:
        if self._data is None or self._model is None:
            raise RigError("the simulated rig was used before reset() or after close()")
        return self._data

    # -- the loop ---------------------------------------------------------------------------------------------------

    def observe(self) -> Observation:
        """The next sample: the first at time 0, each further one 1 / rate_hz later."""
        data = self._machine()
        if self._samples > 0:
            for _ in range(CHUNKS):
                self._step(data)
        t = self._samples / self.rate_hz
        self._samples += 1
        self._seen.append((1.0 - self._late) * self._path[1] + self._late * self._path[0])
        x, y = self._picture(t)
        noise = math.radians(self.settings.tilt_noise_deg) * self._rng.standard_normal(2)
        return Observation(t, x, y, float(data.qpos[0] + noise[0]), float(data.qpos[1] + noise[1]))

    def _step(self, data: mujoco.MjData) -> None:
        assert self._model is not None
        dt = 1.0 / (self.rate_hz * CHUNKS)
        now = float(data.time)
        while self._queue and self._queue[0][0] <= now + 1e-9:
            self._target = self._queue.popleft()[1]
        most = math.radians(self.settings.servo_slew_deg_s) * dt
        self._ctrl = self._ctrl + np.clip(self._target - self._ctrl, -most, most)
        self._played = np.clip(self._played, self._ctrl - self._half_play, self._ctrl + self._half_play)
        data.ctrl[:] = self._faults.servo(now, self._played)
        self._faults.before_step(now)
        if self._forces:
            plate, _ = self._plate()
            data.body("ball").xfrc_applied[:3] = plate @ self._forces.on(plate.T @ data.qpos[2:5])
        mujoco.mj_step(self._model, data, nstep=SUBSTEPS // CHUNKS)
        self._faults.after_step(float(data.time))
        self._path.append(self.truth()[:2])

    def command(self, u_beta: float, u_gamma: float) -> None:
        """Hold this tilt from now on. Raises RigError for NaN or beyond the tilt limit."""
        data, limit = self._machine(), self.maze.tilt_limit + TOLERANCE
        for name, value in (("u_beta", u_beta), ("u_gamma", u_gamma)):
            if not -limit <= value <= limit:  # also refuses NaN
                raise RigError(f"{name}: got {value} rad, expected at most {self.maze.tilt_limit:.4f} rad either way")
        wanted = np.array([u_beta, u_gamma], dtype=float)
        last = self._queue[-1][1] if self._queue else self._target
        band = math.radians(self.settings.deadband_deg)
        wanted = np.where(np.abs(wanted - last) < band, last, wanted) if band > 0.0 else wanted
        self._queue.append((float(data.time) + 1e-3 * self.settings.command_delay_ms, wanted))

    def level(self) -> None:
        """Level the plate, now: the queue of delayed commands is dropped."""
        if self._data is not None:
            self._queue.clear()
            self._target = np.zeros(2)

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
        if self._lost > 0 or self._faults.blackout(t):
            return None, None
        turn = math.radians(settings.camera_rotation_deg)
        x, y = self._seen[0]
        position = np.array([math.cos(turn) * x - math.sin(turn) * y, math.sin(turn) * x + math.cos(turn) * y])
        position = position + 1e-3 * (np.array(settings.camera_offset_mm) + settings.camera_noise_mm * noise)
        if outlier < settings.outlier_probability:
            position = position + 1e-3 * settings.outlier_mm * wrong
        return float(position[0]), float(position[1])

    # -- what only a simulation knows ------------------------------------------------------------------------------

    def truth(self) -> Array:
        """x, y, z (m), x_dot, y_dot (m/s) of the ball in the plate frame, beta, gamma (rad): shape (7,)."""
        position, velocity, _ = self.ball()
        data = self._machine()
        return np.array([*position, velocity[0], velocity[1], float(data.qpos[0]), float(data.qpos[1])])

    def ball(self) -> tuple[Array, Array, Array]:
        """Position (m), velocity (m/s) and spin (rad/s) of the ball in the plate frame, (3,) each."""
        data, (plate, omega) = self._machine(), self._plate()
        position = plate.T @ data.qpos[2:5]
        velocity = plate.T @ data.qvel[2:5] - np.cross(omega, position)
        spin = plate.T @ (_rotation(data.qpos[5:9]) @ data.qvel[5:8]) - omega
        return position, velocity, spin

    def set_ball(self, position: Array, velocity: Array, spin: Array) -> None:
        """Put the ball there, (3,) each in the plate frame; all else goes on as it was."""
        data, (plate, omega) = self._machine(), self._plate()
        data.qpos[2:5] = plate @ position
        data.qvel[2:5] = plate @ (velocity + np.cross(omega, position))
        data.qvel[5:8] = _rotation(data.qpos[5:9]).T @ (plate @ (spin + omega))

    def _plate(self) -> tuple[Array, Array]:
        """Rotation (3, 3) from the plate frame to the room, and the plate's angular velocity (3,) in its own frame:
        gamma_dot about x, beta_dot about the y axis outside."""
        data = self._machine()
        b, c = float(data.qpos[0]), float(data.qpos[1])
        cb, sb, cc, sc = math.cos(b), math.sin(b), math.cos(c), math.sin(c)
        plate = np.array([[cb, sb * sc, sb * cc], [0.0, cc, -sc], [-sb, cb * sc, cb * cc]])
        return plate, np.array([data.qvel[1], cc * data.qvel[0], -sc * data.qvel[0]])

    def snapshot(self) -> Snapshot:
        """The machine as it is, to come back to; what the camera has seen and will draw is not in it."""
        state = np.empty(mujoco.mj_stateSize(self._model, _WHOLE))
        mujoco.mj_getState(self._model, self._machine(), state, _WHOLE)
        return Snapshot(state, self._target, self._ctrl, self._played, tuple(self._queue))

    def restore(self, snapshot: Snapshot) -> None:
        """Back to a snapshot of this very rig. Faults that were injected in between stay."""
        mujoco.mj_setState(self._model, self._machine(), snapshot.state, _WHOLE)
        self._target, self._ctrl, self._played = snapshot.target, snapshot.ctrl, snapshot.played
        self._queue = deque(snapshot.queue)


def _rotation(quaternion: Array) -> Array:
    out = np.empty(9)
    mujoco.mju_quat2Mat(out, quaternion)
    return out.reshape(3, 3)
