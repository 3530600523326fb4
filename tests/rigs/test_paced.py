"""A simulated rig held to the wall's clock; the clock is the test's."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from mazeplan.core.records import Observation
from mazeplan.rigs.paced import PacedRig


class Wall:
    """Goes on only while somebody waits, or `busy` makes it."""

    def __init__(self):
        self.time, self.slept, self.on_wait = 100.0, [], lambda woken: None

    def now(self):
        return self.time

    def wait(self, woken, seconds):
        self.on_wait(woken)
        if not woken.is_set():
            self.slept.append(seconds)
            self.time += seconds

    def busy(self, seconds):
        self.time += seconds


class Counting:
    """Samples at 10 Hz, at once; keeps what it is told, and by whom."""

    rate_hz, realtime, latency = 10.0, False, "measured"

    def __init__(self):
        self.told, self.threads = [], set()

    def reset(self, *, ring, theta, rng):
        self.count = 0

    def observe(self):
        self.count += 1
        return Observation((self.count - 1) / self.rate_hz, 0.0, 0.0, 0.0, 0.0)

    def command(self, u_beta, u_gamma):
        self.told.append((u_beta, u_gamma))

    def level(self):
        self.told.append("level")
        self.threads.add(threading.get_ident())

    def close(self):
        self.told.append("close")


@pytest.fixture
def wall():
    return Wall()


@pytest.fixture
def rig(wall):
    rig = PacedRig(Counting(), wall.now, wall.wait)
    rig.reset(ring=1, theta=0.0, rng=np.random.default_rng(0))
    return rig


def test_samples_come_when_they_are_due(rig, wall):
    began, times = wall.time, []
    for _ in range(5):
        rig.observe()
        times.append(wall.time - began)
        wall.busy(0.03)
    assert times == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert wall.slept == pytest.approx([0.07] * 4)


def test_level_now_acts_during_a_wait(rig, wall):
    rig.observe()
    rig.command(0.05, 0.0)

    def on_wait(woken):
        wall.on_wait = lambda woken: None
        other = threading.Thread(target=rig.level_now)
        other.start()
        other.join()

    wall.on_wait = on_wait
    rig.observe()
    assert rig.inside.told == [(0.05, 0.0), "level"]
    assert rig.inside.threads == {threading.get_ident()}  # not the thread that wanted it: simulations are for one
    assert wall.time - 100.0 == pytest.approx(0.1)  # and the sample was due when it was due
    rig.command(0.05, 0.0)
    assert rig.inside.told[-1] == "level"
    rig.reset(ring=1, theta=0.0, rng=np.random.default_rng(0))
    rig.command(0.02, 0.0)
    assert rig.inside.told[-1] == (0.02, 0.0)


def test_orders_are_done_between_samples_by_the_loops_thread(rig):
    rig.observe()
    done = []
    other = threading.Thread(target=rig.between_samples, args=(lambda: done.append(threading.get_ident()),))
    other.start()
    other.join()
    assert not done
    rig.observe()
    assert done == [threading.get_ident()]
    rig.observe()
    assert len(done) == 1
