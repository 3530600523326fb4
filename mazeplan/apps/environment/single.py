"""The environment: a rig under a watchdog, and the ball on it."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from mazeplan.apps.environment.task import HIGH, LOW, Judge, Senses, Start, Task, potential
from mazeplan.core.errors import RigError, SettingsError
from mazeplan.core.records import Observation
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.files import validated
from mazeplan.rigs.interface import traits
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.watchdog import WatchedRig, watched


class CircularMazeEnv(gymnasium.Env):
    """The agent tilts the plate to bring a ball from one ring to another. options: those of `task.Task`.

    measured: the last sample of the rig, in SI units

    Raises SettingsError or MapError for an option that cannot be used, RigError when the rig fails."""

    metadata = {"render_modes": [], "render_fps": 30}  # noqa: RUF012  Gymnasium has it so
    measured: Observation

    def __init__(self, **options: Any) -> None:
        self.task = validated(Task, options)
        self.maze = load_map(self.task.map)
        if self.maze.balls > 1:
            raise SettingsError(f"got a map with {self.maze.balls} balls, expected 1", key="map")
        self._phi = potential(self.task, self.maze)
        self.rig = watched(make_rig(self.task.rig, self.maze))
        traits(self.rig).ready()  # the loop is another program's code
        self._closed = False
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space = spaces.Box(LOW, HIGH, dtype=np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Place the ball and level the plate. options: `start_ring`, `start_angle_deg` of this episode."""
        super().reset(seed=seed)
        usual = {"start_ring": self.task.start_ring, "start_angle_deg": self.task.start_angle_deg}
        start = validated(Start, {**usual, **(options or {})})
        rings, degrees = start.rings(self.maze, self.task.goal(self.maze)), start.start_angle_deg
        # always draw both, so that a given value does not change the later random numbers
        ring, angle = rings[int(self.np_random.integers(len(rings)))], self.np_random.uniform(-math.pi, math.pi)
        theta = self.maze.clear_angle(ring, float(angle) if degrees is None else math.radians(degrees))
        self.rig.reset(ring=ring, theta=theta, rng=self.np_random)
        self.measured = self.rig.observe()
        self._rest()  # nobody knows when the first step comes
        self._senses = Senses(self.maze, self.rig.rate_hz, self.measured, ring, theta)
        self._judge = Judge(self.task, self._senses, self._phi)
        return self._senses.state(), self._info()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Command the tilt `action` x the tilt limit, (u_beta, u_gamma), for one sample.

        Raises ValueError for an action of another shape, or that is not finite."""
        command = self._command(action)
        self.rig.command(*command.tolist())
        self.measured = self.rig.observe()
        self._senses.take(self.measured, command)
        verdict = self._judge.judge()
        ended = verdict.arrived or verdict.out
        if ended:
            self._rest()
        return self._senses.state(), verdict.reward, ended, False, self._info(verdict.arrived, verdict.left)

    def _command(self, action: Any) -> np.ndarray:
        try:
            given = np.asarray(action, dtype=float)
        except (TypeError, ValueError):
            given = np.array(math.nan)
        if given.shape != (2,) or not np.all(np.isfinite(given)):
            what = action.tolist() if isinstance(action, np.ndarray) else action
            raise ValueError(f"action: got {what!r}, expected two numbers from -1 to 1")
        return np.clip(given, -1.0, 1.0) * self.maze.tilt_limit

    def _info(self, arrived: bool = False, left: bool = False) -> dict[str, Any]:
        """The info of Gymnasium. `is_success` is the same as `success`; some libraries expect this name."""
        senses = self._senses
        known = {"ring": senses.ring, "time_s": senses.t, "seen": senses.unseen_s <= 0.0}
        return {**known, "success": arrived, "is_success": arrived, "ball_out": left}

    def _rest(self) -> None:
        """Answer the last sample with a level plate. A simulation waits for nobody, and keeps its tilt."""
        if isinstance(self.rig, WatchedRig):
            self.rig.level()

    def close(self) -> None:
        """Level the plate and release the rig. May be called twice."""
        if self._closed:
            return
        self._closed = True
        with suppress(RigError):  # a rig that fails now has raised its error before
            self.rig.level()
        with suppress(RigError):  # also a rig that cannot level gives its port back
            self.rig.close()
