"""Sizes of effects in words."""

from __future__ import annotations

import math

import pytest

from mazeplan.diagnosis.ring.result import effect_words


@pytest.mark.parametrize(
    ("stderr", "unit", "words"),
    [
        (0.0123, "rad/s^2", "dry friction (coefficient 0.4 +- 0.012 rad/s^2)"),
        (0.0123, "1", "dry friction (coefficient 0.4 +- 0.012)"),
        (math.inf, "rad", "dry friction (coefficient 0.4 rad)"),
        (math.nan, "1", "dry friction (coefficient 0.4)"),
        (None, "rad", "dry friction (coefficient 0.4 rad)"),
    ],
)
def test_what_is_not_known_is_not_written(stderr, unit, words):
    parameter = {"value": 0.4, "stderr": stderr, "unit": unit}
    assert effect_words({"name": "dry_friction", "parameters": {"coefficient": parameter}}) == words
