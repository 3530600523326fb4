"""Finds out the camera's delay while the ball rolls, for a rig whose delay was never identified.

One estimator per candidate delay, all given the same samples and commands. Under a tilt that changes, the wrong ones
predict the ball at the wrong place: a frame too much or too little is an innovation of millimetres within a few tenths
of a second. The one with the smallest innovations speaks for all, and loses that only to one that is clearly better:
while the ball stands they are all alike. (A bank of models with hard switching; Bar-Shalom, Li, Kirubarajan,
"Estimation with Applications to Tracking and Navigation", 2001, chapter 11.)
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mazeplan.estimation.bodyestimator import BodyEstimator
from mazeplan.estimation.bodynumbers import body_of
from mazeplan.estimation.estimator import Estimator, EstimatorOptions
from mazeplan.maze.geometry import Maze
from mazeplan.models.modelfile import RigModel
from mazeplan.records import Command, Observation, State

FRAMES = (0.0, 1.0, 2.0, 3.0, 4.0)  # samples of delay tried
MEMORY = 0.98  # of a score, per sample: 50 samples
MOVING = 0.03  # m/s; a ball that only just begins to move tells more of friction than of delay
LEAST = 1e-8  # m^2; with a picture that is perfect any difference would be clear
MOST = 0.01  # m; an innovation counts for no more, or one outlier would decide
CLEARLY = 12.0  # of -2 log likelihood, with the variance of the innovations unknown


class DelayBank:
    """As an `Estimator` with the delay that explains the ball's motion best; `camera_delay` tells which, s."""

    def __init__(
        self, maze: Maze, model: RigModel, options: EstimatorOptions | None = None, rate_hz: float = 30.0
    ) -> None:
        self._options = options or EstimatorOptions()
        self._delays = [frames / rate_hz for frames in FRAMES]
        self._bank = [
            Estimator(maze, replace(model, camera_delay=delay), self._options, rate_hz) for delay in self._delays
        ]
        self._scores, self._samples = np.zeros(len(self._bank)), 0.0
        self._best = 0

    @property
    def camera_delay(self) -> float:
        """The delay believed now, s."""
        return self._delays[self._best]

    @property
    def dead_time(self) -> float:
        """As `Estimator.dead_time`."""
        return self._bank[0].dead_time

    @property
    def innovation(self) -> float:
        """That of the estimator which speaks, m."""
        return self._bank[self._best].innovation

    @property
    def filtered(self) -> State | None:
        """As `Estimator.filtered`."""
        return self._bank[self._best].filtered

    @property
    def doubts(self) -> set[str]:
        """As `Estimator.doubts`."""
        return self._bank[self._best].doubts

    def warm_up(self) -> None:
        """Compile everything before the rig moves."""
        self._bank[0].warm_up()

    def sent(self, command: Command, t: float) -> None:
        """Note a command given to the rig at time t."""
        for estimator in self._bank:
            estimator.sent(command, t)

    def update(self, observation: Observation) -> State:
        """Take in one sample; the state at the moment when a command sent now will act."""
        states = [estimator.update(observation) for estimator in self._bank]
        moving = self.filtered is not None and math.hypot(self.filtered.vx, self.filtered.vy) > MOVING
        if observation.seen and moving:
            innovations = np.minimum([estimator.innovation for estimator in self._bank], MOST)
            self._scores = MEMORY * self._scores + innovations**2
            self._samples = MEMORY * self._samples + 1.0
            best = int(np.argmin(self._scores))
            ratio = (self._scores[self._best] + LEAST) / (self._scores[best] + LEAST)
            if 2.0 * self._samples * math.log(ratio) > CLEARLY:  # two coordinates a sample
                self._best = best
        return states[self._best]

    def ahead(self, seconds: float, beside: tuple[float, float] = (0.0, 0.0)) -> State:
        """See `Estimator.ahead`."""
        return self._bank[self._best].ahead(seconds, beside)


def estimator_for(
    maze: Maze, model: RigModel, options: EstimatorOptions | None = None, rate_hz: float = 30.0
) -> Estimator | DelayBank:
    """An estimator with the model's delay where that was identified (or written by a person), else one that finds it
    out; of a ball with a body, where the model holds one."""
    body = body_of(model)
    if body is not None and model.delay_known:
        return BodyEstimator(maze, model, body, options, rate_hz)
    return (Estimator if model.delay_known else DelayBank)(maze, model, options, rate_hz)
