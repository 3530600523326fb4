"""Samples of several records, and of a tilt that is counted the other way round."""

from __future__ import annotations

import numpy as np
import pytest
from ring_record import ring_table
from sample_columns import MAZE, N, samples_of

from mazeplan.core.logs.table import Table
from mazeplan.learning.samples import (
    MatchedKinematics,
    SampleOptions,
    columns_of,
    joined,
    orientation,
    oriented,
    ring_samples,
)
from mazeplan.learning.smoothing import Smoothing

# --- which way the tilt is counted


@pytest.mark.slow
@pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_a_tilt_that_is_counted_the_other_way_round_is_found(signs):
    table = ring_table((1, 3), 20.0)
    table = Table({**table.columns, "beta": signs[0] * table["beta"], "gamma": signs[1] * table["gamma"]}, table.source)
    for rates in ("smoothed", "delayed"):
        found = ring_samples(table, MAZE, Smoothing("rts", model="snap"), SampleOptions(rates=rates))
        assert orientation(found) == signs


def test_noise_and_a_resting_plate_turn_nothing_round():
    rng = np.random.default_rng(8)
    noise = samples_of(beta=0.01 * rng.standard_normal(N), gamma=0.01 * rng.standard_normal(N))
    assert orientation({2: noise}) == (1, 1)
    unknown = samples_of(options=SampleOptions(delay=100.0))  # the tilt is never known
    assert not unknown.good.any()
    assert orientation({2: unknown}) == (1, 1)
    level = samples_of(beta=np.zeros(N), gamma=np.zeros(N))
    assert orientation({2: level}) == (1, 1)


def test_oriented_turns_an_axis_with_all_it_has():
    found = samples_of(options=SampleOptions(rates="delayed"))
    turned = oriented(found, (-1, 1))
    for name in columns_of(found.k):
        sign = -1.0 if name.startswith("beta") else 1.0
        assert np.array_equal(getattr(turned.k, name), sign * getattr(found.k, name), equal_nan=True)
    assert isinstance(turned.k, MatchedKinematics)
    assert np.array_equal(turned.theta_ddot, found.theta_ddot, equal_nan=True)


# --- several records


def test_joined_keeps_stretches_and_records_apart():
    first = samples_of(segment=(np.arange(N) >= 30).astype(float))
    second = samples_of(n=20, theta=np.linspace(0.0, 1.0, 20))
    both = joined([first, second])
    assert both.segment.tolist() == [0] * 30 + [1] * 30 + [2] * 20
    assert (np.diff(both.row) > 0).all()
    assert len(both) == len(both.row) == len(both.good) == 80
    for name in columns_of(both.k):
        expected = np.concatenate([getattr(first.k, name), getattr(second.k, name)])
        assert np.array_equal(getattr(both.k, name), expected, equal_nan=True)
    for name in ("theta_ddot", "measured"):
        expected = np.concatenate([getattr(first, name), getattr(second, name)])
        assert np.array_equal(getattr(both, name), expected, equal_nan=True)
    assert (both.ring, both.dt) == (first.ring, first.dt)
    assert joined([first]) is first
