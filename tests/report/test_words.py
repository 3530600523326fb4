"""Words, units and signs of reports."""

from __future__ import annotations

import math

import pytest

from mazeplan.apps.report import words
from mazeplan.diagnosis.ring.system import ring_library


def test_an_angle_is_in_degrees_with_its_error_and_a_speed_is_not():
    assert words.measured(math.radians(2.0), math.radians(0.25), "rad") == "2.00\u00a0±\u00a00.25\u00a0deg"
    assert words.measured(12.345, 1.3, "rad/s^2") == "12.3\u00a0±\u00a01.3\u00a0rad/s²"
    assert words.measured(0.6371, 0.0131, "1") == "0.637\u00a0±\u00a00.013"
    assert words.measured(123.4, 20.0, "s") == "123\u00a0±\u00a020\u00a0s"


def test_a_label_and_its_value_change_unit_together():
    for label, shown in (("error after 40 samples, rad", "error after 40 samples, degrees"),
                         ("theta, rad", "angle of the ball, degrees")):  # fmt: skip
        assert words.relabelled(label) == shown
        assert words.labelled(math.pi, label) == pytest.approx(180.0)
    for label in ("theta_dot, rad/s", "position, m", "relative force error"):
        assert words.labelled(2.0, label) == 2.0
    assert words.relabelled("position, m") == "position, m"


def test_every_effect_and_parameter_of_the_library_has_words():
    for effect in ring_library():
        told = [words.spoken(effect.name), *(words.parameter(effect.name, name) for name in effect.parameters)]
        assert not [text for text in told if "_" in text]
