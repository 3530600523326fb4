"""Whether a rig behaves as its model says, in the first seconds of motion: `stage_watch` and `ball_watch`."""

from __future__ import annotations

import math
from dataclasses import replace

from mazeplan.control.estimation.ball_watch import BallWatch
from mazeplan.control.estimation.stage_watch import OFF, StageWatch
from mazeplan.core.records import Command, Observation
from mazeplan.learning.rig_model import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.physics.rig.stage import StageModel

WATCHED_S = 4.0  # s from the first sample; what shows later is a fault, not a misfit
LEARNED_OFF = math.radians(2.0)  # rad; rms from which a fitted stage is wrong: fast commands reach limits of any servo
MOST = 3  # stages that a run adopts
EVERY = 2  # samples between judgements


class FitWatch:
    """The watches of one run."""

    def __init__(self, maze: Maze, model: RigModel, rate_hz: float) -> None:
        self._maze, self._model, self._rate_hz, self._adopted, self._count = maze, model, rate_hz, 0, 0
        self._off = OFF if model.stage == StageModel() else LEARNED_OFF
        self._stage: StageWatch | None = StageWatch(model.stage, rate_hz)
        self._ball = BallWatch(maze, model, rate_hz)
        self._began: float | None = None

    def sent(self, command: Command, t: float) -> None:
        """Note the command of a tick at rig time t, s."""
        if self._stage is not None:
            self._stage.sent(command)
            self._ball.sent(command, t)

    def update(self, observation: Observation) -> tuple[str, StageModel | None] | None:
        """Take in a sample. Returns what does not fit, and the stage that would; None if nothing was found now."""
        if self._stage is None:
            return None
        t, self._count = observation.t, self._count + 1
        self._began = t if self._began is None else self._began
        if t - self._began > WATCHED_S:
            self._stage = None
            return None
        self._stage.update(observation)
        self._ball.update(observation)
        if self._count % EVERY:
            return None
        words, stage = self._stage.judge(self._off)
        if stage is not None:
            self._adopted += 1
            more = self._adopted < MOST and math.isinf(stage.beta.rate_limit)
            self._stage = self._stage.on(stage) if more else None
            delay = max(self._model.camera_delay, -stage.dead_time)
            self._ball = BallWatch(self._maze, replace(self._model, stage=stage, camera_delay=delay), self._rate_hz)
            return words, stage
        words = words or self._ball.judge()
        if words:
            self._stage = None
            return words, None
        return None
