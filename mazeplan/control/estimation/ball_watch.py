"""Whether the ball follows the plate as physics says: the signs and the axes of the camera.

A bank of estimators gets the same commands and tilts, and pictures that are mirrored or turned over in the ways in
which a camera is mounted or wired wrongly. On a healthy rig, the pictures as they are give the smallest innovations.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mazeplan.control.estimation.estimator import Estimator
from mazeplan.core.records import Command, Observation
from mazeplan.learning.rig_model import RigModel
from mazeplan.maze.geometry import Maze

USUAL_LATE = 1.0 / 30.0  # s; delay of the picture where the model knows none
MOVING = 0.03  # m/s; a slower ball shows nothing
MOST = 0.01  # m; limit of one innovation, so that an outlier does not decide
FEWEST = 5  # samples of a moving ball
LEAST = 0.4e-3  # m; rms of the innovations from which pictures as they are may be wrong
BETTER, CLEARLY = 1.6, 45.0  # times smaller rms in another way; gain of -2 log L, with the variance unknown
Place = Callable[[float, float], tuple[float, float]]
WAYS: dict[str, Place] = {
    "": lambda x, y: (x, y),
    "the ball runs against the tilt beta: the sign of beta, or of x, is reversed": lambda x, y: (-x, y),
    "the ball runs against the tilt gamma: the sign of gamma, or of y, is reversed": lambda x, y: (x, -y),
    "the ball runs against the tilt: the signs of beta and gamma, or of x and y, are reversed": lambda x, y: (-x, -y),
    "the ball follows beta along y and gamma along x: the axes are exchanged": lambda x, y: (y, x),
}


class BallWatch:
    """The bank of one run."""

    def __init__(self, maze: Maze, model: RigModel, rate_hz: float) -> None:
        late = model.camera_delay if model.delay_known else max(USUAL_LATE, -model.stage.dead_time)
        planar = replace(model, camera_delay=late, camera_delay_stderr=0.0, body=None)
        self._bank = [Estimator(maze, planar, rate_hz=rate_hz) for _ in WAYS]
        self._squares, self._count = np.zeros(len(WAYS)), 0

    def sent(self, command: Command, t: float) -> None:
        """Note the command of a tick."""
        for estimator in self._bank:
            estimator.sent(command, t)

    def update(self, observation: Observation) -> None:
        """Take in a sample."""
        x, y = observation.x, observation.y
        for estimator, place in zip(self._bank, WAYS.values(), strict=True):
            seen = (None, None) if x is None or y is None else place(x, y)
            estimator.update(replace(observation, x=seen[0], y=seen[1], others=()))
        state = self._bank[0].filtered
        if observation.seen and state is not None and math.hypot(state.vx, state.vy) > MOVING:
            self._squares += np.minimum([estimator.innovation for estimator in self._bank], MOST) ** 2
            self._count += 1

    def judge(self) -> str:
        """What is wrong, in words; "" if nothing is, or if the ball has not moved enough."""
        if self._count < FEWEST:
            return ""
        rms = np.sqrt(self._squares / self._count)
        best = int(np.argmin(rms))
        ratio = rms[0] / max(rms[best], 1e-9)
        wrong = rms[0] > LEAST and ratio > BETTER and 4.0 * self._count * math.log(ratio) > CLEARLY
        return list(WAYS)[best] if wrong else ""
