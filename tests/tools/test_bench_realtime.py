"""A simulated rig whose world goes on while the program computes."""

from __future__ import annotations

from time import sleep

import numpy as np
import pytest
from bench_realtime import PERIOD_MS, Table

from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig


@pytest.fixture
def table():
    ticks: list[float] = []
    table = Table(make_rig("ideal", load_map("cme")), ticks)
    table.reset(ring=1, theta=0.3, rng=np.random.default_rng(1))
    yield table, ticks
    table.close()


def test_samples_that_came_while_the_program_computed_are_lost(table):
    rig, ticks = table
    first = rig.observe()
    sleep(2.5e-3 * PERIOD_MS)
    rig.command(0.01, 0.0)
    after = rig.observe()
    lost = int(ticks[0] / PERIOD_MS)
    assert lost >= 2
    assert after.t - first.t == pytest.approx(1e-3 * PERIOD_MS * (lost + 1), abs=1e-6)


@pytest.mark.slow
def test_every_twentieth_picture_is_an_old_one(table):
    rig, _ = table
    seen = []
    for _ in range(60):
        seen.append(rig.observe())
        rig.command(0.02, 0.02)  # the ball rolls: no two places are equal
    places = [(sample.x, sample.y) for sample in seen]
    again = [k for k in range(3, 60) if places[k] in places[:k]]
    assert 1 <= len(again) <= 10
    assert all(np.diff([sample.t for sample in seen]) > 0.0)
