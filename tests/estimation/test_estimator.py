"""The estimator against motions that are known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mazeplan.control.estimation.estimator import Estimator, EstimatorOptions
from mazeplan.control.estimation.tilt_filter import AxisFilter
from mazeplan.core.records import Command, Observation
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.dynamics.planar import predict

MAZE = load_map("cme")
DT = 1.0 / 30.0


def model(delay_frames: float = 2.0) -> RigModel:
    return replace(RigModel.nominal(MAZE), camera_delay=delay_frames * DT)


class Played:
    """A ball played by the planar model under commands, seen late and with noise: truth is known at each moment.

    tilt_late: how late the tilt is measured, s; if it is given, the past is known at half ticks, too"""

    def __init__(
        self, rig_model: RigModel, theta: float = 0.3, noise: float = 0.0, seed: int = 0, tilt_late: float | None = None
    ) -> None:
        self.model, self.noise, self.rng = rig_model, noise, np.random.default_rng(seed)
        self.tilt_late, self.parts = tilt_late or 0.0, 1 if tilt_late is None else 2
        self.planar = rig_model.planar(MAZE)
        radius = MAZE.track_radius(1)
        self.z = np.array([radius * math.cos(theta), radius * math.sin(theta), 0, 0, 0, 0, 0, 0], dtype=float)
        self.history, self.t = [self.z.copy()], 0.0

    def past(self, late: float) -> np.ndarray:
        return self.history[max(0, len(self.history) - 1 - round(self.parts * late / DT))]

    def observation(self) -> Observation:
        x, y = self.past(self.model.camera_delay)[:2] + self.noise * self.rng.standard_normal(2)
        tilts = self.past(self.tilt_late)[[4, 6]]
        return Observation(self.t, float(x), float(y), *map(float, tilts))

    def step(self, command: Command) -> None:
        u, h = np.array([[command.u_beta, command.u_gamma]]), DT / self.parts
        for k in range(self.parts):
            t = self.t + k * h
            predict(self.z, t, t + h, np.array([t]), u, *self.planar)
            self.history.append(self.z.copy())
        self.t += DT


def wave(t: float) -> Command:
    return Command(0.05 * math.sin(2.0 * t), 0.05 * math.cos(1.3 * t + 0.4))


def follow(played: Played, estimator: Estimator, ticks: int, lost=lambda k: False) -> list[float]:
    """Distance in m between the state returned and the truth at the same moment, each tick."""
    errors = []
    for k in range(ticks):
        observation = played.observation()
        if lost(k):
            observation = replace(observation, x=None, y=None)
        state = estimator.update(observation)
        errors.append(math.hypot(state.x - played.z[0], state.y - played.z[1]))
        command = wave(played.t)
        estimator.sent(command, played.t)
        played.step(command)
    return errors


@pytest.mark.parametrize("delay_frames", [0.0, 1.0, 2.0, 3.0])
def test_the_delay_is_taken_out(delay_frames):
    rig = model(delay_frames)
    errors = follow(Played(rig), Estimator(MAZE, rig), 120)
    assert max(errors[20:]) < 0.5e-3  # m; the ball moves up to 10 mm in three frames


def test_an_estimator_that_knows_of_no_delay_lags():
    errors = follow(Played(model(2.0)), Estimator(MAZE, model(0.0)), 120)
    assert max(errors[20:]) > 4e-3


def test_a_tilt_that_is_late_costs_nothing():
    """By the clock of the tilt, the plate follows after a dead time, and a picture shows the ball of the future.

    Half of the pictures are lost, so that the tilt counts."""
    late, rig = 0.05, model(0.0)
    axes = {name: replace(getattr(rig.stage, name), dead_time=late) for name in ("beta", "gamma")}
    shifted = replace(rig, stage=replace(rig.stage, **axes), camera_delay=-late)

    def error(believed: RigModel, tilt_late: float) -> float:
        errors = follow(Played(rig, tilt_late=tilt_late), Estimator(MAZE, believed), 240, lost=lambda k: k % 24 >= 12)
        return float(np.sqrt(np.mean(np.square(errors[20:]))))

    prompt = error(rig, 0.0)
    assert error(shifted, late) < 1.1 * prompt
    assert error(rig, late) > 3.0 * prompt  # of one that does not know that the tilt is late


def test_without_a_tilt_sensor_the_commands_move_the_plate():
    rig = model()
    estimator, played, ever = Estimator(MAZE, rig), Played(rig), set()
    for k in range(120):
        state = estimator.update(replace(played.observation(), beta=math.nan, gamma=math.nan))
        ever |= estimator.doubts
        if k > 20:
            assert (state.beta, state.gamma) == pytest.approx((played.z[4], played.z[6]), abs=1e-3)
            assert math.hypot(state.x - played.z[0], state.y - played.z[1]) < 0.5e-3
        estimator.sent(wave(played.t), played.t)
        played.step(wave(played.t))
    assert ever == {"no_tilt"}
    estimator.update(played.observation())
    assert estimator.doubts == set()
    played.step(wave(played.t))
    estimator.update(replace(played.observation(), beta=math.nan, gamma=math.nan))
    assert estimator.doubts == {"tilt"}  # that sensor was there before


def test_noise_is_filtered():
    rig = model()
    errors = follow(Played(rig, noise=0.5e-3), Estimator(MAZE, rig), 300)
    assert np.sqrt(np.mean(np.square(errors[30:]))) < 1.5e-3  # m; three times one sample's sigma, at 67 ms ahead


def test_lost_frames_are_bridged_and_said():
    rig = model()
    estimator = Estimator(MAZE, rig)
    errors = follow(Played(rig), estimator, 90, lost=lambda k: 60 <= k < 70)
    assert max(errors[60:]) < 2e-3
    played = Played(rig)
    estimator = Estimator(MAZE, rig)
    for k in range(60):
        observation = played.observation()
        if k >= 30:
            observation = replace(observation, x=None, y=None)
        state = estimator.update(observation)
        assert state.lost == (k - 29 > round(0.5 / DT))
        estimator.sent(wave(played.t), played.t)
        played.step(wave(played.t))


def test_outliers_are_ignored_but_a_moved_ball_is_followed():
    rig = model(0.0)
    estimator, played = Estimator(MAZE, rig), Played(rig)
    for k in range(40):
        observation = played.observation()
        if k == 30:
            observation = replace(observation, x=observation.x + 0.03)
        state = estimator.update(observation)
        assert state.seen
        assert estimator.filtered.seen == (k != 30)  # seen somewhere, but that is no measurement of the ball
        if k >= 30:
            assert math.hypot(state.x - played.z[0], state.y - played.z[1]) < 1e-3
        estimator.sent(wave(played.t), played.t)
        played.step(wave(played.t))
    elsewhere = [Observation(played.t + k * DT, -0.0892, 0.0, 0.0, 0.0) for k in range(4)]
    states, believed = zip(*((estimator.update(o), estimator.filtered.seen) for o in elsewhere), strict=True)
    assert believed == (False, False, True, True)
    assert states[0].x > 0.0
    assert states[-1].x == pytest.approx(-0.0892, abs=2e-3)


def test_the_ring_has_hysteresis():
    rig = model(0.0)
    estimator = Estimator(MAZE, rig, EstimatorOptions(acceleration_sigma=1e3))  # follows each sample
    opening = MAZE.openings_between(1, 2)[0]
    middle, c, s = MAZE.threshold_radius(opening), math.cos(opening.angle), math.sin(opening.angle)

    def ring(r: float, k: int) -> int:
        return estimator.update(Observation(k * DT, r * c, r * s, 0.0, 0.0)).ring

    assert ring(middle + 0.003, 0) == 1
    assert ring(middle - 0.0005, 1) == 1  # past the middle, but not by the margin
    assert ring(middle - 0.003, 2) == 2
    assert ring(middle + 0.0005, 3) == 2
    assert ring(middle + 0.003, 4) == 1


def test_plate_filter_follows_the_servo_through_noise():
    axis = RigModel.nominal(MAZE).stage.beta
    rng, plate, truth, raw, filtered = np.random.default_rng(1), AxisFilter(axis), np.zeros(2), [], []
    for k in range(300):
        u = 0.06 * math.copysign(1.0, math.sin(0.2 * k))
        target = np.array([axis.gain * u + axis.offset, 0.0])
        truth = target + axis.transition(DT) @ (truth - target)
        plate.predict(u, DT)
        measured = truth[0] + 1e-3 * rng.standard_normal()
        plate.update(measured)
        raw.append(measured - truth[0])
        filtered.append(plate.mean[0] - truth[0])
    assert np.std(filtered) < 0.95 * np.std(raw)
    assert abs(plate.mean[1] - truth[1]) < 0.1


def test_ahead_is_the_state_later_with_the_last_command_held():
    rig = model()
    estimator, played = Estimator(MAZE, rig), Played(rig)
    for _ in range(60):
        estimator.update(played.observation())
        estimator.sent(wave(played.t), played.t)
        played.step(wave(played.t))
    state = estimator.update(played.observation())
    twin = played.z.copy()
    last = wave(played.t - DT)
    predict(twin, 0.0, 0.1, np.array([0.0]), np.array([[last.u_beta, last.u_gamma]]), *played.planar)
    later = estimator.ahead(0.1)
    assert later.t == pytest.approx(state.t + 0.1)
    assert (later.x, later.y) == pytest.approx((twin[0], twin[1]), abs=1e-3)


def test_commands_that_have_not_acted_yet_are_predicted_through():
    """The state returned is that of the moment at which the next command acts, not that of the sample."""
    dead_time = 0.05
    nominal = model(0.0)
    stage = replace(nominal.stage, beta=replace(nominal.stage.beta, dead_time=dead_time))
    stage = replace(stage, gamma=replace(nominal.stage.gamma, dead_time=dead_time))
    estimator = Estimator(MAZE, replace(nominal, stage=stage))
    planar = nominal.planar(MAZE)
    radius = MAZE.track_radius(1)
    z = np.array([radius, 0.0, 0, 0, 0, 0, 0, 0], dtype=float)
    moments, commands = [-1.0], [(0.0, 0.0)]
    for k in range(60):
        t = k * DT
        state = estimator.update(Observation(t, float(z[0]), float(z[1]), float(z[4]), float(z[6])))
        acts = z.copy()
        predict(acts, t, t + dead_time, np.array(moments), np.array(commands), *planar)
        assert state.t == pytest.approx(t + dead_time)
        if k > 10:
            assert state.gamma == pytest.approx(acts[6], abs=2e-3)
            assert math.hypot(state.x - acts[0], state.y - acts[1]) < 1e-3
        command = Command(0.0, 0.06 if (k // 12) % 2 else -0.06)
        estimator.sent(command, t)
        moments.append(t + dead_time)
        commands.append((command.u_beta, command.u_gamma))
        predict(z, t, t + DT, np.array(moments), np.array(commands), *planar)


def test_before_the_first_command_the_plate_stays():
    """And a command that acts at once is one that acts: there is nothing to predict through."""
    radius = MAZE.track_radius(1)
    for dead_time in (0.0, 0.05):
        nominal = model(0.0)
        axes = {name: replace(getattr(nominal.stage, name), dead_time=dead_time) for name in ("beta", "gamma")}
        estimator = Estimator(MAZE, replace(nominal, stage=replace(nominal.stage, **axes)))
        state = estimator.update(Observation(0.0, radius, 0.0, 0.0, 0.0))
        assert state.t == pytest.approx(dead_time)
        assert (state.beta, state.gamma, state.beta_dot, state.gamma_dot) == (0.0, 0.0, 0.0, 0.0)
        assert (state.x, state.y, state.vx, state.vy) == pytest.approx((radius, 0.0, 0.0, 0.0), abs=1e-9)


def test_an_unknown_kick_is_found():
    rig = model(0.0)
    estimator, played = Estimator(MAZE, rig), Played(rig)
    for k in range(50):
        if k == 30:
            theta = math.atan2(played.z[1], played.z[0])
            played.z[2:4] += 0.15 * np.array([-math.sin(theta), math.cos(theta)])
        state = estimator.update(played.observation())
        estimator.sent(wave(played.t), played.t)
        if k >= 40:
            assert math.hypot(state.vx - played.z[2], state.vy - played.z[3]) < 0.02
        played.step(wave(played.t))
