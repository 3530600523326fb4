"""The environment with many rigs. With the same seeds, it gives the same episodes as environments with one rig."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from mazeplan.apps.environment.episodes import Episodes
from mazeplan.apps.environment.single import CircularMazeEnv
from mazeplan.apps.environment.task import STEPS, Task
from mazeplan.core.errors import SettingsError


class CircularMazeVectorEnv(VectorEnv):
    """N rigs, each with its own episodes. The step after the end of an episode resets its rig, and ignores its action.

    num_envs: N.
    max_episode_steps: an episode is truncated after so many steps.
    threads: threads of the physics; None: one for each processor core.
    options: those of `task.Task`.

    Raises the same errors as `CircularMazeEnv`."""

    metadata = {**CircularMazeEnv.metadata, "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012  Gymnasium has it so

    def __init__(
        self,
        num_envs: int = 1,
        *,
        max_episode_steps: int = STEPS,
        threads: int | None = None,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        for key, value in (("num_envs", num_envs), ("threads", threads)):
            if value is not None and not (isinstance(value, int) and value >= 1):
                raise SettingsError(f"got {value!r}, expected a whole number >= 1", key=key)
        if render_mode not in (None, "rgb_array"):
            raise SettingsError(f"got {render_mode!r}, expected rgb_array", key="render_mode")
        self.num_envs, self.render_mode, self._most = num_envs, render_mode, max_episode_steps
        self.episodes = Episodes(Task.of(options), num_envs, threads)
        self.single_action_space = self.episodes.action_space
        self.single_observation_space = self.episodes.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._rngs: list[np.random.Generator] = []
        self._ended = np.zeros(num_envs, dtype=bool)
        self._steps = np.zeros(num_envs, dtype=np.int64)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin N episodes, with the seeds seed, seed + 1, ..., or with the seeds of a list."""
        seeds = (
            [None if seed is None else seed + i for i in range(self.num_envs)] if not isinstance(seed, list) else seed
        )
        if len(seeds) != self.num_envs:
            raise SettingsError(f"got {len(seeds)}, expected one for each of {self.num_envs}", key="seed")
        first = not self._rngs
        made = [seeding.np_random(s) if first or s is not None else None for s in seeds]
        self._rngs = [pair[0] if pair is not None else self._rngs[i] for i, pair in enumerate(made)]
        self._ended[:], self._steps[:] = False, 0
        observed, info = self.episodes.reset(np.arange(self.num_envs), self._rngs, options)
        return observed, _masked(info)

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Command all rigs, and return their next samples. A rig whose episode has ended begins its next episode."""
        if not self._rngs:
            raise RuntimeError("reset() comes first")
        n, anew, on = self.num_envs, np.flatnonzero(self._ended), np.flatnonzero(~self._ended)
        reward, terminated, parts = np.zeros(n), np.zeros(n, dtype=bool), []
        if len(anew):
            parts.append((anew, *self.episodes.reset(anew, [self._rngs[row] for row in anew.tolist()])))
            self._steps[anew] = 0
        if len(on):
            observed, verdict, info = self.episodes.step(on, np.asarray(actions)[on])
            parts.append((on, observed, info))
            reward[on], terminated[on] = verdict.reward, verdict.arrived | verdict.out
            self._steps[on] += 1
        truncated = self._steps >= self._most
        self.episodes.world.rest(np.flatnonzero(truncated & ~terminated))
        self._ended = terminated | truncated
        observations, info = _joined(parts, n)
        return observations, reward, terminated, truncated, _masked(info)

    def render(self) -> tuple[np.ndarray, ...] | None:
        """For rgb_array, the pictures of all cameras."""
        if self.render_mode is None:
            return None
        return tuple(self.episodes.picture(row) for row in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Level the plates and release the rigs."""
        self.episodes.close()


def _joined(parts: list[tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]], n: int) -> tuple[np.ndarray, dict]:
    """Observations and info of all N rows, joined from parts that have some rows each."""
    if len(parts) == 1:
        return parts[0][1], parts[0][2]
    order = np.argsort(np.concatenate([rows for rows, _, _ in parts]))
    info = {name: np.concatenate([info[name] for _, _, info in parts])[order] for name in parts[0][2]}
    return np.concatenate([observed for _, observed, _ in parts])[order], info


def _masked(info: dict[str, np.ndarray]) -> dict[str, Any]:
    """Info in Gymnasium's form: beside each array, a mask of the environments that it holds for."""
    return info | {f"_{name}": np.ones(len(values), dtype=bool) for name, values in info.items()}
