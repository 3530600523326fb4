from __future__ import annotations

import math

import numpy as np
import pytest

from mazeplan.core.maths.angles import difference, nearest, place_deg, wrap

TURN = 2.0 * math.pi


def angles(count, spread, seed):
    return np.random.default_rng(seed).uniform(-spread, spread, count).tolist()


def same_direction(a, b):
    return math.hypot(math.cos(a) - math.cos(b), math.sin(a) - math.sin(b)) < 1e-12


@pytest.mark.parametrize("spread", [1.0, 4.0, 100.0])
def test_wrapping_keeps_the_direction_and_stays_within_half_a_turn(spread):
    for angle in angles(500, spread, 1):
        wrapped = wrap(angle)
        assert -math.pi <= wrapped < math.pi
        assert same_direction(wrapped, angle)


def test_an_angle_within_half_a_turn_stays():
    for angle in angles(500, math.pi, 2):
        assert wrap(angle) == pytest.approx(angle, abs=1e-15)
    assert wrap(0.0) == 0.0


@pytest.mark.parametrize("turns", [-3, -2, -1, 0, 1, 2])
def test_half_a_turn_is_the_lower_end(turns):
    assert wrap(math.pi + turns * TURN) == pytest.approx(-math.pi, abs=1e-14)


def test_known_differences():
    assert difference(0.3, 0.1) == pytest.approx(0.2)
    assert difference(0.1, 0.3) == pytest.approx(-0.2)
    assert difference(-3.1, 3.1) == pytest.approx(TURN - 6.2)  # across the seam, the short way
    assert difference(3.1, -3.1) == pytest.approx(6.2 - TURN)


def test_a_difference_is_the_shortest_turn_from_b_to_a():
    for a, b in zip(angles(500, 20.0, 3), angles(500, 20.0, 4), strict=True):
        turn = difference(a, b)
        assert -math.pi <= turn < math.pi
        assert same_direction(b + turn, a)
        assert difference(b, a) == pytest.approx(-turn, abs=1e-12)


def test_the_nearest_differs_by_whole_turns():
    for angle, reference in zip(angles(500, 20.0, 5), angles(500, 20.0, 6), strict=True):
        near = nearest(angle, reference)
        assert abs(near - reference) <= math.pi + 1e-12
        turns = (near - angle) / TURN
        assert turns == pytest.approx(round(turns), abs=1e-12)


def test_the_nearest_follows_a_ball_over_many_turns():
    travelled = np.linspace(0.0, 5.0 * TURN, 400)
    angle = 0.0
    for exact in travelled:
        angle = nearest(wrap(float(exact)), angle)
    assert angle == pytest.approx(5.0 * TURN, abs=1e-12)


@pytest.mark.parametrize(
    ("angle", "places", "degrees"),
    [(-math.pi / 2, 0, 270.0), (7.0 * math.pi, 0, 180.0), (-1e-12, 9, 0.0), (math.radians(359.97), 1, 0.0),
     (math.radians(-0.04), 2, 359.96), (math.radians(45.0), 9, 45.0)],
)  # fmt: skip
def test_a_place_on_a_ring_is_read_in_degrees_from_0_to_below_360(angle, places, degrees):
    assert place_deg(angle, places) == degrees
