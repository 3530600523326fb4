"""The rig on a table with parts that are made up: samples, limits, what happens when a part fails."""

from __future__ import annotations

import itertools
import math
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from mazeplan.core.errors import RigError
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.camera.detector import DetectionOutcome, Sighting
from mazeplan.rigs.camera.source import CameraFrame, NewestPicture
from mazeplan.rigs.hardware import rig as module
from mazeplan.rigs.hardware.clocks import TiltTrack
from mazeplan.rigs.hardware.rig import HardwareRig, Parts
from mazeplan.rigs.hardware.settings import TiltSensor
from mazeplan.rigs.interface import Rig
from mazeplan.rigs.watchdog import watched

MAZE = load_map("cme")
RING1 = MAZE.track_radius(1)
SETTINGS = {
    "servo": {
        "beta": {"level_us": 1510.0, "us_per_deg": 40.0, "min_us": 1400.0, "max_us": 1600.0},
        "gamma": {"level_us": 1490.0, "us_per_deg": -38.0, "min_us": 1250.0, "max_us": 1750.0},
    },
    "place_s": 1.0,
}


def sensor(*centre):
    """1 deg for a volt above the centre."""
    return TiltSensor(centre_v=centre, scale_v=(2.5, 2.5), beta_deg={"a": 2.5}, gamma_deg={"b": 2.5})


class Board:
    """Tells 1, -1 deg, a hundred times a second, unless it is silent."""

    port = "fake"

    def __init__(self):
        self.told, self.silent_from = [], math.inf

    def recent(self):
        now = min(time.monotonic(), self.silent_from)
        last = math.floor(now * 100)
        return [
            SimpleNamespace(time_s=k / 100, volts=(3.5, 1.5), sequence=len(self.told), received_s=k / 100 + 0.01)
            for k in range(last - 100, last)
        ]

    def command(self, *pulses):
        self.told.append(pulses)
        return len(self.told)

    def level(self):
        self.told.append("level")

    def close(self):
        self.told.append("close")


class Camera:
    """30 pictures a second; those in `gaps` never come, and after `last` it hangs."""

    def __init__(self, gaps=(), last=10**6):
        self.gaps, self.last, self.k, self.began = gaps, last, 0, time.monotonic()
        self.closed = threading.Event()

    def read(self):
        self.k += 1
        while self.k in self.gaps:
            self.k += 1
        if self.k > self.last:
            self.closed.wait()
            return None
        time.sleep(max(0.0, self.began + self.k / 30.0 - time.monotonic()))
        return CameraFrame(np.full((4, 4, 3), self.k % 250, np.uint8), time.monotonic())

    def close(self):
        self.closed.set()


class Detector:
    """A ball at x, y, unless there is none."""

    ball: tuple[float, float] | None = (RING1, 0.0)

    def locate(self, image, tilt=None):
        self.tilt = tilt
        if self.ball is None:
            return Sighting(None, None, 0.0, DetectionOutcome.NO_BALL)
        return Sighting(*self.ball, 1.0, DetectionOutcome.FOUND)


def made(**camera):
    rig = HardwareRig(MAZE, SETTINGS)
    pictures = NewestPicture(lambda: Camera(**camera), "fake")
    parts = Parts(Board(), pictures, Detector(), TiltTrack(sensor(2.5, 2.5)))  # pyright: ignore[reportArgumentType]
    rig._parts, rig._board = parts, parts.board
    return rig, parts


@pytest.fixture
def table():
    opened = []

    def make(**camera):
        opened.append(made(**camera))
        return opened[-1]

    yield make
    for rig, _ in opened:
        rig.close()


def test_it_is_a_rig_and_is_watched():
    rig = HardwareRig(MAZE, SETTINGS)
    assert isinstance(rig, Rig)
    assert watched(rig) is not rig
    assert rig.latency is None
    late = HardwareRig(MAZE, {**SETTINGS, "latency": {"command_ms": 14.0, "camera_ms": 50.0, "host_ms": 9.0}})
    assert (late.latency.camera_s, late.latency.command_s) == (0.05, pytest.approx(0.023))


@pytest.mark.realtime
def test_a_missing_picture_is_a_sample_without_a_ball(table):
    rig, parts = table(gaps=range(12, 24))
    samples = [rig.observe() for _ in range(40)]
    steps = np.diff([o.t for o in samples]) * 30.0
    assert np.allclose(steps, np.round(steps))  # on the grid of the rate
    unseen = sum(o.x is None for o in samples)
    assert 4 <= unseen <= 16  # 12, where this machine keeps up
    assert all(o.x == RING1 for o in samples if o.seen)
    assert [math.degrees(v) for v in (samples[-1].beta, samples[-1].gamma)] == pytest.approx([1.0, -1.0], abs=1e-3)
    assert parts.detector.tilt == pytest.approx((samples[-1].beta, samples[-1].gamma))


def test_commands_are_pulses_within_the_limits_of_servos_and_maze(table):
    rig, parts = table()
    rig.command(math.radians(2.0), math.radians(2.0))
    rig.command(math.radians(5.0), math.radians(-5.0))
    assert parts.board.told == [pytest.approx((1590.0, 1414.0)), pytest.approx((1600.0, 1680.0))]
    for bad in (math.nan, math.radians(5.1), -math.inf):
        for pair in ((bad, 0.0), (0.0, bad)):
            with pytest.raises(RigError, match="expected at most"):
                rig.command(*pair)
    assert len(parts.board.told) == 2


def test_after_an_emergency_stop_nothing_moves_until_the_next_reset(table):
    rig, parts = table()
    rig.command(0.03, 0.0)
    rig.stop()
    rig.command(0.03, 0.0)
    assert parts.board.told[1:] == ["level", "level"]
    parts.detector.ball = (0.0, RING1)
    parts.track = TiltTrack(sensor(3.5, 1.5))  # level
    rig.reset(ring=1, theta=0.0, rng=np.random.default_rng(0))
    rig.command(0.03, 0.0)
    assert parts.board.told[-1] != "level"
    assert abs(rig.observe().t) < 3.1 / 30.0


@pytest.mark.slow
@pytest.mark.parametrize("ball", [None, (0.0, 0.0), "rolling", "on a tilted plate"])
def test_reset_waits_for_a_ball_at_rest_in_the_ring(table, ball):
    rig, parts = table()
    if ball != "on a tilted plate":
        parts.track = TiltTrack(sensor(3.5, 1.5))
    if ball == "rolling":
        places = ((RING1 * math.cos(0.05 * k), RING1 * math.sin(0.05 * k)) for k in itertools.count())
        parts.detector.locate = lambda image, tilt=None: Sighting(*next(places), 1.0, DetectionOutcome.FOUND)
    elif not isinstance(ball, str):
        parts.detector.ball = ball
    what = r"[1-9]\d* pictures 0 showed one, \d+ no ball" if ball is None else r"[1-9]\d* pictures [1-9]\d* showed one"
    with pytest.raises(RigError, match=f"no ball rested in ring 1 within 1 s: of {what}"):
        rig.reset(ring=1, theta=0.0, rng=np.random.default_rng(0))


def test_a_silent_camera_or_board_fails_the_rig(table, monkeypatch):
    monkeypatch.setattr(module, "BLIND_S", 0.3)
    rig, _ = table(last=10)
    with pytest.raises(RigError, match=r"camera 0: no picture for 0\.3 s"):
        list(iter(rig.observe, None))
    rig, parts = table()
    rig.observe()
    parts.board.silent_from = time.monotonic()
    with pytest.raises(RigError, match=r"fake: no report of the tilt for 0\.4 s"):
        list(iter(rig.observe, None))


def test_closing_levels_and_may_come_twice(table):
    rig, parts = table()
    rig.observe()
    rig.close()
    rig.close()
    assert parts.board.told == ["close"]
