"""How late command and camera are, from a swing that is made up: a servo of second order behind pulses of 50 Hz."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.hardware.latency import dead_time, picture_delay, swing

LIMIT = load_map("cme").tilt_limit


SLEW = math.radians(120.0)  # 1/s


@cache
def swung(dead, wn=24.0, zeta=0.8, seed=0, seconds=10.0):
    """(sent, u, told, tilt, mean delay of what reached the servo) of a plate that was swung, by small steps of time."""
    rng, dt = np.random.default_rng(seed), 4e-4
    sent, u, delays, told, tilt = [], [], [], [], []
    state, rate, target, drive = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2)
    under_way, n = [], 0
    for k in range(round(seconds / dt)):
        t = k * dt
        if t >= n / 30.0:
            sent.append(t)
            u.append(swing(t, LIMIT))
            under_way.append((t + dead, np.array(u[-1]), t))
            n += 1
        if k % 50 == 18 and under_way and under_way[0][0] <= t:  # a pulse begins: every 20 ms
            while under_way and under_way[0][0] <= t:
                _, target, when = under_way.pop(0)
                delays.append(t - when)
        drive = drive + np.clip(target - drive, -SLEW * dt, SLEW * dt)
        rate = rate + dt * (wn**2 * (drive - state) - 2.0 * zeta * wn * rate)
        state = state + dt * rate
        if k % 25 == 0:
            told.append(t)
            tilt.append(state + rng.normal(0.0, 2e-4, 2))
    return np.array(sent), np.array(u), np.array(told), np.array(tilt), float(np.mean(delays))


@pytest.mark.slow
@pytest.mark.parametrize(("dead", "wn", "zeta"), [(0.004, 24.0, 0.8), (0.045, 15.0, 1.2)])
def test_the_dead_time_is_told_from_the_servos_lag(dead, wn, zeta):
    sent, u, told, tilt, true = swung(dead, wn, zeta)
    found = dead_time(sent, u, told, tilt)
    assert found.seconds == pytest.approx(true, abs=5e-3)
    assert found.stderr < 2e-3


@pytest.mark.parametrize("late", [0.012, 0.05, 0.13])
def test_the_age_of_pictures_though_some_markers_are_read_wrong(late):
    _, _, told, tilt, _ = swung(0.01)
    rng, seen_at, seen = np.random.default_rng(1), [], []
    for k in range(15, 290):
        t = k / 30.0
        seen_at.append(t)
        there = [np.interp(t - late, told, tilt[:, axis]) for axis in (0, 1)]
        seen.append(1.02 * np.array(there) + 0.003 + rng.normal(0.0, 1e-3, 2) + (0.1 if k % 40 == 0 else 0.0))
    found = picture_delay(np.array(seen_at), np.array(seen), told, tilt)
    assert found.seconds == pytest.approx(late, abs=2e-3)
    assert found.stderr < 1e-3


def test_the_swing_stays_within_the_limit_and_begins_level():
    assert swing(0.0, LIMIT) == (0.0, 0.0)
    for limit in (LIMIT, math.radians(0.8)):
        assert max(abs(u) for t in np.arange(0.0, 20.0, 1 / 30) for u in swing(float(t), limit)) <= limit + 1e-12
