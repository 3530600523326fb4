"""Online identification of the camera's delay, for a rig whose model has none.

A bank of estimators, one per candidate delay, gets the same samples and commands. While the tilt changes, a wrong delay
gives wrong predictions: one frame of error causes millimetres of innovation within a few tenths of a second. The bank
uses the estimator with the smallest innovations. It switches only to a clearly better estimator. (Bank of models with
hard switching; Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, ch. 11.)
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import repeat

import numpy as np

from mazeplan.control.estimation.estimator import Estimator, EstimatorOptions
from mazeplan.control.estimation.rigid_body_estimator import BodyEstimator
from mazeplan.control.estimation.rigid_body_fit import body_of
from mazeplan.control.estimation.tilt_filter import PlateFilter
from mazeplan.core.records import Observation, State
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze

DELAYS = tuple(k / 30.0 for k in range(-3, 5))  # s, tried; negative ones only down to minus the dead time
MEMORY = 0.98  # share of a score kept per sample: a memory of 50 samples
MOVING = 0.03  # m/s; a slower ball shows friction rather than delay
LEAST = 1e-8  # m^2; limits the ratio of scores for a camera without noise
MOST = 0.01  # m; limit of one innovation, so that an outlier does not decide
CLEARLY = 12.0  # minimum gain of -2 log likelihood for a switch, with the variance of the innovations unknown


class EstimatorBank:
    """Estimators of one ball that differ in delay or pictures, on one filter of the plate.

    squares (N,): sums of squares of their innovations, m^2; count: number of samples in the sums"""

    def __init__(self, maze: Maze, models: Sequence[RigModel], options: EstimatorOptions, rate_hz: float) -> None:
        self.plate = PlateFilter(models[0])  # the delay of the camera leaves it as it is
        self.each = [Estimator(maze, model, options, rate_hz, self.plate) for model in models]
        self.squares, self.count = np.zeros(len(models)), 0.0

    def update(
        self, observation: Observation, used: Estimator, pictures: Iterable[Observation] | None = None,
        memory: float = 1.0,
    ) -> bool:  # fmt: skip
        """Take in a sample. Returns whether the ball moves, so that the sample counts.

        used:      the estimator whose ball it is
        pictures:  the sample as each estimator sees it
        memory:    share of the sums that is kept"""
        doubts = self.plate.update(observation)
        for estimator, picture in zip(self.each, pictures or repeat(observation), strict=False):
            estimator.follow(observation, doubts)
            estimator.correct(picture)
        moves = observation.seen and math.hypot(*used.ball()[2:4]) > MOVING
        if moves:
            innovations = np.minimum([estimator.innovation for estimator in self.each], MOST)
            self.squares, self.count = memory * self.squares + innovations**2, memory * self.count + 1.0
        return moves


class DelayBank:
    """Has the interface of `Estimator`; current: the estimator in use."""

    def __init__(
        self, maze: Maze, model: RigModel, options: EstimatorOptions | None = None, rate_hz: float = 30.0
    ) -> None:
        dead = model.stage.dead_time
        least = -dead - 0.5 / rate_hz if dead > 0.5 / rate_hz else 0.0
        delays = [max(delay, -dead) for delay in DELAYS if delay >= least]
        models = [replace(model, camera_delay=delay) for delay in delays]
        self._bank = EstimatorBank(maze, models, options or EstimatorOptions(), rate_hz)
        self.current = self._bank.each[delays.index(min(delays, key=abs))]
        self.sent = self._bank.plate.sent

    @property
    def filtered(self) -> State | None:
        """As `Estimator.filtered`."""
        return self.current.filtered

    @property
    def doubts(self) -> set[str]:
        """As `Estimator.doubts`."""
        return self.current.doubts

    def update(self, observation: Observation) -> State:
        """Take in one sample. Returns the state at the moment when a command sent now will act."""
        bank, used = self._bank, self.current
        if bank.update(observation, used, memory=MEMORY):
            best = int(np.argmin(bank.squares))
            ratio = (bank.squares[bank.each.index(used)] + LEAST) / (bank.squares[best] + LEAST)
            if 2.0 * bank.count * math.log(ratio) > CLEARLY:  # two coordinates a sample
                self.current = bank.each[best]
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
