"""Estimator for a ball modelled as a rigid body: it knows the spin, the place in the channel and the walls.

It is an `Estimator` whose ball moves by `physics.dynamics.rigid_body`. Pictures correct the ball by the filter of
`rigid_body_filter`. `Estimator` handles the plate, outliers, lost pictures and the steps up to the next command.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from operator import itemgetter

import numpy as np
from numba import njit

from mazeplan.control.estimation.estimator import SPIN, Estimator, EstimatorOptions
from mazeplan.control.estimation.rigid_body_filter import (
    BodyModel,
    CameraView,
    add_process_noise,
    begin,
    correct,
    filter_core,
    predict_body,
)
from mazeplan.control.estimation.tilt_filter import HISTORY_S, Piece
from mazeplan.core.maths.compiled import KERNEL
from mazeplan.core.records import Array, Observation
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.physics.dynamics.plate import ROW, history_rows
from mazeplan.physics.dynamics.rigid_body import STATE, Ball, advance, body_core, effects_of
from mazeplan.physics.dynamics.walls import pack_walls

BALL = [0, 1, 2, 3, SPIN]  # indices of the ball's state in z
BEFORE = 1e-9  # s
JUMP_S = 1e-6  # s; duration of a jump of an axis that is not of second order
SUBSTEP = 1.0 / 150.0  # s, at most
UNSURE = 3e-4  # m^2/s^3; minimum white acceleration: a run knows the tilt only from sensor and commands
LONGEST = 0.5  # s; maximum prediction without a picture; after it the ball stays in place


@njit(**KERNEL)
def _predict_rows(ball, walls, effects, kf, rows, h, mean, P, room):
    """Predict mean (5,) and covariance P (5, 5) over all rows, with process noise; room (15, 5): scratch space."""
    core = body_core(ball, walls, effects)
    hit = predict_body(core, rows, 0, len(rows), h, mean, P, room[10:], room[:10])
    add_process_noise(P, kf, h * len(rows), hit)


@njit(**KERNEL)
def _correct_body(kf, mean, P, gain, a, b):
    """Correct mean and P by the innovation (a, b); gain (5, 2): scratch space."""
    correct(mean, P, gain, 1.0, a, b, P[0, 0] + kf.variance, P[1, 1] + kf.variance, P[0, 1])


class BodyEstimator(Estimator):
    """Filter and predictor for one run, like `Estimator`.

    body: the ball and the delay of the camera; the other numbers of the camera are in the model."""

    def __init__(
        self, maze: Maze, model: RigModel, body: BodyModel, options: EstimatorOptions | None = None,
        rate_hz: float = 30.0,
    ) -> None:  # fmt: skip
        super().__init__(maze, replace(model, camera_delay=body.view.delay), options, rate_hz)
        self._body, self._walls = body, pack_walls(maze)
        self._ball, self._effects = Ball(*map(float, body.ball)), effects_of(body.terms)
        wander = body.wander._replace(plane=max(body.wander.plane, UNSURE))
        self._kf = filter_core(CameraView(noise=body.view.noise), wander)
        self._mean, self._P = np.zeros(STATE), np.zeros((STATE, STATE))
        self._jumps = min(axis.order for axis in (self._plate.stage.beta, self._plate.stage.gamma)) < 2
        self._room, self._gain = np.zeros((3 * STATE, STATE)), np.empty((STATE, 2))
        self._motions: deque[tuple[float, ...]] = deque()  # t, and the plate's motion (6) at t
        self._preview: list[tuple[float, ...]] = []  # the same, from now to the moment of the picture

    def follow(self, observation: Observation, doubts: set[str]) -> None:
        """See `Estimator.follow`."""
        super().follow(observation, doubts)
        t, plate = observation.t, self._plate
        if not self._motions:
            self._motions.append((t - self._dt, *self._plate_motion(plate.before, (0.0, 0.0))))
        pieces = plate.acting(self._motions[-1][0], t)
        self._motions += self._plate_motions(plate.before, pieces)
        self._motions[-1] = (t, *self._plate_motion(plate.means, pieces[-1][2]))
        while self._motions[0][0] < t - HISTORY_S:
            self._motions.popleft()
        self._preview = self._plate_motions(plate.means, plate.acting(t, t - self.camera_delay))

    def _plate_motion(self, plate: Sequence[Array], u: tuple[float, float]) -> tuple[float, ...]:
        """The plate's motion (6): angle and rate (2,) of each axis, and the acceleration that the command gives it."""
        row: list[float] = []
        stage = self._plate.stage
        for axis, (angle, rate), command in zip((stage.beta, stage.gamma), plate, stage.mixed(*u), strict=True):
            row += [angle, rate, axis.acceleration(angle - axis.gain * command - axis.offset, rate)]
        return tuple(row)

    def _plate_motions(self, plate: Sequence[Array], pieces: Sequence[Piece]) -> list[tuple[float, ...]]:
        """The plate's motion at the end of each piece; plate: angle and rate of each axis at the beginning.

        In between, the acceleration changes gradually, because a servo's set point runs to its command without a jump.
        Where an axis jumps with its command, there is a row right after the jump, too."""
        rows = []
        for start, end, u in pieces:
            if self._jumps and end - start > 2.0 * JUMP_S:
                rows.append((start + JUMP_S, *self._plate_motion(self._plate.turned(plate, u, JUMP_S), u)))
            plate = self._plate.turned(plate, u, end - start)
            rows.append((end, *self._plate_motion(plate, u)))
        return rows

    def _rows(self, motions: Sequence[tuple[float, ...]], start: float, end: float) -> tuple[Array, float]:
        """Rows of `physics.dynamics.plate` from start to end, and the sub-step.

        motions: t, and the plate's motion (6) at t"""
        count = max(1, math.ceil((end - start) / SUBSTEP - 1e-6))
        h = (end - start) / count
        first = max(min(bisect_right(motions, start, key=itemgetter(0)) - 1, len(motions) - 2), 0)
        history = np.array(motions[first:])  # the rows before say nothing of what comes
        rows = np.empty((count, ROW))
        times = np.ascontiguousarray(history[:, 0])
        history_rows(times, np.ascontiguousarray(history[:, 1:]), self._body.tilting, start, h, rows)
        return rows, h

    def advance(self, z: Array, start: float, end: float) -> None:
        """See `Estimator.advance`."""
        self._roll(z, [*self._motions, *self._preview], start, end)

    def predict_queued(self, z: Array, start: float, end: float) -> None:
        """See `Estimator.predict_queued`."""
        if end <= start + 1e-9:
            return
        plate = [z[4:6], z[6:8]]
        last = self._plate.acting(start - BEFORE, start)[0][2]
        motions = [
            (start, *self._plate_motion(plate, last)),
            *self._plate_motions(plate, self._plate.acting(start, end)),
        ]
        self._roll(z, motions, start, end)
        z[4:6], z[6:8] = motions[-1][1:3], motions[-1][4:6]

    def _roll(self, z: Array, motions: Sequence[tuple[float, ...]], start: float, end: float) -> None:
        """Advance the ball in z from start to end, on a plate with these motions."""
        if end <= start + 1e-9:
            return
        rows, h = self._rows(motions, start, min(end, start + LONGEST))
        out = np.empty((len(rows), STATE))
        advance(self._ball, self._walls, self._effects, rows, h, z[BALL], out)
        z[BALL] = out[-1]

    def _predict_to(self, moment: float) -> None:
        assert self._z is not None
        if moment <= self._measured_at + 1e-9:
            return
        rows, h = self._rows(
            [*self._motions, *self._preview], self._measured_at, min(moment, self._measured_at + LONGEST)
        )
        _predict_rows(self._ball, self._walls, self._effects, self._kf, rows, h, self._mean, self._P, self._room)
        self._measured_at = moment
        self._z[BALL] = self._mean

    def _start_at(self, moment: float, position: Array) -> None:
        super()._start_at(moment, position)
        begin(self._mean, self._P, self._kf, float(position[0]), float(position[1]))

    def _variance(self) -> float:
        return float(max(self._P[0, 0], self._P[1, 1])) + self._kf.variance

    def _correct(self, innovation: Array) -> None:
        assert self._z is not None
        _correct_body(self._kf, self._mean, self._P, self._gain, float(innovation[0]), float(innovation[1]))
        self._z[BALL] = self._mean
