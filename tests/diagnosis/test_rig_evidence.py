"""What the page of a whole rig is drawn from."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from mazeplan.control.estimation.rigid_body_filter import BodyModel
from mazeplan.diagnosis.rig.evidence import SECTORS, _block_times, _by_place, _marks, _power
from mazeplan.diagnosis.rig.record import filter_of, seconds_of
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.effect import Term
from mazeplan.physics.effects.local_forces import floor_bump

MAZE = load_map("cme")


def test_white_noise_has_power_one_and_a_swing_a_peak_at_its_frequency():
    t = np.sort(np.random.default_rng(1).uniform(0.0, 100.0, 3000))
    e = np.random.default_rng(2).standard_normal((3000, 2))
    hz = np.arange(0.1, 5.0, 0.005)
    assert _power(hz, t, e).mean() == pytest.approx(1.0, abs=0.1)
    swings = _power(hz, t, e + np.sin(2.0 * math.pi * 0.7 * t)[:, None])
    assert hz[np.argmax(swings)] == pytest.approx(0.7, abs=0.006)


def test_an_error_stands_where_the_ball_was_half_way():
    radius, angle = MAZE.track_radius(2), math.radians(100.0)
    state = np.zeros((200, 5))
    state[:, :2] = radius * math.cos(angle), radius * math.sin(angle)
    state[:8, :2] = 0.0, -radius  # where the ball starts, not half way
    starts = np.array([0, 7, 14, 21])
    errors = np.full((40, 4), 0.1)
    done = SimpleNamespace(
        held=SimpleNamespace(starts=starts, before=errors, after=0.0 * errors),
        searched=SimpleNamespace(without=SimpleNamespace(filtered=SimpleNamespace(state=state))),
    )
    places = _by_place(done, MAZE)  # pyright: ignore
    row = next(i for i, (inner, outer) in enumerate(places["rings"]) if inner < radius < outer)
    sector = int((angle + math.pi) / (2.0 * math.pi) * SECTORS)
    assert places["before"][row][sector] == pytest.approx(0.1 * radius, abs=1e-5)
    assert places["after"][row][sector] == 0.0
    assert sum(v is not None for ring in places["before"] for v in ring) == 1


def test_a_bump_that_was_found_has_a_place_and_other_effects_none():
    model = BodyModel(terms=(Term(floor_bump, (0.04, -0.06, 0.001, 0.012)),))
    (mark,) = _marks(({"name": "dry_friction"}, {"name": "surface_bump"}), model)
    assert mark == {"name": "surface_bump", "x": 0.04, "y": -0.06, "width": 0.012}


@pytest.mark.parametrize(("at", "seconds"), [([0.0, 1.0, 2.0, 3.0], 3.0), ([10.0, 11.0, 10.5, 11.5], 1.5)])
def test_the_length_of_a_record_counts_pictures_where_logs_overlap(at, seconds):
    dt = 0.5
    columns = {name: np.linspace(0.0, 0.01, 4) for name in ("x", "y", "beta", "gamma", "u_beta", "u_gamma")}
    record = SimpleNamespace(
        t=dt * np.arange(4), dt=dt, begins=np.array([True, False, True, False]), u=None, **columns, segment=np.ones(4)
    )
    body = filter_of({"t": np.array(at), **columns}, record, MAZE, None)
    assert seconds_of(body) == seconds


def test_blocks_stand_at_their_true_time():
    t = np.arange(900) / 30.0
    pictures = SimpleNamespace(t=t, clock=100.0 + 2.0 * t, dt=1 / 30)
    assert _block_times(pictures, 3) == [10.0, 30.0, 50.0]  # pyright: ignore
