"""The environment with rigs that run in real time, under a watchdog."""

from __future__ import annotations

import time

import gymnasium
import numpy as np
import pytest

import mazeplan.apps.environment as room
from mazeplan.core.errors import RigError
from mazeplan.core.records import Observation
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")


class Table:
    """A rig in real time, at 100 samples a second. The ball rests in ring 1."""

    rate_hz = 100.0
    seen = True

    def __init__(self, maze, settings):
        self.told, self.samples, self.levels = [], 0, True

    def reset(self, *, ring, theta, rng):
        self.told.append("reset")
        self.samples = 0

    def observe(self):
        self.samples += 1
        x, y = (MAZE.track_radius(1), 0.0) if self.seen else (None, None)
        return Observation((self.samples - 1) / self.rate_hz, x, y, 0.0, 0.0)

    def command(self, u_beta, u_gamma):
        self.told.append("command")

    def level(self):
        self.told.append("level")
        if not self.levels:
            raise RigError("the board does not confirm that the plate is level")

    def close(self):
        self.told.append("close")


STILL = np.zeros(2, dtype=np.float32)
PAUSE_S = 0.3  # s, longer than the watchdog waits for a command


@pytest.fixture
def played():
    """Makes an environment that is reset, and the rig in it."""
    made = []

    def make():
        made.append(gymnasium.make(room.ID, rig=f"{__name__}:Table"))
        made[-1].reset(seed=0)
        return made[-1], made[-1].unwrapped.rig

    yield make
    for env in made:
        env.close()


@pytest.mark.realtime
def test_a_pause_within_an_episode_levels_the_plate(played):
    env, rig = played()
    env.step(STILL)
    time.sleep(PAUSE_S)  # nothing is raised here
    assert rig.told[-2:] == ["command", "level"]
    for _ in range(2):
        with pytest.raises(RigError, match=r"no command within 0\.2 s of the sample at t = 0\.010 s"):
            env.step(STILL)
    assert rig.told[-1] == "level"
    env.reset()
    env.step(STILL)
    assert rig.told[-3:] == ["reset", "level", "command"]


def test_a_rig_that_cannot_level_is_closed_all_the_same(played):
    env, rig = played()
    rig.inside.levels = False
    env.close()
    assert rig.told[-1] == "close"


@pytest.mark.realtime
def test_the_plate_is_level_after_an_episode(played):
    env, rig = played()
    rig.inside.seen, ended = False, False
    while not ended:
        _, _, ended, _, _ = env.step(STILL)
    assert rig.told[-1] == "level"
    time.sleep(PAUSE_S)
    assert rig.reason is None
