"""State estimator: ball and plate at the moment when the next command acts.

The camera's delay is `RigModel.camera_delay`; a command acts after `dead_time`. Times are those of the tilt sensor: if
it is later than the camera, the delay is negative, and the picture shows the ball after the measured tilt. At each
sample

1. the plate's axes are filtered to now (`tilt_filter.PlateFilter`) and their tilt is kept;
2. the planar model (walls and openings included) predicts the ball from the last measured moment to the new one under
   the filtered tilt; a Kalman filter per axis of the plate frame corrects it (state: position and velocity; noise:
   white acceleration);
3. the planar model predicts on to now under the known tilt, and to the moment when the next command acts under the
   queued commands. This state is returned: it has no lag.

The filter leaves out outliers: samples far outside the spread of the innovation. If several outliers in a row agree,
the filter restarts at their position. `tilt_filter.TiltCheck` does the same for tilts. `doubts` names what was left out
of the last sample. Without samples the prediction goes on; after LOST_AFTER s the state is `lost`. The ring changes
with hysteresis, when the predicted ball is past the middle of the wall by a margin.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from mazeplan.control.estimation.tilt_filter import PlateFilter, shaken, unforced
from mazeplan.core.field_checks import check_numbers
from mazeplan.core.records import Array, Command, Observation, State
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.physics.dynamics.planar import INNER, OUTER, contact, predict, predict_given_tilt, ring_index

HOLD_S = 1.0 / 30.0  # s; of a command, with which the settings of navigation were found
SPIN, SIZE = 8, 9  # of a state z: the state of `planar`, then the spin of a rigid ball, m/s
OUTLIER_SIGMAS = 8.0  # a sample with a larger innovation is an outlier, sigmas
OUTLIERS_TO_RESTART = 3  # number of agreeing outliers in a row that restart the filter
LOST_AFTER = 0.5  # s; time without a sample after which the ball is lost
RING_MARGIN = 1.0e-3  # m; distance past the middle of a wall at which the ring changes


@dataclass(frozen=True)
class EstimatorOptions:
    """Settings of the estimator."""

    camera_sigma: float = 0.5e-3  # 1 sigma of one sample, m
    acceleration_sigma: float = 0.5  # acceleration that the planar model does not explain, 1 sigma, m/s^2

    def __post_init__(self) -> None:
        check_numbers(self, positive=("camera_sigma", "acceleration_sigma"))


class Estimator:
    """Filter and predictor for one run. `update` takes each observation, `sent` each command.

    camera_delay: delay of the pictures, s
    acts_after: time from a sample to the moment for which a command is computed, s
    innovation: distance of the last sample from its prediction, m
    filtered: state at the measured moment
    doubts: what was left out of the last sample: words of `records.Doubt`"""

    def __init__(
        self, maze: Maze, model: RigModel, options: EstimatorOptions | None = None, rate_hz: float = 30.0,
        plate: PlateFilter | None = None,
    ) -> None:  # fmt: skip
        """plate: filter of the plate that several estimators share; its owner updates it"""
        self._maze, self._model, self._options = maze, model, options or EstimatorOptions()
        self._planar = model.planar(maze)
        # The settings of navigation hold for commands that stay for HOLD_S; half of it is part of every lead. At 60 Hz
        # a command acts that much earlier on average. At 15 Hz a later moment made runs slower, so it stays as it is.
        self._dt, self.camera_delay = 1.0 / rate_hz, model.camera_delay
        self.acts_after = model.stage.dead_time + 0.5 * min(self._dt - HOLD_S, 0.0)
        self._plate = plate or PlateFilter(model)
        self._coming: list[tuple[float, list[Array]]] = []  # (t, angle and rate of each axis) up to the picture
        self._z: Array | None = None  # (9,) ball at the last measured moment
        self._covariance = np.zeros((2, 2))  # of (position, velocity), the same for both axes
        self._measured_at = 0.0  # moment of self._z
        self._last_seen = 0.0
        self._outliers: list[Array] = []
        self._ring: int | None = None
        self._measured_ring: int | None = None
        self._acting_z: Array | None = None  # (9,) the state returned last
        self._acts_at = 0.0
        self.innovation = 0.0
        self.filtered: State | None = None
        self.doubts: set[str] = set()

    def sent(self, command: Command, t: float) -> None:
        """Record a command given to the rig at time t, s."""
        self._plate.sent(command, t)

    def update(self, observation: Observation) -> State:
        """Take in one sample. Returns the state at the moment when a command sent now will act."""
        self.follow(observation, self._plate.update(observation))
        self.correct(observation)
        return self.finish(observation, self.predicted(observation.t))

    # -- the steps of `update` -------------------------------------------------------------------------------------

    def follow(self, observation: Observation, doubts: set[str]) -> None:
        """Take over the plate after its filter took in the sample, with these doubts."""
        self.doubts = set(doubts)
        self._coming = self._plate.until(observation.t, observation.t - self.camera_delay)

    def correct(self, observation: Observation) -> None:
        """Predict the ball to the moment of the picture, and correct it with its place there."""
        moment = observation.t - self.camera_delay
        if observation.x is not None and observation.y is not None:
            place = np.array(self._model.camera.true(observation.x, observation.y))
            self._take_sample(moment, place, observation.t)
        elif self._z is not None:
            self._predict_to(moment)

    def predicted(self, t: float, until: float | None = None) -> Array:
        """State (9,) when a command sent at t will act, predicted from the last measured moment; zeros before it.

        until: the moment of the state, s, in place of that when the command acts"""
        z, end = self.ball(), t + self.acts_after if until is None else until
        if self._z is not None:
            self.advance(z, self._measured_at, min(t, end))
        z[4:6], z[6:8] = self._coming[-1][1] if self._coming else self._plate.means
        self.predict_queued(z, max(t, self._measured_at) if self._z is not None else t, end)
        return z

    def finish(self, observation: Observation, z: Array) -> State:
        """The state for z (9,), which is kept for `ahead`."""
        t, measured = observation.t, self.ball()
        self._acting_z, self._acts_at = z, t + self.acts_after
        lost = self._z is None or t - self._last_seen > LOST_AFTER + 1e-6
        self._measured_ring = self._hysteresis(self._measured_ring, math.hypot(measured[0], measured[1]))
        self._ring = self._hysteresis(self._ring, math.hypot(z[0], z[1]))
        believed = observation.seen and self._last_seen == t  # an outlier is no measurement of where the ball is
        self.filtered = _as_state(self._measured_at, measured, self._measured_ring, believed, lost)
        return _as_state(self._acts_at, z, self._ring, observation.seen, lost)

    def take_over(self, other: Estimator) -> None:
        """Continue for an estimator of the same ball that was in use until now: the ball is in the same ring."""
        self._ring, self._measured_ring = other._ring, other._measured_ring

    def ball(self) -> Array:
        """A copy of the state (9,) of the ball at the last measured moment; zeros before the first sample."""
        return np.zeros(SIZE) if self._z is None else self._z.copy()

    def ahead(self, seconds: float, beside: tuple[float, float] = (0.0, 0.0)) -> State:
        """The state returned by `update`, predicted `seconds` further with the last command held.

        beside: offset of the start in x and y, m."""
        if self._acting_z is None or self._ring is None:
            raise RuntimeError("no observation yet")
        z, t = self._acting_z.copy(), self._acts_at
        z[:2] += beside
        _, u_beta, u_gamma = self._plate.commands[-1]
        predict(z, t, t + seconds, np.array([t]), np.array([[u_beta, u_gamma]]), *self._planar)
        return _as_state(t + seconds, z, self._hysteresis(self._ring, math.hypot(z[0], z[1])), True, False)

    # -- ball -----------------------------------------------------------------------------------------------------

    def advance(self, z: Array, start: float, end: float) -> None:
        """Advance the ball in z from start to end, in the past, under the filtered tilt."""
        (times, tilts), p = self._plate.history, self._planar
        if self._coming:
            angles = [(plate[0][0], plate[1][0]) for _, plate in self._coming]
            times, tilts = np.append(times, [t for t, _ in self._coming]), np.concatenate([tilts, angles])
        predict_given_tilt(z, start, end, times, tilts, p.scalars, p.rings, p.walls, p.gaps)

    def predict_queued(self, z: Array, start: float, end: float) -> None:
        """Advance ball and plate in z from start to end, in the future, under the commands given so far."""
        if end <= start:
            return
        times, commands = self._plate.queue
        if not len(times):
            times, commands = np.array([start]), np.zeros((1, 2))
        predict(z, start, end, times, commands, *self._planar)

    def _predict_to(self, moment: float) -> None:
        assert self._z is not None
        dt = moment - self._measured_at
        if dt > 0.0:
            self.advance(self._z, self._measured_at, moment)
            transition, spread = unforced(dt), shaken(dt, self._options.acceleration_sigma)
            self._covariance = transition @ self._covariance @ transition.T + spread
            self._measured_at = moment

    def _start_at(self, moment: float, position: Array) -> None:
        sigma = self._options.camera_sigma
        self._z = np.zeros(SIZE)
        self._z[:2] = position
        self._covariance = np.diag([sigma**2, 0.1**2])  # a ball that is placed, or has just bounced: within 0.1 m/s
        self._measured_at = moment
        self._outliers.clear()

    def _take_sample(self, moment: float, position: Array, t: float) -> None:
        if self._z is None:
            self._start_at(moment, position)
            self._last_seen = t
            return
        self._predict_to(moment)
        innovation = position - self._z[:2]
        self.innovation = float(np.hypot(*innovation))
        if self.innovation > OUTLIER_SIGMAS * math.sqrt(self._variance()):
            self.doubts.add("ball")
            self._outliers.append(position)
            recent = self._outliers[-OUTLIERS_TO_RESTART:]
            agree = all(np.hypot(*(a - b)) < 0.02 for a, b in itertools.pairwise(recent))
            if len(recent) == OUTLIERS_TO_RESTART and agree:
                self._start_at(moment, position)
                self._last_seen = t
            return
        self._outliers.clear()
        self._last_seen = t
        self._correct(innovation)

    def _variance(self) -> float:
        """Variance of an innovation along either axis, m^2."""
        return float(self._covariance[0, 0]) + self._options.camera_sigma**2

    def _correct(self, innovation: Array) -> None:
        """Correct the state by the innovation of a sample that is no outlier."""
        assert self._z is not None
        z, gain = self._z, self._covariance[:, 0] / self._variance()
        z[:2] += gain[0] * innovation
        z[2:4] += gain[1] * innovation
        self._covariance = self._covariance - gain[:, None] * self._covariance[0]
        p = self._planar
        contact(z, p.scalars[0], p.rings, p.walls, p.gaps, 0.0)

    # -- result ---------------------------------------------------------------------------------------------------

    def _hysteresis(self, current: int | None, r: float) -> int:
        rings = self._planar.rings
        if current is None:
            return int(ring_index(r, rings)) + 1
        index, margin = current - 1, RING_MARGIN
        while index + 1 < len(rings) and r < 0.5 * (rings[index, INNER] + rings[index + 1, OUTER]) - margin:
            index += 1
        while index > 0 and r > 0.5 * (rings[index - 1, INNER] + rings[index, OUTER]) + margin:
            index -= 1
        return index + 1


def _as_state(t: float, z: Array, ring: int, seen: bool, lost: bool) -> State:
    x, y, vx, vy, beta, beta_dot, gamma, gamma_dot = z[:SPIN].tolist()
    return State(t, x, y, vx, vy, beta, beta_dot, gamma, gamma_dot, ring, seen, lost)
