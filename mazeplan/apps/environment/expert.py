"""The planner as a policy: the behaviour tree of `navigate`, fed with what the environment's rig measures."""

from __future__ import annotations

from typing import cast

import gymnasium
import numpy as np

from mazeplan.apps.environment.single import CircularMazeEnv
from mazeplan.core.display import NullDisplay
from mazeplan.core.errors import InputError
from mazeplan.core.records import LEVEL, Command
from mazeplan.rigs.interface import Rig
from mazeplan.rigs.registry import rig_label
from mazeplan.run.loop import Run
from mazeplan.run.resolve import resolve_model
from mazeplan.run.specification import Job, Setup


class _Ears:
    """In the place of a rig: keeps what it is told. The environment steps the real one."""

    def __init__(self, rate_hz: float) -> None:
        self.rate_hz, self.told = rate_hz, LEVEL

    def command(self, u_beta: float, u_gamma: float) -> None:
        """Keep it."""
        self.told = Command(u_beta, u_gamma)


class Expert:
    """Plays episodes of one environment: `begin` after its reset, then `act` before each of its steps. model, behavior:
    as `navigate` takes them. Raises InputError for another environment, and what `navigate` raises for a model or a
    tree that cannot be used."""

    def __init__(self, env: gymnasium.Env, model: str | None = None, behavior: str = "navigate") -> None:
        inner = env.unwrapped  # what `gymnasium.make` gives has wrappers around it
        if not isinstance(inner, CircularMazeEnv):
            raise InputError(f"the expert plays mazeplan/CircularMaze-v1, got {type(inner).__name__}")
        task, maze = inner.episodes.task, inner.episodes.maze
        self._env, self._goal = inner, task.goal(maze)
        chosen = resolve_model(model, task.rig, maze)
        self._setup = Setup(maze, chosen, behavior, rig_label(task.rig), model or "")

    def begin(self) -> None:
        """A new episode."""
        self._ears = _Ears(self._env.episodes.rate_hz)
        start = self._env.episodes.maze.rings[0].number  # told in logs only, of which there is none here
        rig = cast(Rig, self._ears)
        self._run = Run(rig, self._setup, Job(start, self._goal), None, NullDisplay())

    def act(self) -> np.ndarray:
        """The action that answers what the rig measured last, (2,) float32. Where the tree has given up or believes the
        ball to be there before the environment does, it begins anew. Raises RigError where the rig's measurements
        cannot be used."""
        self._run.tick(self._env.measured())
        told, limit = self._ears.told, self._env.episodes.maze.tilt_limit
        return np.clip(np.array([told.u_beta, told.u_gamma]) / limit, -1.0, 1.0).astype(np.float32)
