"""The machine of the simulated rig on MuJoCo: contacts, a gimbal with servos, a ball that rolls and spins.

The machine gives the true state; `simulated` has the sensors. It shares no equation with the planner's models. Time
advances in chunks, `CHUNKS` per sample. So slew limit, command delay and faults act on a finer time grid than the
samples.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from mazeplan.core.errors import RigError, SettingsError, one_of
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.sim.forces import Forces, Motion, heavy_side
from mazeplan.rigs.sim.gimbal import Gimbal, MazeGimbal, near_walls
from mazeplan.rigs.sim.mjcf import SUBSTEPS
from mazeplan.rigs.sim.settings import Fault, SimulatedSettings

DISC_OFFSET_RADII = 1.2  # radii of a ball: distance from the middle of the disc to each of two balls in the disc
CHUNKS = 5  # chunks per sample; a chunk is 1/150 s at 30 Hz
AXES = ("beta", "gamma")
ASIDE = 0.1  # m beside and above the plate's rim: place of a ball that is taken out
Build = Callable[[], Gimbal]


class Machine:
    """Plate, servos and ball of a maze. Call `reset` first. One `step` takes `chunk_s`, s.

    build: makes the model; by default `mjcf` generates it from the map.

    Raises SettingsError for an opening, ring or ball in `settings` that the maze does not have."""

    def __init__(self, maze: Maze, settings: SimulatedSettings, build: Build | None = None) -> None:
        # _build is no bound method: with a cycle of references the machine would stay in memory after its run
        self.maze = maze
        self.settings = settings
        self._build = build or partial(_from_map, maze, settings)
        self.chunk_s = 1.0 / (settings.rate_hz * CHUNKS)
        self.forces = Forces(settings, maze)
        self._gimbal: Gimbal | None = None
        for i, fault in enumerate(settings.faults):
            check_fault(fault, f"faults[{i}]", maze)

    def reset(self, *, ring: int, theta: float) -> None:
        """Put the balls to rest in a ring, evenly spread, the first one at theta; level the plate, set time to 0."""
        if self._gimbal is None:
            self._gimbal = self._build()
        radius, apart = self.maze.track_radius(ring), math.tau / self.maze.balls
        if self.maze.balls > 1:  # in the disc, place the balls beside its middle, so that both have room
            radius = max(radius, DISC_OFFSET_RADII * self.maze.ball.radius)
        angles = [self.maze.clear_angle(ring, theta + k * apart) for k in range(self.maze.balls)]
        height = self.maze.ball.radius
        places = [np.array([radius * math.cos(angle), radius * math.sin(angle), height]) for angle in angles]
        if self.forces.on_floor:
            self._gimbal.roughen(self.settings.rolling_friction_m)
        self._gimbal.reset(*places)
        self._target = self._ctrl = np.zeros(2)
        self._queue: deque[tuple[float, Array]] = deque()
        self._played = np.zeros(2)
        played = [self.settings.backlash_axis in ("both", axis) for axis in AXES]
        self._half_play = 0.5 * math.radians(self.settings.backlash_deg) * np.array(played)
        self._heavy = self._gimbal.ball_rotation().T @ heavy_side(self.settings, angles[0])
        self._mixed = np.array([[1.0, self.settings.servo_coupling[0]], [self.settings.servo_coupling[1], 1.0]])
        self._gain = np.array(self.settings.servo_gain)
        self.faults = FaultBox(self.settings.faults, self._gimbal, self.maze)

    def close(self) -> None:
        """Release memory. A second call does nothing."""
        self._gimbal = None
        vars(self).pop("faults", None)  # FaultBox also refers to the model

    @property
    def gimbal(self) -> Gimbal:
        """The model. Raises RigError before reset() and after close()."""
        if self._gimbal is None:
            raise RigError("the simulated rig was used before reset() or after close()")
        return self._gimbal

    @property
    def time(self) -> float:
        """Time since reset, s."""
        return float(self.gimbal.data.time)

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
        gimbal.drive(self.faults.servo(now, led))
        self.faults.before_step(now)
        if self.forces.any:
            self._advance_forced(now)
        else:
            gimbal.advance()
        self.faults.after_step(self.time)

    def _advance_forced(self, now: float) -> None:
        """Simulate one chunk with the effects of `forces`."""
        gimbal, forces = self.gimbal, self.forces
        plate, _ = gimbal.plate()
        before = Motion(*self.ball())
        if forces.on_floor:
            extra = forces.friction(before, plate.T @ gimbal.model.opt.gravity)
            gimbal.roughen(self.settings.rolling_friction_m + extra)
        if forces.on_ball:
            force, torque = forces.of_ball(now + 0.5 * self.chunk_s, before, plate, self._heavy_side())
            gimbal.push(force + plate @ forces.of_plate(before.place) if forces.on_plate else force, torque)
        elif forces.on_plate:
            gimbal.push(plate @ forces.of_plate(before.place))
        gimbal.advance()
        after = Motion(*self.ball())
        if forces.has_kerb and forces.passes_kerb(before, after):
            left = 1.0 - self.settings.kerb_loss
            self.set_ball(after.place, left * after.velocity, left * after.spin)

    def _heavy_side(self) -> Array:
        """Unit vector (3,) to the heavy side of the ball in the middle of the next chunk, in the frame of the room."""
        side = self.gimbal.ball_rotation() @ self._heavy
        side = side + 0.5 * self.chunk_s * _cross(self.gimbal.spin(), side)
        return side / math.sqrt(float(side @ side))

    def command(self, u_beta: float, u_gamma: float) -> None:
        """Make the servos move to this tilt, rad, and hold it, after the command delay."""
        now, wanted = self.time, np.array([u_beta, u_gamma], dtype=float)
        if self.settings.servo_coupling != (0.0, 0.0):
            wanted = self._mixed @ wanted
        last = self._queue[-1][1] if self._queue else self._target
        band = math.radians(self.settings.deadband_deg)
        wanted = np.where(np.abs(wanted - last) < band, last, wanted) if band > 0.0 else wanted
        self._queue.append((now + 1e-3 * self.settings.command_delay_ms, wanted))

    def aim(self, beta: float, gamma: float) -> None:
        """Set the target of the servos now, rad, without the limits of commands."""
        self._target = np.array([beta, gamma])

    def level(self) -> None:
        """Level the plate now, and drop delayed commands."""
        if self._gimbal is not None:
            self._queue.clear()
            self._target = np.zeros(2)

    def inject(self, fault: Fault) -> None:
        """Add a fault. It begins at its `at_s`, or at once if that time is over. Raises SettingsError as `Machine`."""
        check_fault(fault, "fault", self.maze)
        self.faults.append(fault)

    def scenes(self) -> list[Array]:
        """x, y, z of each ball in the plate frame, m, then beta, gamma, rad; (5,) each. A ball that is taken out has
        NaN for x, y."""
        gimbal = self.gimbal
        plate, _ = gimbal.plate()
        scenes = []
        for index in range(self.maze.balls):
            scene = np.empty(5)
            scene[:3] = plate.T @ gimbal.place(index)
            if self.faults.acts("removed", self.time, index):
                scene[:2] = math.nan
            scene[3:] = gimbal.tilt
            scenes.append(scene)
        return scenes

    def truth(self) -> Array:
        """x, y, z (m), x_dot, y_dot (m/s) of the ball in the plate frame, beta, gamma (rad): shape (7,)."""
        position, velocity, _ = self.ball()
        return np.array([*position, velocity[0], velocity[1], *self.gimbal.tilt])

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


def check_fault(fault: Fault, key: str, maze: Maze) -> None:
    """Raises SettingsError for an opening, ring or ball that the maze does not have. key: of the fault in the file."""
    names = [opening.name for opening in maze.openings]
    if fault.kind == "blocked" and fault.opening not in names:
        raise SettingsError(f"got {fault.opening!r}, expected {one_of(names, fault.opening)}", key=f"{key}.opening")
    if fault.kind == "teleport" and fault.ring > len(maze.rings):
        raise SettingsError(f"got {fault.ring}, expected 1 to {len(maze.rings)}", key=f"{key}.ring")
    if fault.ball > maze.balls:
        raise SettingsError(f"got {fault.ball}, expected at most {maze.balls} on this map", key=f"{key}.ball")


class FaultBox:
    """Applies the faults of one run to a MuJoCo model. `check_fault` must have accepted the faults."""

    def __init__(self, faults: Sequence[Fault], gimbal: Gimbal, maze: Maze) -> None:
        self._faults = list(faults)
        self._gimbal = gimbal
        self._maze = maze
        self._done: set[int] = set()
        self._held = dict[int, Array]()  # {index of a held ball: its place (3,) in the plate's frame}
        self._taken_from = dict[int, Array]()
        self._reached = np.zeros(2)  # set points of the servos after their faults
        self._at = 0.0

    def append(self, fault: Fault) -> None:
        """Add a fault, also while running."""
        self._faults.append(fault)

    def active(self, kind: str, t: float) -> list[Fault]:
        """Faults of a kind that act at time t."""
        return [f for f in self._faults if f.kind == kind and f.at_s <= t < f.at_s + f.duration_s]

    def acts(self, kind: str, t: float, index: int) -> bool:
        """Whether a fault of a kind acts on a ball at time t; the first ball has index 0."""
        return any(fault.ball == index + 1 for fault in self.active(kind, t))

    def servo(self, t: float, wanted: Array) -> Array:
        """Set points that reach the servos, (2,), rad. A dead axis keeps its last set point, at first its middle."""
        out, dt, last = np.array(wanted, dtype=float), t - self._at, self._reached
        for fault in self.active("slow_axis", t):
            most = math.radians(fault.slew_deg_s) * dt
            axes = _axes(fault)
            out[axes] = np.clip(out[axes], last[axes] - most, last[axes] + most)
        for kind, held in (("dead_axis", last), ("brown_out", np.zeros(2))):
            for fault in self.active(kind, t):
                out[_axes(fault)] = held[_axes(fault)]
        self._reached = out.copy()
        self._at = t
        for fault in self.active("offset_axis", t):
            out[_axes(fault)] += math.radians(fault.offset_deg)
        return out

    def before_step(self, t: float) -> None:
        """Apply the faults that act before a step: plugs, kicks, and moves of a ball to another place."""
        blocked = {fault.opening for fault in self.active("blocked", t)}
        for fault in self._faults:
            if fault.kind == "blocked" and fault.opening is not None:
                self._gimbal.plug(fault.opening, fault.opening in blocked)
        for i, fault in enumerate(self._faults):
            if fault.kind in ("push", "teleport") and i not in self._done and t >= fault.at_s:
                self._done.add(i)
                angle = math.radians(fault.direction_deg)
                if fault.kind == "push":
                    x, y = fault.speed_m_s * math.cos(angle), fault.speed_m_s * math.sin(angle)
                    self._gimbal.kick(x, y, fault.ball - 1)
                else:
                    radius = self._maze.track_radius(fault.ring)
                    place = np.array([radius * math.cos(angle), radius * math.sin(angle), self._maze.ball.radius])
                    self._put(place, fault.ball - 1)

    def _put(self, position: Array, index: int) -> None:
        """Put a ball to rest at a position (3,), m, in the plate's frame."""
        self._gimbal.rest(self._gimbal.drawn() @ position, index)

    def after_step(self, t: float) -> None:
        """Make glued and removed balls move with the plate: restore their places in its frame after each step."""
        for index in range(self._maze.balls):
            glued, out = self.acts("stuck", t, index), self.acts("removed", t, index)
            if not out and index in self._taken_from:
                self._put(self._taken_from.pop(index), index)
            if not (glued or out):
                self._held.pop(index, None)
                continue
            here = self._gimbal.drawn().T @ self._gimbal.place(index)
            held = self._held.get(index, here)
            if out:
                self._taken_from.setdefault(index, here)
                held = np.array([self._maze.walls[0].outer_radius + ASIDE * (1 + index), 0.0, ASIDE])
            self._held[index] = held
            self._put(held, index)


def _axes(fault: Fault) -> list[int]:
    return {"beta": [0], "gamma": [1], "both": [0, 1]}[fault.axis]


def _from_map(maze: Maze, settings: SimulatedSettings) -> Gimbal:
    walls = near_walls(maze, settings)  # pyright: ignore[reportArgumentType] frozen, so pydantic gives them a hash
    return MazeGimbal(walls, SUBSTEPS // CHUNKS, maze.balls)


def _cross(a: Array, b: Array) -> Array:
    """Cross product (3,) of two vectors (3,). For one pair, np.cross takes many times as long."""
    (a0, a1, a2), (b0, b1, b2) = a.tolist(), b.tolist()
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])
