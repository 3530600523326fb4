"""From tables to samples: where stretches end, what is taken, what is computed; expectations are worked out here."""

from __future__ import annotations

import numpy as np
import pytest
from ring_record import DT, RADII
from sample_columns import MAZE, NUDGE, N, columns, samples_of

from mazeplan.core.logs.table import Table
from mazeplan.learning.samples import (
    SampleOptions,
    columns_of,
    joined,
    ring_samples,
)
from mazeplan.learning.smoothing import Smoothing, derivatives


def changed(name, value, at):
    """The record's column with another value in some rows."""
    column = columns()[name].copy()
    column[at] = value
    return column


INTERRUPTIONS = {
    "the ball goes to another ring": {"ring": changed("ring", 3.0, slice(30, None))},
    "the ball is not seen": {"theta": changed("theta", np.nan, 30)},
    "time jumps": {"t": columns()["t"] + 0.5 * (np.arange(N) >= 30)},
    "a segment ends": {"segment": (np.arange(N) >= 30).astype(float)},
    "the ball is in no ring": {"ring": changed("ring", 0.0, 30)},
}


@pytest.mark.parametrize("why", INTERRUPTIONS)
def test_what_ends_a_stretch(why):
    found = ring_samples(Table(columns(**INTERRUPTIONS[why])), MAZE)
    two = found[2] if 3 not in found else joined([found[2], found[3]])
    gap = why in ("the ball is not seen", "the ball is in no ring")
    assert two.segment.tolist() == [0] * 30 + [1] * (29 if gap else 30)
    if 3 not in found:
        assert two.row.tolist() == [row for row in range(N) if not (gap and row == 30)]
    # Savitzky and Golay over 7 samples: three at each end of a stretch have no acceleration
    borders = [0, 1, 2, 27, 28, 29, 30, 31, 32, *(range(len(two) - 3, len(two)))]
    assert np.flatnonzero(~two.good).tolist() == borders
    assert np.isnan(two.theta_ddot[borders]).all()


def test_theta_is_unwrapped_in_its_stretch():
    turning = 2.0 * columns()["t"] + 3.0  # once past pi
    wrapped = np.arctan2(np.sin(turning), np.cos(turning))
    assert np.abs(np.diff(wrapped)).max() > 6.0
    whole = samples_of(theta=wrapped)
    assert whole.measured == pytest.approx(turning)
    assert np.nanmax(np.abs(whole.k.theta_dot - 2.0)) < 1e-9
    assert np.nanmax(np.abs(whole.theta_ddot)) < 1e-7
    parts = samples_of(theta=wrapped, segment=(np.arange(N) >= 40).astype(float))
    assert parts.measured[40:] == pytest.approx(wrapped[40:])  # anew in the next one


# --- rings and radii


def test_the_ring_is_that_of_the_column():
    found = ring_samples(Table(columns(ring=np.repeat([1.0, 4.0], 30))), MAZE)
    assert sorted(found) == [1, 4]
    assert [found[ring].ring for ring in (1, 4)] == [1, 4]


def test_the_ring_is_told_by_radius_and_map_with_the_ball_in_the_channel():
    # on the track of ring 1; in the wall between 1 and 2; on the track of ring 2; in the disc
    r = np.repeat([RADII[1], 0.079, RADII[2], 0.005], 15)
    found = ring_samples(Table(columns(ring=None, r=r)), MAZE)
    assert {ring: part.row.tolist() for ring, part in found.items()} == {
        1: list(range(15)),
        2: list(range(30, 45)),
    }
    # where the column says otherwise nothing is taken
    found = ring_samples(Table(columns(ring=np.full(N, 2.0), r=r)), MAZE)
    assert sorted(found) == [2]
    assert found[2].row.tolist() == list(range(30, 45))


def test_the_ring_given_is_that_of_all_rows_where_the_table_does_not_tell():
    found = ring_samples(Table(columns(ring=None)), MAZE, options=SampleOptions(ring=3))
    assert list(found) == [3]
    assert len(found[3]) == N
    assert found[3].k.radius == pytest.approx(RADII[3])
    other = Table(columns(ring=None, r=np.full(N, 0.2)))  # a radius that is given says that the map is another
    assert len(ring_samples(other, MAZE, options=SampleOptions(ring=3, radius=0.2))[3]) == N


@pytest.mark.parametrize("radius", [None, 0.03])
def test_the_ring_given_is_the_only_one_where_the_table_tells(radius):
    ring = np.repeat([1.0, 4.0], 30)
    options = SampleOptions(ring=4, radius=radius)
    for more in ({"ring": ring}, {"ring": ring, "r": np.repeat([RADII[1], RADII[4]], 30)}):
        found = ring_samples(Table(columns(**more)), MAZE, options=options)
        assert list(found) == [4]
        assert found[4].row.tolist() == list(range(30, 60))
    by_radius = Table(columns(ring=None, r=np.repeat([RADII[1], RADII[4]], 30)))
    if radius is None:
        assert ring_samples(by_radius, MAZE, options=options)[4].row.tolist() == list(range(30, 60))


def test_the_radius_is_the_maps_the_one_given_or_the_median():
    assert samples_of().k.radius == pytest.approx(RADII[2])
    assert samples_of(options=SampleOptions(radius=0.061)).k.radius == 0.061
    r = np.concatenate([np.full(40, 0.07), np.full(20, np.nan)])
    assert samples_of(None, r=r).k.radius == pytest.approx(0.07)
    assert samples_of(None, r=r, options=SampleOptions(radius=0.061)).k.radius == 0.061
    assert ring_samples(Table(columns(ring=np.full(N, 8.0), r=r)), None, options=SampleOptions(ring=8))[
        8
    ].k.radius == pytest.approx(0.07)


# --- derivatives


def test_derivatives_that_the_table_brings_are_taken_as_they_are():
    rng = np.random.default_rng(3)
    names = [f"{angle}_{order}" for angle in ("theta", "beta", "gamma") for order in ("dot", "ddot")]
    given = {name: rng.standard_normal(N) for name in names}
    given["theta_ddot"][7] = np.nan
    found = samples_of(**given)
    for name in names:
        column = found.theta_ddot if name == "theta_ddot" else getattr(found.k, name)
        assert np.array_equal(column, given[name], equal_nan=True)
    assert np.array_equal(found.k.theta, found.measured)
    assert np.flatnonzero(~found.good).tolist() == [7]
    anew = samples_of(**given, options=SampleOptions(recompute=True))
    plain = samples_of()
    for name in columns_of(plain.k):
        assert np.array_equal(getattr(anew.k, name), getattr(plain.k, name), equal_nan=True)
    assert np.array_equal(anew.theta_ddot, plain.theta_ddot, equal_nan=True)


@pytest.mark.slow
@pytest.mark.parametrize("smoothing", [Smoothing(), Smoothing("rts", model="snap"), Smoothing(window=9, order=4)])
def test_what_is_missing_is_computed_with_the_smoothing_chosen(smoothing):
    found, plain = samples_of(smoothing=smoothing), columns()
    for name, found_rate, found_acceleration in (
        ("theta", found.k.theta_dot, found.theta_ddot),
        ("beta", found.k.beta_dot, found.k.beta_ddot),
        ("gamma", found.k.gamma_dot, found.k.gamma_ddot),
    ):
        d = derivatives(plain[name], DT, smoothing)
        assert found_rate == pytest.approx(d.rate, nan_ok=True, rel=1e-6, abs=1e-9)
        assert found_acceleration == pytest.approx(d.acceleration, nan_ok=True, rel=1e-6, abs=1e-8)
    t = plain["t"][5:-5]
    assert found.k.theta_dot[5:-5] == pytest.approx(0.8 * np.cos(2.0 * t), abs=0.01)
    assert found.theta_ddot[5:-5] == pytest.approx(-1.6 * np.sin(2.0 * t), abs=0.03)


# --- the camera is late


def test_the_tilt_is_taken_as_much_earlier_as_the_camera_is_late():
    plain, late = samples_of(), samples_of(options=SampleOptions(delay=2.0 * DT - NUDGE))
    for name in ("beta", "gamma", "beta_dot", "gamma_dot", "beta_ddot", "gamma_ddot"):
        a, b = getattr(plain.k, name), getattr(late.k, name)
        assert b[6:-6] == pytest.approx(a[4:-8], abs=1e-7)  # where both have derivatives
        assert np.isnan(b[:2]).all()
    for name in ("theta", "theta_dot"):
        assert np.array_equal(getattr(plain.k, name), getattr(late.k, name), equal_nan=True)
    ramp = 0.1 * columns()["t"]
    between = samples_of(beta=ramp, options=SampleOptions(delay=0.05))  # a sample and a half: interpolated
    assert between.k.beta[2:] == pytest.approx(ramp[2:] - 0.005)


# --- rates


def test_delayed_rates_are_differences_of_samples_before_those_of_the_target():
    theta = np.random.default_rng(5).uniform(-0.3, 0.3, N)
    segment = (np.arange(N) >= 25).astype(float)
    found = samples_of(theta=theta, segment=segment, options=SampleOptions(rates="delayed"))
    for k in range(N):
        first = 0 if k < 25 else 25
        if k - 3 < first:
            assert np.isnan(found.k.theta_dot[k])
            assert not found.good[k]
        else:
            assert found.k.theta_dot[k] == pytest.approx((theta[k - 2] - theta[k - 3]) / DT)
