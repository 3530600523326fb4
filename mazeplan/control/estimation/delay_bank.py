"""Online identification of the camera's delay, for a rig whose model has none.

A bank of estimators, one per candidate delay, gets the same samples and commands. While the tilt changes, a wrong delay
gives wrong predictions: one frame of error causes millimetres of innovation within a few tenths of a second. The bank
uses the estimator with the smallest innovations. It switches only to a clearly better estimator. (Bank of models with
hard switching; Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, ch. 11.)
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mazeplan.control.estimation.estimator import Estimator, EstimatorOptions
from mazeplan.control.estimation.plate import PlateFilter
from mazeplan.control.estimation.rigid_body_estimator import BodyEstimator
from mazeplan.control.estimation.rigid_body_parameters import body_of
from mazeplan.core.records import Command, Observation, State
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze

DELAYS = tuple(k / 30.0 for k in range(-3, 5))  # s, tried; negative ones only down to minus the dead time
MEMORY = 0.98  # share of a score kept per sample: a memory of 50 samples
MOVING = 0.03  # m/s; a slower ball shows friction rather than delay
LEAST = 1e-8  # m^2; limits the ratio of scores for a camera without noise
MOST = 0.01  # m; limit of one innovation, so that an outlier does not decide
CLEARLY = 12.0  # minimum gain of -2 log likelihood for a switch, with the variance of the innovations unknown


class DelayBank:
    """Has the interface of `Estimator`; `camera_delay` is the delay in use, s."""

    def __init__(
        self, maze: Maze, model: RigModel, options: EstimatorOptions | None = None, rate_hz: float = 30.0
    ) -> None:
        self._options = options or EstimatorOptions()
        least = -model.stage.dead_time - 0.5 / rate_hz if model.stage.dead_time > 0.5 / rate_hz else 0.0
        self._delays = [max(delay, -model.stage.dead_time) for delay in DELAYS if delay >= least]
        self._plate = PlateFilter(model, self._options.plate)  # one for all: the delay of the camera leaves it as it is
        self._bank = [
            Estimator(maze, replace(model, camera_delay=delay), self._options, rate_hz, self._plate)
            for delay in self._delays
        ]
        self._scores, self._samples = np.zeros(len(self._bank)), 0.0
        self._best = self._delays.index(min(self._delays, key=abs))

    @property
    def camera_delay(self) -> float:
        """The delay in use, s."""
        return self._delays[self._best]

    @property
    def dead_time(self) -> float:
        """As `Estimator.dead_time`."""
        return self._bank[0].dead_time

    @property
    def innovation(self) -> float:
        """As `Estimator.innovation`, m."""
        return self.current.innovation

    @property
    def filtered(self) -> State | None:
        """As `Estimator.filtered`."""
        return self.current.filtered

    @property
    def doubts(self) -> set[str]:
        """As `Estimator.doubts`."""
        return self.current.doubts

    @property
    def current(self) -> Estimator:
        """The estimator in use."""
        return self._bank[self._best]

    def warm_up(self) -> None:
        """Compile everything before the rig moves."""
        self._bank[0].warm_up()

    def sent(self, command: Command, t: float) -> None:
        """Record a command given to the rig at time t, s."""
        self._plate.sent(command, t)

    def update(self, observation: Observation) -> State:
        """Take in one sample. Returns the state at the moment when a command sent now will act."""
        doubts, used = self._plate.update(observation), self.current
        for estimator in self._bank:
            estimator.follow(observation, doubts)
            estimator.correct(observation)
        if observation.seen and float(np.hypot(*used.ball()[2:4])) > MOVING:
            innovations = np.minimum([estimator.innovation for estimator in self._bank], MOST)
            self._scores = MEMORY * self._scores + innovations**2
            self._samples = MEMORY * self._samples + 1.0
            best = int(np.argmin(self._scores))
            ratio = (self._scores[self._best] + LEAST) / (self._scores[best] + LEAST)
            if 2.0 * self._samples * math.log(ratio) > CLEARLY:  # two coordinates a sample
                self._best = best
                self.current.take_over(used)
        return self.current.finish(observation, self.current.predicted(observation.t))

    def ahead(self, seconds: float, beside: tuple[float, float] = (0.0, 0.0)) -> State:
        """See `Estimator.ahead`."""
        return self.current.ahead(seconds, beside)


def estimator_for(
    maze: Maze, model: RigModel, options: EstimatorOptions | None = None, rate_hz: float = 30.0
) -> Estimator | DelayBank:
    """The estimator for a model: a `DelayBank` if the delay is unknown, else for a rigid body if the model has one."""
    body = body_of(model)
    if body is not None and model.delay_known:
        return BodyEstimator(maze, model, body, options, rate_hz)
    return (Estimator if model.delay_known else DelayBank)(maze, model, options, rate_hz)
