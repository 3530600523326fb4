"""The environment with one rig."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from mazeplan.apps.environment.episodes import Episodes
from mazeplan.apps.environment.task import Task
from mazeplan.core.errors import SettingsError
from mazeplan.core.records import Observation

_ONE = np.array([0])


class CircularMazeEnv(gymnasium.Env):
    """The agent tilts the plate to bring a ball from one ring to another. options: those of `task.Task`.

    Raises SettingsError or MapError for an option that cannot be used, RigError when the rig fails."""

    metadata = {"render_modes": ["rgb_array", "ansi"], "render_fps": 30}  # noqa: RUF012  Gymnasium has it so

    def __init__(self, *, render_mode: str | None = None, **options: Any) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            modes = ", ".join(self.metadata["render_modes"])
            raise SettingsError(f"got {render_mode!r}, expected one of {modes}", key="render_mode")
        self.render_mode = render_mode
        self.episodes = Episodes(Task.of(options), 1)
        self.action_space, self.observation_space = self.episodes.action_space, self.episodes.observation_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Place the ball and level the plate. options: `start_ring`, `start_angle_deg` of this episode."""
        super().reset(seed=seed)
        observed, info = self.episodes.reset(_ONE, [self.np_random], options)
        return observed[0], _of_one(info)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Command the tilt `action` x the tilt limit, (u_beta, u_gamma), for one sample."""
        observed, verdict, info = self.episodes.step(_ONE, np.asarray(action)[None])
        ended = bool(verdict.arrived[0] or verdict.out[0])
        return observed[0], float(verdict.reward[0]), ended, False, _of_one(info)

    def measured(self) -> Observation:
        """The last sample of the rig, in SI units."""
        return self.episodes.observation(0)

    def render(self) -> Any:
        """For rgb_array the picture of the camera, (480, 640, 3); for ansi a line of text."""
        if self.render_mode == "rgb_array":
            return self.episodes.picture(0)
        if self.render_mode != "ansi":
            return None
        sample = self.measured()
        where = "not seen" if sample.x is None else f"x {1e3 * sample.x:6.1f} y {1e3 * (sample.y or 0.0):6.1f} mm"
        beta, gamma = (float(np.degrees(angle)) for angle in (sample.beta, sample.gamma))
        return f"t {sample.t:6.2f} s  {where}  beta {beta:5.2f} gamma {gamma:5.2f} deg\n"

    def close(self) -> None:
        """Level the plate and release the rig."""
        self.episodes.close()


def _of_one(info: dict[str, np.ndarray]) -> dict[str, Any]:
    return {name: values[0].item() for name, values in info.items()}
