"""Play and dead band of a record against those of the model: each hides in the other."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from mazeplan.diagnosis.stage.comparison import NAVIGATION_ERRORS, Known, stage_effects
from mazeplan.learning.modelfile import RigModel
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.rig.stage import StageAxis, StageModel

ERRORS = dict.fromkeys(("gain", "dead_time", "backlash", "deadband"), 1e-4) | {
    "natural_frequency": 0.3,
    "damping": 0.01,
}
AXIS = StageAxis(1.0, 24.0, 0.9, stderr=ERRORS)
KNOWN = Known.of_model(RigModel(StageModel(AXIS, AXIS), {1: BallModel(())}, kind="pi"))


def found(overtaxed=False, **beta):
    stage = SimpleNamespace(axes=(replace(AXIS, **beta), AXIS), servos_overtaxed=overtaxed)
    return {effect["name"]: effect["parameters"] for effect in stage_effects(stage, KNOWN)}


def test_a_stage_as_known_has_no_effects():
    assert found() == {}


@pytest.mark.parametrize("name", ["backlash", "deadband"])
def test_one_that_is_new_is_named_with_its_axis(name):
    effects = found(**{name: 0.01})
    assert set(effects) == {name}
    assert effects[name]["beta"]["value"] == pytest.approx(0.01)


def test_the_smaller_one_counts_only_if_it_is_no_fourth_of_the_larger_one():
    assert set(found(backlash=0.01, deadband=0.002)) == {"backlash"}
    assert set(found(backlash=0.01, deadband=0.004)) == {"backlash", "deadband"}


def test_no_play_is_named_below_its_smallest_size():
    assert found(backlash=5e-4) == {}


def test_overtaxed_servos_show_play_and_coupling_with_larger_errors_and_neither_lag_nor_delay():
    changed = {"natural_frequency": 12.0, "dead_time": 0.05, "deadband": 0.01, "coupling": 0.1}
    errors = {**ERRORS, "coupling": 1e-3}
    assert set(found(**changed, stderr=errors)) == {"servo_lag", "command_delay", "deadband", "axis_coupling"}
    effects = found(overtaxed=True, **changed, stderr=errors)
    assert set(effects) == {"deadband", "axis_coupling"}
    for name, numbers in effects.items():
        assert all(number["stderr"] >= NAVIGATION_ERRORS[name] for number in numbers.values())
