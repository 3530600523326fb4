"""What a record of a whole rig shows: its length, the part that chooses candidates, and whether the ball has play."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import mazeplan
from mazeplan.core.errors import TableError
from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.rig.fitting import alternate
from mazeplan.diagnosis.rig.record import filter_on_stage, seconds_of, why_not_whole
from mazeplan.diagnosis.rig.search import CHOOSING_S
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")


@pytest.mark.parametrize(("at", "seconds"), [([0.0, 1.0, 2.0, 3.0], 3.0), ([10.0, 11.0, 10.5, 11.5], 1.5)])
def test_the_length_of_a_record_counts_pictures_where_logs_overlap(at, seconds):
    dt = 0.5
    columns = {name: np.linspace(0.0, 0.01, 4) for name in ("x", "y", "beta", "gamma", "u_beta", "u_gamma")}
    record = SimpleNamespace(t=dt * np.arange(4), dt=dt, begins=np.array([True, False, True, False]), u=None, **columns)
    body = filter_on_stage({"t": np.array(at), **columns}, MAZE, None, record=record)
    assert seconds_of(body) == seconds


class Pictures:
    def __init__(self, seconds, rate):
        self.dt, self.count = 1.0 / rate, round(seconds * rate)

    def __len__(self):
        return self.count


@pytest.mark.parametrize(("rate", "seconds", "part"), [(30, 300, 150), (60, 300, 150), (40, 600, 300), (30, 3600, 300)])
def test_candidates_are_chosen_by_five_minutes_of_a_long_record(rate, seconds, part):
    body = SimpleNamespace(pictures=Pictures(seconds, rate), part=lambda rows: rows.sum() / rate)
    assert alternate(body, round(CHOOSING_S * rate)) == pytest.approx(part)


def table_of(rolls, across):
    """Two minutes at 30 Hz; the ball rolls in some samples (N,), `across` m to and fro between the walls."""
    theta = np.cumsum(np.where(rolls, 0.02, 0.0))
    r = 0.09 + across * np.sin(37.0 * theta)
    noise = 2e-4 * np.random.default_rng(0).standard_normal((2, len(theta)))
    still = dict.fromkeys(("beta", "gamma", "u_beta", "u_gamma"), np.zeros(len(theta)))
    t = np.arange(len(theta)) / 30.0
    return Table({"t": t, "x": r * np.cos(theta) + noise[0], "y": r * np.sin(theta) + noise[1], **still})


def test_a_ball_that_is_held_most_of_the_time_still_has_play():
    seldom = np.arange(3600) % 600 < 45
    assert why_not_whole([table_of(seldom, 1.5e-3)]) == ""
    assert "hardly moves between the walls" in why_not_whole([table_of(seldom, 0.0)])


def test_of_a_ball_with_play_a_short_record_is_refused():
    short = table_of(np.ones(800, dtype=bool), 1.5e-3)
    short = Table({**short.columns, "beta": 0.02 * np.sin(0.2 * np.arange(800.0))})
    with pytest.raises(TableError, match="got 800 pictures of the ball, expected 900 at least"):
        mazeplan.diagnose([short], map=MAZE)
