"""The planner as a policy: the behaviour tree of `navigate` gets the measurements of the environment's rig."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import gymnasium
import numpy as np

from mazeplan.apps.environment.single import CircularMazeEnv
from mazeplan.core.errors import InputError
from mazeplan.core.progress import Display
from mazeplan.rigs.interface import Rig
from mazeplan.rigs.registry import rig_label
from mazeplan.run.loop import Run
from mazeplan.run.resolve import resolve_model
from mazeplan.run.specification import Job, Setup


class Expert:
    """Plays episodes of one environment. Call `begin` after each reset, then `act` before each step.

    model, behavior: as `navigate` takes them.

    Raises InputError for another environment. For a model or a tree that cannot be used, raises the errors of
    `navigate`."""

    def __init__(self, env: gymnasium.Env, model: str | None = None, behavior: str = "navigate") -> None:
        inner = env.unwrapped  # `gymnasium.make` puts wrappers around an environment
        if not isinstance(inner, CircularMazeEnv):
            raise InputError(f"the expert plays mazeplan/CircularMaze-v1, got {type(inner).__name__}")
        task, maze = inner.task, inner.maze
        self._env, self._goal = inner, task.goal(maze)
        chosen = resolve_model(model, task.rig, maze)
        self._setup = Setup(maze, chosen, behavior, rig_label(task.rig), model or "")

    def begin(self) -> None:
        """Begin a new episode. The environment commands its rig; the run of the tree has a stand-in for one."""
        unmoved = SimpleNamespace(rate_hz=self._env.rig.rate_hz, command=lambda u_beta, u_gamma: None)
        start = self._env.maze.rings[0].number  # only logs use it, and here there is no log
        self._run = Run(cast(Rig, unmoved), self._setup, Job(start, self._goal), None, Display())

    def act(self) -> np.ndarray:
        """The action that answers the last sample of the rig, (2,), float32.

        The tree begins anew if it has given up, or if it sees an arrival before the environment does. Raises RigError
        for measurements that cannot be used."""
        self._run.tick(self._env.measured)
        command, limit = self._run.chain.sent, self._env.maze.tilt_limit
        return np.clip(np.array([command.u_beta, command.u_gamma]) / limit, -1.0, 1.0).astype(np.float32)
