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

from mazeplan.control.estimation.delay_bank import EstimatorBank
from mazeplan.control.estimation.estimator import EstimatorOptions
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
        self._bank = EstimatorBank(maze, [planar] * len(WAYS), EstimatorOptions(), rate_hz)
        self.sent = self._bank.plate.sent

    def update(self, observation: Observation) -> None:
        """Take in a sample."""
        x, y, pictures = observation.x, observation.y, list[Observation]()
        for place in WAYS.values():
            seen = (None, None) if x is None or y is None else place(x, y)
            pictures.append(replace(observation, x=seen[0], y=seen[1], others=()))
        self._bank.update(observation, self._bank.each[0], pictures)

    def judge(self) -> str:
        """What is wrong, in words; "" if nothing is, or if the ball has not moved enough."""
        count = self._bank.count
        if count < FEWEST:
            return ""
        rms = np.sqrt(self._bank.squares / count)
        best = int(np.argmin(rms))
        ratio = rms[0] / max(rms[best], 1e-9)
        wrong = rms[0] > LEAST and ratio > BETTER and 4.0 * count * math.log(ratio) > CLEARLY
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
        if self._stage is not None:
            self._stage.update(observation)
        if self._count % EVERY != 0:
            return None
        words, stage = ("", None) if self._stage is None else self._stage.judge(self._off)
        if stage is not None:
            return words, self._adopt(stage)
        words = words or self._ball.judge()
        if not words:
            return None
        self._stage = self._ball = None
        return words, None

    def _adopt(self, stage: StageModel) -> StageModel:
        """Watch on with another stage. A stage with a limited rate is not judged again, but the ball is."""
        self._adopted += 1
        if self._stage is not None and self._adopted < MOST_STAGES and math.isinf(stage.beta.rate_limit):
            self._stage.adopt(stage)
        else:
            self._stage = None
        delay = max(self._model.camera_delay, -stage.dead_time)
        self._ball = BallWatch(self._maze, replace(self._model, stage=stage, camera_delay=delay), self._rate_hz)
        return stage
