"""The machine of the simulated rig on MuJoCo: contacts, a gimbal with servos, a ball that rolls and spins.

The machine gives the true state. Sensors are elsewhere (`simulated`, `emulation.world`). The machine shares no equation
with the planner's models. Time advances in chunks, `CHUNKS` per sample. So slew limit, command delay and faults act on
a finer time grid than the samples.
"""

from __future__ import annotations

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module has no types)
import math
from collections import deque
from collections.abc import Callable
from functools import partial

import mujoco
import numpy as np

from mazeplan.core.errors import RigError
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.sim.forces import BallForces, FloorFriction, Kerb, Motion, PlateForces, check_rings, heavy_side
from mazeplan.rigs.sim.gimbal import Gimbal, MazeGimbal
from mazeplan.rigs.sim.machine_faults import FaultBox, check_fault
from mazeplan.rigs.sim.mjcf import SUBSTEPS
from mazeplan.rigs.sim.nearwalls import near_walls
from mazeplan.rigs.sim.settings import Fault, SimulatedSettings

APART = 1.2  # radii of a ball: distance from the middle of the disc to each of two balls in the disc
CHUNKS = 5  # chunks per sample; a chunk is 1/150 s at 30 Hz
AXES = ("beta", "gamma")


class Machine:
    """Plate, servos and ball of a maze. Call `reset` first.

    build: makes the model; by default `mjcf` generates it from the map.
    chunk_s: duration of one `step`, s.

    Raises SettingsError for an opening, ring or ball in `settings` that the maze does not have."""

    def __init__(self, maze: Maze, settings: SimulatedSettings, build: Callable[[], Gimbal] | None = None) -> None:
        check_rings(settings, maze)
        # _build is no bound method: with a cycle of references the machine would stay in memory after its run
        self.maze, self.settings, self._build = maze, settings, build or partial(_from_map, maze, settings)
        self.chunk_s = 1.0 / (settings.rate_hz * CHUNKS)
        self._gimbal: Gimbal | None = None
        for i, fault in enumerate(settings.faults):
            check_fault(fault, f"faults[{i}]", maze)

    # -- life -------------------------------------------------------------------------------------------------------

    def reset(self, *, ring: int, theta: float) -> None:
        """Put the balls to rest in the middle of a ring, level the plate, set time to 0.

        Several balls are spread evenly over the ring, the first one at theta."""
        if self._gimbal is None:
            self._gimbal = self._build()
        radius, apart = self.maze.track_radius(ring), math.tau / self.maze.balls
        if self.maze.balls > 1:  # in the disc, place the balls beside its middle, so that both have room
            radius = max(radius, APART * self.maze.ball.radius)
        angles = [self.maze.clear_angle(ring, theta + k * apart) for k in range(self.maze.balls)]
        place, *others = (
            np.array([radius * math.cos(angle), radius * math.sin(angle), self.maze.ball.radius]) for angle in angles
        )
        self._hidden, self._floor = BallForces(self.settings, self.maze), FloorFriction(self.settings, self.maze)
        if self._floor:
            self._gimbal.roughen(self.settings.rolling_friction_m)
        self._gimbal.reset(place, *others)
        self._target = self._ctrl = np.zeros(2)
        self._queue: deque[tuple[float, Array]] = deque()
        self._played = np.zeros(2)
        both = self.settings.backlash_axis == "both"
        play = [
            math.radians(self.settings.backlash_deg) * (both or self.settings.backlash_axis == axis) for axis in AXES
        ]
        self._half_play = 0.5 * np.array(play)
        self._forces = PlateForces(self.settings, self.maze)
        self._kerb = Kerb(self.settings, self.maze)
        self._heavy = self._gimbal.ball_rotation().T @ heavy_side(self.settings, angles[0])
        self._mixed = np.array([[1.0, self.settings.servo_coupling[0]], [self.settings.servo_coupling[1], 1.0]])
        self._gain = np.array(self.settings.servo_gain)
        self._faults = FaultBox(self.settings.faults, self._gimbal, self.maze)

    def close(self) -> None:
        """Release memory. A second call does nothing."""
        self._gimbal = None
        vars(self).pop("_faults", None)  # FaultBox also refers to the model

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's data. Raises RigError before reset() and after close()."""
        return self.gimbal.data

    @property
    def gimbal(self) -> Gimbal:
        """The model. Raises RigError before reset() and after close()."""
        self.check()
        assert self._gimbal is not None
        return self._gimbal

    def check(self) -> None:
        """Raises RigError before reset() and after close()."""
        if self._gimbal is None:
            raise RigError("the simulated rig was used before reset() or after close()")

    @property
    def ready(self) -> bool:
        """Whether reset() was called and close() was not."""
        return self._gimbal is not None

    @property
    def time(self) -> float:
        """Time since reset, s."""
        return float(self.data.time)

    # -- motion -----------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """Simulate `chunk_s`."""
        gimbal, now = self.gimbal, self.time
        while self._queue and self._queue[0][0] <= now + 1e-9:
            self._target = self._queue.popleft()[1]
        most = math.radians(self.settings.servo_slew_deg_s) * self.chunk_s
        # np.clip takes many times as long for two numbers
        self._ctrl = self._ctrl + np.minimum(np.maximum(self._target - self._ctrl, -most), most)
        self._played = np.minimum(np.maximum(self._played, self._ctrl - self._half_play), self._ctrl + self._half_play)
        led = self._played if self.settings.servo_gain == (1.0, 1.0) else self._gain * self._played
        gimbal.drive(self._faults.servo(now, led))
        self._faults.before_step(now)
        if self._forces:
            plate, _ = gimbal.plate()
            gimbal.pull(plate @ self._forces.on(plate.T @ gimbal.place()))
        if self._hidden or self._floor or self._kerb:
            self._advance_hidden(now)
        else:
            gimbal.advance()
        self._faults.after_step(self.time)

    def _advance_hidden(self, now: float) -> None:
        """Simulate one chunk with the effects of `forces`."""
        gimbal = self.gimbal
        plate, _ = gimbal.plate()
        before = Motion(*self.ball())
        if self._floor:
            extra = self._floor.extra(before, plate.T @ gimbal.model.opt.gravity)
            gimbal.roughen(self.settings.rolling_friction_m + extra)
        if self._hidden:
            force, torque = self._hidden.on(now + 0.5 * self.chunk_s, before, plate, self._heavy_side())
            gimbal.pull(force + plate @ self._forces.on(before.place) if self._forces else force)
            gimbal.twist(torque)
        gimbal.advance()
        after = Motion(*self.ball())
        if self._kerb.passed(before, after):
            self.set_ball(after.place, self._kerb.left * after.velocity, self._kerb.left * after.spin)

    def _heavy_side(self) -> Array:
        """Unit vector (3,) to the heavy side of the ball in the middle of the next chunk, in the frame of the room."""
        side = self.gimbal.ball_rotation() @ self._heavy
        side = side + 0.5 * self.chunk_s * _cross(self.gimbal.spin(), side)
        return side / math.sqrt(float(side @ side))

    def command(self, u_beta: float, u_gamma: float) -> None:
        """Make the servos move to this tilt, rad, and hold it, after the command delay."""
        wanted = np.array([u_beta, u_gamma], dtype=float)
        if self.settings.servo_coupling != (0.0, 0.0):
            wanted = self._mixed @ wanted
        last = self._queue[-1][1] if self._queue else self._target
        band = math.radians(self.settings.deadband_deg)
        wanted = np.where(np.abs(wanted - last) < band, last, wanted) if band > 0.0 else wanted
        self._queue.append((self.time + 1e-3 * self.settings.command_delay_ms, wanted))

    def aim(self, beta: float, gamma: float) -> None:
        """Set the target of the servos now, rad, without the limits of commands."""
        self._target = np.array([beta, gamma])

    def level(self) -> None:
        """Level the plate now, and drop delayed commands."""
        self._queue.clear()
        self._target = np.zeros(2)

    def inject(self, fault: Fault) -> None:
        """Add a fault. It begins at its `at_s`, or at once if that time is over.

        Raises SettingsError for an opening, ring or ball that the maze does not have."""
        self.check()
        self._faults.add(fault)

    # -- true state, which only a simulation has -------------------------------------------------------------------

    @property
    def tilt(self) -> tuple[float, float]:
        """beta, gamma, rad."""
        return self.gimbal.tilt

    @property
    def position(self) -> Array:
        """x, y of the ball in the plate frame, m, (2,); NaN for a ball that is taken out."""
        return self.scene()[:2]

    def scene(self) -> Array:
        """x, y, z of the ball in the plate frame, m, then beta, gamma, rad; (5,). A ball that is taken out has NaN for
        x, y."""
        return self._scene_of(0)

    def others(self) -> list[Array]:
        """The `scene` of each ball after the first, (5,) each."""
        return [self._scene_of(index) for index in range(1, self.maze.balls)]

    def _scene_of(self, index: int) -> Array:
        gimbal = self.gimbal
        plate, _ = gimbal.plate()
        out = np.empty(5)
        out[:3] = plate.T @ gimbal.place_of(index)
        if self._faults.out(self.time, index):
            out[:2] = math.nan
        out[3:] = gimbal.tilt
        return out

    def blind(self, t: float) -> bool:
        """Whether a fault blinds the camera at time t."""
        return self._faults.blackout(t)

    def truth(self) -> Array:
        """x, y, z (m), x_dot, y_dot (m/s) of the ball in the plate frame, beta, gamma (rad): shape (7,)."""
        position, velocity, _ = self.ball()
        return np.array([*position, velocity[0], velocity[1], *self.tilt])

    def ball(self) -> tuple[Array, Array, Array]:
        """Position (m), velocity (m/s) and spin (rad/s) of the ball in the plate frame, (3,) each."""
        gimbal = self.gimbal
        plate, omega = gimbal.plate()
        position = plate.T @ gimbal.place()
        velocity = plate.T @ gimbal.velocity() - _cross(omega, position)
        return position, velocity, plate.T @ gimbal.spin() - omega

    def set_ball(self, position: Array, velocity: Array, spin: Array) -> None:
        """Set the state of the ball, (3,) each, in the plate frame."""
        gimbal = self.gimbal
        plate, omega = gimbal.plate()
        gimbal.put(plate @ position, plate @ (velocity + _cross(omega, position)), plate @ (spin + omega))


def _from_map(maze: Maze, settings: SimulatedSettings) -> Gimbal:
    walls = near_walls(maze, settings)  # pyright: ignore[reportArgumentType] frozen, so pydantic gives them a hash
    return MazeGimbal(walls, SUBSTEPS // CHUNKS, maze.balls)


def _cross(a: Array, b: Array) -> Array:
    """Cross product (3,) of two vectors (3,). For one pair, np.cross takes many times as long."""
    (a0, a1, a2), (b0, b1, b2) = a.tolist(), b.tolist()
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])
