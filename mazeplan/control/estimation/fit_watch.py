"""Whether a rig behaves as its model says, in the first seconds of motion: its stage (`stage_watch`) and its ball.

The ball has to follow the plate as physics says. A bank of estimators gets the same commands and tilts, and pictures
that are mirrored or turned over in the ways in which a camera is mounted or wired wrongly. On a healthy rig, the
pictures as they are give the smallest innovations.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mazeplan.control.estimation.estimator import Estimator, EstimatorOptions
from mazeplan.control.estimation.plate import PlateFilter
from mazeplan.control.estimation.stage_watch import OFF, StageWatch
from mazeplan.core.records import Command, Observation
from mazeplan.learning.rig_model import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.physics.rig.stage import StageModel

WATCHED_S = 4.0  # s from the first sample; what shows later is a fault, not a misfit
LEARNED_OFF = math.radians(2.0)  # rad; rms from which a fitted stage is wrong: fast commands reach limits of any servo
MOST_STAGES = 3  # stages that a run adopts
EVERY = 2  # samples between judgements
USUAL_LATE = 1.0 / 30.0  # s; delay of the picture where the model knows none
MOVING = 0.03  # m/s; a slower ball shows nothing
MOST = 0.01  # m; limit of one innovation, so that an outlier does not decide
FEWEST = 5  # samples of a moving ball
LEAST = 0.4e-3  # m; rms of the innovations from which pictures as they are may be wrong
# times smaller rms in another way; gain of -2 log L, with the variance unknown: in 980 healthy runs on 223 rigs it was
# 32 once, else less; with mirrored or exchanged pictures it reaches 42 to 370
BETTER, CLEARLY = 1.2, 40.0
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
        self._plate = PlateFilter(planar, EstimatorOptions().plate)  # one for all: they differ in the pictures
        self._bank = [Estimator(maze, planar, rate_hz=rate_hz, plate=self._plate) for _ in WAYS]
        self._squares, self._count = np.zeros(len(WAYS)), 0

    def sent(self, command: Command, t: float) -> None:
        """Note the command of a tick."""
        self._plate.sent(command, t)

    def update(self, observation: Observation) -> None:
        """Take in a sample."""
        x, y, doubts = observation.x, observation.y, self._plate.update(observation)
        for estimator, place in zip(self._bank, WAYS.values(), strict=True):
            seen = (None, None) if x is None or y is None else place(x, y)
            estimator.follow(observation, doubts)
            estimator.correct(replace(observation, x=seen[0], y=seen[1], others=()))
        if observation.seen and math.hypot(*self._bank[0].ball()[2:4]) > MOVING:
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


class FitWatch:
    """The watches of one run."""

    def __init__(self, maze: Maze, model: RigModel, rate_hz: float) -> None:
        self._maze, self._model, self._rate_hz, self._adopted, self._count = maze, model, rate_hz, 0, 0
        self._off = OFF if model.stage == StageModel() else LEARNED_OFF
        self._stage: StageWatch | None = StageWatch(model.stage, rate_hz)
        self._ball: BallWatch | None = BallWatch(maze, model, rate_hz)  # None: the watch is over
        self._began: float | None = None

    def sent(self, command: Command, t: float) -> None:
        """Note the command of a tick at rig time t, s."""
        if self._stage is not None:
            self._stage.sent(command)
        if self._ball is not None:
            self._ball.sent(command, t)

    def update(self, observation: Observation) -> tuple[str, StageModel | None] | None:
        """Take in a sample. Returns what does not fit, and the stage that would; None if nothing was found now."""
        if self._ball is None:
            return None
        t, self._count = observation.t, self._count + 1
        self._began = t if self._began is None else self._began
        if t - self._began > WATCHED_S:
            self._stage = self._ball = None
            return None
        self._ball.update(observation)
        words = ""
        if self._stage is not None:
            self._stage.update(observation)
            words, stage = self._stage.judge(self._off) if self._count % EVERY == 0 else ("", None)
            if stage is not None:
                return words, self._adopt(stage, self._stage)
        if self._count % EVERY == 0:
            words = words or self._ball.judge()
        if words:
            self._stage = self._ball = None
            return words, None
        return None

    def _adopt(self, stage: StageModel, watch: StageWatch) -> StageModel:
        """Watch on with another stage. A stage with a limited rate is not judged again, but the ball is."""
        self._adopted += 1
        more = self._adopted < MOST_STAGES and math.isinf(stage.beta.rate_limit)
        self._stage = watch.on(stage) if more else None
        delay = max(self._model.camera_delay, -stage.dead_time)
        self._ball = BallWatch(self._maze, replace(self._model, stage=stage, camera_delay=delay), self._rate_hz)
        return stage
