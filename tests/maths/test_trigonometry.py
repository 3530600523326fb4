"""Sine and cosine of small angles beside the library's."""

from __future__ import annotations

import numpy as np

from mazeplan.core.maths.trigonometry import SMALL, sine_and_cosine


def test_they_are_those_of_the_library():
    for x in np.linspace(-4.0, 4.0, 4001):
        np.testing.assert_allclose(sine_and_cosine(x), (np.sin(x), np.cos(x)), rtol=0.0, atol=1e-15)


def test_they_are_good_to_the_last_digits_where_the_series_ends():
    for x in (0.0, 1e-300, 0.0873, np.nextafter(SMALL, 0.0), -np.nextafter(SMALL, 0.0), SMALL):
        np.testing.assert_allclose(sine_and_cosine(x), (np.sin(x), np.cos(x)), rtol=2e-15, atol=0.0)


def test_what_is_not_a_number_stays_so():
    assert np.isnan(sine_and_cosine(np.nan)).all()
