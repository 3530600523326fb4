"""What records of navigation show of the servos, whose lag no linear model describes then."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from mazeplan.diagnosis.document import values_of
from mazeplan.diagnosis.stage import navigation
from mazeplan.diagnosis.stage.comparison import Known
from mazeplan.diagnosis.stage.navigation import (
    gain_in_navigation,
    hidden_gain,
    nearer_tilt,
    servos_look_changed,
)
from mazeplan.learning.modelfile import RigModel
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.rig.stage import StageAxis, StageModel

ERRORS = dict.fromkeys(("gain", "dead_time", "backlash", "deadband"), 1e-4) | {
    "natural_frequency": 0.3, "damping": 0.01, "coupling": 1e-3,
}  # fmt: skip
AXIS = StageAxis(1.0, 24.0, 0.9, stderr=ERRORS)


def known(**beta):
    return Known.of_model(RigModel(StageModel(replace(AXIS, **beta), AXIS), {1: BallModel(())}, kind="pi"))


def seen(gamma=AXIS, **beta):
    return SimpleNamespace(axes=(replace(AXIS, **beta), gamma), servos_overtaxed=True, differs=frozenset())


@pytest.mark.parametrize(
    "beta", [{}, {"natural_frequency": 18.0, "dead_time": 0.02}, {"backlash": 0.001}, {"gain": 0.95}]
)
def test_servos_that_look_as_healthy_ones_do_are_not_told(beta):
    assert servos_look_changed(seen(**beta), known()) == []


def test_what_a_servo_does_is_told_with_its_axis():
    assert servos_look_changed(seen(deadband=0.0087), known()) == ["the servo of beta has play or a dead band"]
    assert servos_look_changed(seen(natural_frequency=14.0), known()) == ["the servo of beta is slower"]


def test_commands_are_later_only_if_they_are_later_on_both_axes():
    assert servos_look_changed(seen(dead_time=0.06), known()) == []
    both = seen(gamma=replace(AXIS, dead_time=0.07), dead_time=0.06)
    assert servos_look_changed(both, known()) == ["the plate follows commands later"]


def test_known_play_that_looks_like_a_smaller_dead_band_is_no_news():
    assert servos_look_changed(seen(deadband=0.007), known(backlash=0.0175)) == []


def changed_gain(monkeypatch, better, was=None, **beta):
    monkeypatch.setattr(navigation, "nearer_tilt", lambda *arguments: better)
    return gain_in_navigation(SimpleNamespace(), seen(**beta), was or known())


def test_a_clear_gain_is_told_for_servo_and_sensor_with_the_error_that_overtaxed_servos_cause(monkeypatch):
    servo, sensor = changed_gain(monkeypatch, 2.1, gain=0.85)
    assert (servo["name"], sensor["name"]) == ("servo_gain", "tilt_gain")
    assert values_of(servo) == pytest.approx({"beta": 0.85, "gamma": 1.0})
    assert servo["parameters"]["beta"]["stderr"] == pytest.approx(navigation.GAIN_ERROR, rel=1e-3)


@pytest.mark.parametrize(
    ("better", "was", "beta"),
    [
        (1.9, {}, {"gain": 0.85}),
        (9.0, {}, {"gain": 0.94}),
        (9.0, {}, {"gain": 0.85, "deadband": 0.005}),
        (9.0, {"backlash": 0.0175}, {"gain": 0.85}),
    ],
)
def test_a_gain_is_not_told_if_the_tilt_does_not_agree_it_is_small_or_play_hides_it(monkeypatch, better, was, beta):
    assert changed_gain(monkeypatch, better, known(**was), **beta) == (None, None)
    assert hidden_gain(seen(**beta), known(**was)) == ("deadband" in beta or "backlash" in was)


def test_held_out_tilt_shows_a_coupling():
    rng, dt, lag = np.random.default_rng(1), 1.0 / 30.0, 3  # a plate that follows `lag` samples late
    u = np.repeat(rng.uniform(-0.08, 0.08, (300, 2)), 6, axis=0)
    late = np.roll(u, lag, axis=0)
    noise = rng.normal(0.0, 2e-3, u.shape)
    record = SimpleNamespace(
        u=u, dt=dt, beta=late[:, 0] + 0.1 * late[:, 1] + noise[:, 0], gamma=late[:, 1] + noise[:, 1]
    )
    record = type("Record", (SimpleNamespace,), {"__len__": lambda self: len(self.u)})(**vars(record))
    assert nearer_tilt(record, seen(), (0.0, 0.0), True) > 5.0
    assert nearer_tilt(record, seen(), (0.1, 0.0), True) < 2.0
