"""Many simulated rigs at once. The physics of each equals that of a single SimulatedRig, to the last bit.

1. The set points of the servos in each chunk (command delay, slew limit, play), for all rigs at once. They do not
   depend on the physics.
2. The physics: MuJoCo simulates all rigs in its own threads.
3. Pictures, delays and noise, for all rigs at once.

Each rig has its own generator of random numbers, and draws in the same order as a single rig.
"""

from __future__ import annotations

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module has no types)
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError

from mazeplan.core.errors import RigError, SettingsError
from mazeplan.core.records import Array, IntArray
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.sim.forces import BallForces, FloorFriction, Kerb, PlateForces
from mazeplan.rigs.sim.machine import AXES, CHUNKS
from mazeplan.rigs.sim.mjcf import SUBSTEPS
from mazeplan.rigs.sim.nearwalls import MOST_OF_FLEET, near_walls
from mazeplan.rigs.sim.settings import SimulatedSettings
from mazeplan.rigs.sim.simulated import TOLERANCE
from mazeplan.rigs.sim.surprise import surprised

# settings that must have their defaults in a fleet
PLAIN = [(name, SimulatedSettings.model_fields[name].default) for name in (
    "camera_scale", "lens_per_m2", "tilt_scale", "servo_gain", "servo_coupling",
)]  # fmt: skip


@dataclass(frozen=True)
class Samples:
    """Samples of N rigs; each field has shape (N,).

    t: s.
    x, y: m; NaN for a ball that is not seen.
    beta, gamma: rad."""

    t: Array
    x: Array
    y: Array
    beta: Array
    gamma: Array


def fits(settings: SimulatedSettings, maze: Maze) -> bool:
    """Whether a fleet supports the settings.

    A fleet supports no faults, no additional forces or friction (`forces`), no rendered pictures, and only the defaults
    of the settings in `PLAIN`."""
    drawn = surprised(settings, maze)
    own = any(kind(drawn, maze) for kind in (PlateForces, BallForces, FloorFriction, Kerb))
    return not drawn.faults and drawn.sense == "ideal" and not own and all(getattr(drawn, k) == v for k, v in PLAIN)


class Fleet:
    """N rigs. Raises SettingsError if `fits` is false.

    number: N.
    threads: by default one for each processor core."""

    def __init__(self, maze: Maze, settings: SimulatedSettings, number: int, threads: int | None = None) -> None:
        if not fits(settings, maze):
            raise SettingsError("got faults, forces or rendered pictures, expected a rig without them")
        self.maze, self.settings = maze, surprised(settings, maze)
        self.number, self.rate_hz = number, self.settings.rate_hz
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        self.threads = min(threads or cores, number)
        self._rngs: list[np.random.Generator | None] = [None] * number
        self._walls = near_walls(self.maze, self.settings)
        self._walls.most = MOST_OF_FLEET  # many balls visit all cells, again and again
        self._batch: Any = Batch(self._walls.any, self.number, self.threads)
        self._ctrl, self._qpos, self._qvel = (self._batch.bind(name) for name in ("ctrl", "qpos", "qvel"))
        self._near = [self._walls.any] * self.number  # current model of each rig
        self._prepare()

    def _prepare(self) -> None:
        settings, n = self.settings, self.number
        chunk_s = 1.0 / (self.rate_hz * CHUNKS)
        self._slew = math.radians(settings.servo_slew_deg_s) * chunk_s
        self._band = math.radians(settings.deadband_deg)
        axes = [settings.backlash_axis in ("both", axis) for axis in AXES]
        self._half_play = 0.5 * math.radians(settings.backlash_deg) * np.array(axes, dtype=float)
        after = math.ceil((1e-3 * settings.command_delay_ms - 1e-9) / chunk_s)  # chunks
        self._ages = [
            max(0, math.ceil((after - c) / CHUNKS)) for c in range(CHUNKS)
        ]  # age in samples of the command that acts in each chunk
        self._said = np.zeros((self._ages[0] + 1, n, 2))  # commands, the newest first
        self._set, self._played = np.zeros((n, 2)), np.zeros((n, 2))
        self._points = np.zeros((n, CHUNKS, 2))
        self._went = np.zeros((n, CHUNKS, 9))  # MuJoCo's positions at the end of each chunk
        late = 1e-3 * settings.camera_late_ms * self.rate_hz * CHUNKS
        self._part = late - math.floor(late)  # fraction of a chunk
        self._path = np.zeros((math.floor(late) + 2, n, 5))  # scenes, the newest last
        self._seen = np.zeros((settings.camera_delay_frames + 1, n, 5))  # the oldest first
        self._lost, self._samples = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)

    def close(self) -> None:
        """Release threads and memory. A second call does nothing."""
        self._batch = None

    # -- life -------------------------------------------------------------------------------------------------------

    def reset(
        self, rows: IntArray, rings: Sequence[int], thetas: Sequence[float], rngs: Sequence[np.random.Generator]
    ) -> Samples:
        """Reset the rigs `rows`, and return their first samples.

        The balls are at rest in the middle of their rings, the plates are level, and the time is 0."""
        numbers = rows.astype(np.int32)
        self._batch.reset(numbers, stage=int(mujoco.mjtStage.mjSTAGE_NONE))
        for row, ring, theta, rng in zip(rows.tolist(), rings, thetas, rngs, strict=True):
            radius, theta = self.maze.track_radius(ring), self.maze.clear_angle(ring, theta)
            self._qpos[row, 2:6] = radius * math.cos(theta), radius * math.sin(theta), self.maze.ball.radius, 1.0
            self._rngs[row] = rng
        self._show_walls(rows)
        self._batch.forward(numbers)
        for memory in (self._said, self._path, self._seen):
            memory[:, rows] = 0.0
        for memory in (self._set, self._played, self._lost, self._samples):
            memory[rows] = 0
        scene = _scene(self._qpos[rows])
        self._path[:, rows] = self._seen[:, rows] = scene
        return self._observe(rows)

    def step(self, rows: IntArray, commands: Array) -> Samples:
        """Command tilts (len(rows), 2), rad, to the rigs `rows`, and return their next samples.

        Raises RigError for NaN and for a tilt beyond the limit."""
        limit = self.maze.tilt_limit
        if not np.all(np.abs(commands) <= limit + TOLERANCE):  # also refuses NaN
            raise RigError(f"command: got {commands.tolist()} rad, expected at most {limit:.4f} rad either way")
        self._plan_servos(rows, commands)
        self._advance(rows)
        self._samples[rows] += 1
        self._look(rows)
        return self._observe(rows)

    def _plan_servos(self, rows: IntArray, commands: Array) -> None:
        """Set points of the servos in each chunk of the next sample."""
        last = self._said[0, rows]
        wanted = np.where(np.abs(commands - last) < self._band, last, commands) if self._band > 0.0 else commands
        self._said[1:, rows] = self._said[:-1, rows]
        self._said[0, rows] = wanted
        now, played = self._set[rows], self._played[rows]
        for chunk, age in enumerate(self._ages):
            now = now + np.minimum(np.maximum(self._said[age, rows] - now, -self._slew), self._slew)
            played = np.minimum(np.maximum(played, now - self._half_play), now + self._half_play)
            self._points[rows, chunk] = played
        self._set[rows], self._played[rows] = now, played

    def _advance(self, rows: IntArray) -> None:
        """Simulate the physics of the rigs `rows` until the next sample."""
        steps = SUBSTEPS // CHUNKS
        for chunk in range(CHUNKS):
            self._ctrl[rows] = self._points[rows, chunk]
            slow = self._walls.slow(self._qvel[rows, 2:4], steps)
            self._simulate(rows[slow], steps)
            for _ in range(steps if not np.all(slow) else 0):
                self._simulate(rows[~slow], 1)
            self._went[rows, chunk] = self._qpos[rows]

    def _simulate(self, rows: IntArray, steps: int) -> None:
        """Make `steps` of MuJoCo's steps for the rigs `rows`. Raises RigError if the simulation fails."""
        self._show_walls(rows)
        try:
            self._batch.step(rows.astype(np.int32), steps)
        except SimulationError as problem:
            raise RigError(f"the simulation broke down: {' '.join(str(problem).split())}") from None

    def _show_walls(self, rows: IntArray) -> None:
        """Give each of the rigs `rows` the model with the walls near its ball."""
        for row, model in zip(rows.tolist(), self._walls.at_all(self._qpos[rows, 2:4]), strict=True):
            self._near[row] = model
        self._batch.set_models(self._near)

    # -- camera -----------------------------------------------------------------------------------------------------

    def _look(self, rows: IntArray) -> None:
        """Store the new scenes, and delay the pictures."""
        kept = len(self._path)
        new = min(kept, CHUNKS)
        scenes = _scene(self._went[rows, CHUNKS - new :]).swapaxes(0, 1)
        self._path[:, rows] = np.concatenate([self._path[:, rows], scenes])[-kept:]
        self._seen[:-1, rows] = self._seen[1:, rows]
        self._seen[-1, rows] = (1.0 - self._part) * self._path[1, rows] + self._part * self._path[0, rows]

    def _observe(self, rows: IntArray) -> Samples:
        """As `SimulatedRig.observe`, for the rigs `rows`."""
        settings, n = self.settings, len(rows)
        normal, even = np.empty((n, 6)), np.empty((n, 2))
        for k, row in enumerate(rows.tolist()):
            rng = self._rngs[row]
            if rng is None:
                raise RigError("a rig of the fleet was used before reset()")
            normal[k, :4] = rng.standard_normal(4)
            even[k] = rng.random(2)
            normal[k, 4:] = rng.standard_normal(2)
        lost = self._lost[rows]
        newly = (lost == 0) & (even[:, 0] < settings.ball_lost_probability)
        lost = np.where(newly, settings.ball_lost_frames, np.maximum(lost - 1, 0))
        self._lost[rows] = lost
        turn = math.radians(settings.camera_rotation_deg)
        there = self._seen[0, rows, :2]
        c, s = math.cos(turn), math.sin(turn)
        position = np.column_stack([c * there[:, 0] - s * there[:, 1], s * there[:, 0] + c * there[:, 1]])
        position = position + 1e-3 * (np.array(settings.camera_offset_mm) + settings.camera_noise_mm * normal[:, :2])
        wrong = even[:, 1] < settings.outlier_probability
        position = np.where(wrong[:, None], position + 1e-3 * settings.outlier_mm * normal[:, 2:4], position)
        position = np.where((lost > 0)[:, None], math.nan, position)
        tilt = self._qpos[rows, :2] + math.radians(settings.tilt_noise_deg) * normal[:, 4:]
        t = self._samples[rows] / self.rate_hz
        return Samples(t, position[:, 0], position[:, 1], tilt[:, 0], tilt[:, 1])

    # -- true state, which only a simulation has -------------------------------------------------------------------

    def rest(self, rows: IntArray) -> None:
        """Does nothing: simulated rigs stand still between two steps."""

    def pictured(self, row: int) -> Array:
        """See `SimulatedRig.pictured`."""
        return self._seen[0, row].copy()

    def state(self, row: int) -> tuple[Array, Array]:
        """MuJoCo's positions (9,) and velocities (8,) of a rig: first the hinges, then the ball."""
        return self._qpos[row].copy(), self._qvel[row].copy()


def _scene(qpos: Array) -> Array:
    """`Machine.scene` from MuJoCo's positions (..., 9): x, y, z of the ball in the plate frame, m, then beta, gamma,
    rad; (..., 5)."""
    b, g, x, y, z = (qpos[..., k] for k in range(5))
    cb, sb, cg, sg = np.cos(b), np.sin(b), np.cos(g), np.sin(g)
    along = sb * x + cb * z
    return np.stack([cb * x - sb * z, cg * y + sg * along, cg * along - sg * y, b, g], axis=-1)
