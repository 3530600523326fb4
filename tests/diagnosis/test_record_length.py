"""The length of a record of a whole rig."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mazeplan.diagnosis.rig.record import filter_of, seconds_of
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")


@pytest.mark.parametrize(("at", "seconds"), [([0.0, 1.0, 2.0, 3.0], 3.0), ([10.0, 11.0, 10.5, 11.5], 1.5)])
def test_the_length_of_a_record_counts_pictures_where_logs_overlap(at, seconds):
    dt = 0.5
    columns = {name: np.linspace(0.0, 0.01, 4) for name in ("x", "y", "beta", "gamma", "u_beta", "u_gamma")}
    record = SimpleNamespace(
        t=dt * np.arange(4), dt=dt, begins=np.array([True, False, True, False]), u=None, **columns, segment=np.ones(4)
    )
    body = filter_of({"t": np.array(at), **columns}, record, MAZE, None)
    assert seconds_of(body) == seconds
