"""A watched rig in this process: each call hangs or raises in turn, and a loop that hangs is answered."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from planar_rig import PlanarRig

from mazeplan.core.errors import RigError, SettingsError
from mazeplan.core.records import Observation
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs import watchdog
from mazeplan.rigs.sim.simulated import SimulatedRig
from mazeplan.rigs.watchdog import WatchedRig, watched

MAZE = load_map("cme")


class Recorded:
    """Notes what it is told, with the thread and the time; `hang` maps a method to an event it waits for."""

    rate_hz = 30.0

    def __init__(self):
        self.told, self.hang, self.raises, self.t = [], {}, {}, 0.0

    def _told(self, name, *values):
        self.told.append((name, threading.get_ident(), time.monotonic(), *values))
        if name in self.raises:
            raise self.raises[name]
        if name in self.hang:
            self.hang[name].wait()

    def reset(self, *, ring, theta, rng):
        self._told("reset", ring, theta)

    def observe(self):
        self._told("observe")
        self.t += 1.0 / 30.0
        return Observation(self.t, 0.08, 0.0, 0.0, 0.0)

    def command(self, u_beta, u_gamma):
        self._told("command", u_beta, u_gamma)
        self.told.append(("tilted", 0, time.monotonic()))

    def level(self):
        self._told("level")

    def close(self):
        self._told("close")

    def names(self):
        return [entry[0] for entry in self.told]

    def when(self, name):
        return next(entry[2] for entry in self.told if entry[0] == name)


@pytest.fixture
def rig(monkeypatch):
    """A rig, watched, placed, with limits short enough for a test; nothing hangs after it."""
    for name, value in (("START_S", 0.1), ("LEVEL_S", 0.15), ("CLOSE_S", 0.15), ("SAMPLES", 6)):
        monkeypatch.setattr(watchdog, name, value)
    inner = Recorded()
    outer = WatchedRig(inner)
    outer.reset(ring=1, theta=0.5, rng=np.random.default_rng(0))
    yield inner, outer
    for event in inner.hang.values():
        event.set()
    inner.hang = {}
    inner.raises = {}
    outer.close()


def test_all_calls_are_in_one_other_thread(rig):
    inner, outer = rig
    assert outer.observe() == Observation(1.0 / 30.0, 0.08, 0.0, 0.0, 0.0)
    outer.command(0.01, -0.02)
    outer.level()
    outer.close()
    outer.close()
    assert inner.names()[:6] == ["reset", "observe", "command", "tilted", "level", "close"]
    assert inner.told[0][3:] == (1, 0.5)
    assert inner.told[2][3:] == (0.01, -0.02)
    threads = {entry[1] for entry in inner.told[:6] if entry[1]}
    assert len(threads) == 1
    assert threading.get_ident() not in threads
    assert outer.reason is None
    assert outer.t == inner.t  # what else a rig has can be asked for


def test_the_plate_is_level_while_the_loop_sleeps(rig):
    inner, outer = rig
    outer.observe()
    time.sleep(0.5)
    assert 0.19 < inner.when("level") - inner.when("observe") < 0.5
    assert outer.reason is not None
    assert "test_watchdog.py:" in outer.reason  # where the loop hangs
    for late in (lambda: outer.command(0.0, 0.0), outer.observe):
        with pytest.raises(RigError, match="no command within"):
            late()
    assert {"command", "tilted"}.isdisjoint(inner.names())  # nothing tilts the plate any more


def test_the_next_reset_works_again_when_no_call_hangs(rig):
    inner, outer = rig
    inner.hang["observe"] = threading.Event()
    for late in (outer.observe, lambda: outer.reset(ring=1, theta=0.0, rng=np.random.default_rng(0))):
        with pytest.raises(RigError, match=r"observe\(\) of the rig did not return within"):
            late()
    inner.hang.pop("observe").set()
    until(lambda: not outer._hangs())
    outer.reset(ring=1, theta=0.0, rng=np.random.default_rng(0))
    outer.observe()
    outer.command(0.0, 0.0)
    outer.close()
    assert outer.reason is None


def test_only_the_time_from_sample_to_command_counts(rig):
    inner, outer = rig
    outer.observe()
    outer.command(0.0, 0.0)
    time.sleep(0.4)
    outer.observe()
    outer.level()
    time.sleep(0.4)
    assert outer.reason is None
    assert inner.names().count("level") == 1


@pytest.mark.parametrize("name", ["observe", "command"])
def test_a_hanging_call_ends_with_a_level_plate(rig, name):
    inner, outer = rig
    inner.hang[name] = threading.Event()
    began = time.monotonic()

    def tick():
        outer.observe()
        outer.command(0.1, 0.1)

    with pytest.raises(RigError, match=rf"watchdog: {name}\(\) of the rig did not return within 0\.\d+ s"):
        tick()
    assert time.monotonic() - began < 1.5
    assert inner.names()[-1] == "level"
    inner.hang[name].set()  # it comes to itself: what it does then is not the last word
    until(lambda: inner.names().count("level") >= 2)
    assert inner.names()[-1] == "level"
    if name == "command":
        assert "tilted" in inner.names()


def until(condition):
    end = time.monotonic() + 3.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_level_that_hangs_is_said_once_and_close_is_tried(rig):
    inner, outer = rig
    inner.hang["level"] = threading.Event()
    began = time.monotonic()
    with pytest.raises(RigError, match=r"^level\(\) of the rig did not return within 0\.15 s"):
        outer.level()
    outer.level()
    outer.close()
    assert time.monotonic() - began < 1.5
    assert "close" in inner.names()


@pytest.mark.parametrize("name", ["observe", "command", "level", "close"])
def test_errors_of_a_rig_become_rig_errors(rig, name):
    inner, outer = rig
    inner.raises[name] = OSError(5, "Input/output error")
    arguments = (0.0, 0.0) if name == "command" else ()
    with pytest.raises(RigError, match=rf"{name}\(\) of the rig raised OSError: .*output error \(.*test_watchdog.py:"):
        getattr(outer, name)(*arguments)
    inner.raises[name] = SettingsError("no such opening")  # what is meant for a person stays as it is
    with pytest.raises(SettingsError, match="no such opening"):
        getattr(outer, name)(*arguments)


def test_simulations_are_not_watched_and_other_rigs_are():
    assert isinstance(watched(SimulatedRig(MAZE)), SimulatedRig)
    assert isinstance(watched(PlanarRig(MAZE)), PlanarRig)
    own = watched(Recorded())  # pyright: ignore
    assert isinstance(own, WatchedRig)
    assert own.timeout_s == 0.2
    assert watched(own) is own
