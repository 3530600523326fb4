"""Three clocks on one: the board's, the camera's, the host's."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from mazeplan.rigs.hardware.clocks import REPORT_AGE_S, FrameClock, HostClock, TiltTrack
from mazeplan.rigs.hardware.settings import TiltSensor

PLAIN = TiltSensor(centre_v=(0.0, 0.0), scale_v=(1.0, 1.0), beta_deg={"a": 1.0}, gamma_deg={"b": 1.0})  # V are degrees


@dataclass
class Report:
    time_s: float
    volts: tuple[float, float]
    received_s: float


def test_late_receptions_do_not_shift_the_boards_clock():
    rng, clock, off = np.random.default_rng(0), HostClock(), []
    for k in range(6000):  # a minute; the board's clock is slow by .3 %
        true = 100.0 + 0.01 * k
        received = true + REPORT_AGE_S + (0.03 * rng.random() if k % 7 else 0.0)
        off.append(clock.host(0.997 * (true - 100.0), received) - true)
    assert np.abs(off[100:]).max() < 1e-3
    assert abs(clock.host(0.0, 200.0) - (200.0 - REPORT_AGE_S)) < 1e-9  # it began anew


@pytest.mark.parametrize(("last", "first"), [(50.0, 0.01), (0.5, 0.6), (2**32 / 1e4 - 0.005, 0.005), (3e5, 0.01)])
def test_a_restart_or_a_wrap_of_the_boards_counter_begins_the_offset_anew(last, first):
    clock = HostClock()
    clock.host(last, 10.0)
    for t in (12.5, 12.51, 12.52):
        assert clock.host(first + t - 12.5, t) == pytest.approx(t - REPORT_AGE_S, abs=1e-3)


def told(upto, swing=1.0):
    """Reports up to a time of a tilt of swing * sin 3t degrees about x."""
    out = []
    for k in range(round(upto * 100) + 1):
        t = 0.01 * k
        out.append(Report(t, (0.0, swing * math.sin(3.0 * t)), 50.0 + t + REPORT_AGE_S))
    return out


def test_the_tilt_at_any_moment_of_the_last_second():
    track = TiltTrack(PLAIN)
    assert track.at(50.0) is None
    reports = told(2.0)
    track.take(reports[:150])
    track.take(reports[100:])  # half of them again
    for t in (51.2, 51.444, 51.993, 52.0, 52.012):
        beta, gamma = track.at(t)
        assert beta == 0.0
        assert math.degrees(gamma) == pytest.approx(math.sin(3.0 * (t - 50.0)), abs=3e-3)
    assert track.at(53.0) == track.at(52.03)  # carried on for a few ms only
    assert track.at(10.0)[1] == pytest.approx(track.at(51.0)[1], abs=1e-3)  # the oldest that is kept


def test_pictures_are_numbered_through_jitter_drift_and_gaps():
    rng, clock, period = np.random.default_rng(1), FrameClock(30.0), 1.003 / 30.0
    clock.start(7.0)
    worst, numbers = 0.0, []
    for k in range(1, 900):
        if k % 50 in (10, 11, 12):  # pictures that never came
            continue
        numbers.append((k, clock.take(7.0 + k * period + 0.004 * rng.random())))
        if k > 200:
            worst = max(worst, abs(clock.due(k) - (7.0 + k * period + 0.002)))
    assert all(k == number for k, number in numbers)
    assert worst < 2e-3  # half of the jitter, in which it arrives


def test_a_late_picture_is_the_next_one():
    clock = FrameClock(30.0)
    clock.start(0.0)
    assert clock.take(1.0 / 30.0 + 0.012) == 1
    assert clock.take(3.6 / 30.0) == 4
