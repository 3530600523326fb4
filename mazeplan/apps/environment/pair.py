"""The environment with two balls on one plate. The task is to bring both balls to the centre.

The observation has a row for each ball, in the rig's order. Both rows have the same tilts and commands. With phi_k of
ball k as in `judging`, the reward is

    sparse    1 when both have arrived, else 0
    dense     sparse + discount x phi(next) - phi(now),    phi = (phi_1 + phi_2) / 2, 0 at the end

An episode ends when both balls were measured in the centre for 0.2 s, or when one ball is out.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from mazeplan.apps.environment.episodes import commands_of, places
from mazeplan.apps.environment.judging import Judge
from mazeplan.apps.environment.senses import HIGH, LOW, Senses
from mazeplan.apps.environment.task import Task
from mazeplan.apps.environment.worlds import RigRow, rigs
from mazeplan.core.errors import RigError, SettingsError
from mazeplan.core.gymnasium_names import TWO_BALLS
from mazeplan.core.name_hints import one_of
from mazeplan.core.records import IntArray
from mazeplan.maze.mapfile import crowded, load_map
from mazeplan.rigs.interface import traits
from mazeplan.rigs.sim.fleet import Samples

BALLS = 2
OPTIONS = ("map", "rig", "reward", "start_ring", "start_angle_deg", "discount")  # supported options of `Task`
_RIG, _EACH = np.array([0]), np.arange(BALLS)


class TwoBallsEnv(gymnasium.Env):
    """The agent tilts the plate to bring two balls to the centre. options: OPTIONS, see `task.Task`.

    Raises SettingsError or MapError for an option that cannot be used, RigError when the rig fails."""

    metadata = {"render_modes": ["ansi"], "render_fps": 30}  # noqa: RUF012  Gymnasium has it so

    def __init__(self, *, render_mode: str | None = None, **options: Any) -> None:
        for name in options:
            if name not in OPTIONS:
                raise SettingsError(f"unknown option, expected {one_of([*OPTIONS, 'render_mode'], name)}", key=name)
        if render_mode not in (None, "ansi"):
            raise SettingsError(f"got {render_mode!r}, expected ansi", key="render_mode")
        self.render_mode, self.task = render_mode, Task.of(options)
        self.maze = replace(load_map(self.task.map), balls=BALLS)
        problem = crowded(BALLS, 1e3 * self.maze.ball.radius, 1e3 * self.maze.rings[-1].outer_radius)
        if problem is not None:
            raise SettingsError(f"got {self.maze.name}, expected a map for {BALLS} balls: {problem}", key="map")
        made = rigs(self.task.rig, self.maze, 1)
        if traits(made[0]).balls < BALLS:
            raise SettingsError(f"got a rig with one ball, expected {BALLS} for {TWO_BALLS}", key="rig")
        self._world = RigRow(partial(rigs, self.task.rig, self.maze, 1), made)
        self._senses = Senses(self.maze, self._world.rate_hz, BALLS)
        self._judge = Judge(replace(self.task, reward="sparse"), self._senses, BALLS)
        self._phi = 0.0
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space = spaces.Box(np.tile(LOW, (BALLS, 1)), np.tile(HIGH, (BALLS, 1)), dtype=np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Place the balls on opposite sides of the ring, and level the plate.

        options: `start_ring`, and `start_angle_deg` of the first ball, for this episode."""
        super().reset(seed=seed)
        (ring,), (theta,) = places(self.task, self.maze, [self.np_random], options)
        samples = _both(self._world.reset(_RIG, [ring], [theta], [self.np_random]))
        thetas = [self.maze.clear_angle(ring, theta + np.pi * k) for k in range(BALLS)]
        self._senses.reset(_EACH, samples, [ring] * BALLS, thetas)
        self._judge.reset(_EACH)
        self._phi = self._potential()
        nothing = np.zeros(BALLS, dtype=bool)
        return self._senses.state(_EACH), self._info(self._senses.ring(self._senses.place(_EACH)[0]), False, nothing)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Command the tilt `action` x the tilt limit, (u_beta, u_gamma), for one sample."""
        commands = commands_of(np.asarray(action)[None], 1, self.maze.tilt_limit)
        self._senses.take(_EACH, _both(self._world.step(_RIG, commands)), np.tile(commands, (BALLS, 1)))
        verdict = self._judge.judge(_EACH)
        arrived, out = bool(verdict.arrived.all()), bool(verdict.out.any())
        if arrived or out:
            self._world.rest(_RIG)
        reward = float(arrived)
        if self.task.reward == "dense":
            phi = 0.0 if arrived or out else self._potential()
            reward += self.task.discount * phi - self._phi
            self._phi = phi
        return self._senses.state(_EACH), reward, arrived or out, False, self._info(verdict.ring, arrived, verdict.left)

    def render(self) -> str | None:
        """For ansi, a line of text."""
        if self.render_mode is None:
            return None
        radius, theta = self._senses.place(_EACH)
        balls = "  ".join(
            f"ball {k + 1}: {1e3 * r:5.1f} mm at {np.degrees(a) % 360.0:5.1f} deg"
            for k, (r, a) in enumerate(zip(radius, theta, strict=True))
        )
        return f"t {self._senses.t[0]:6.2f} s  {balls}\n"

    def close(self) -> None:
        """Level the plate and release the rig."""
        self._world.close()

    def _potential(self) -> float:
        return float(self._judge.potential(_EACH).mean())

    def _info(self, ring: IntArray, arrived: bool, left: np.ndarray) -> dict[str, Any]:
        """The info as in `CircularMazeEnv`, but rings and seen have a value for each ball."""
        return {
            "rings": tuple(ring.tolist()), "time_s": float(self._senses.t[0]),
            "seen": tuple((self._senses.unseen_s(_EACH) <= 0.0).tolist()), "success": arrived, "is_success": arrived,
            "ball_out": bool(left.any()),
        }  # fmt: skip


def _both(samples: Samples) -> Samples:
    """The samples. Raises RigError unless the rig measured both balls."""
    if len(samples.t) != BALLS:
        raise RigError(f"observe() of the rig: got {len(samples.t)} balls, expected {BALLS}")
    return samples
