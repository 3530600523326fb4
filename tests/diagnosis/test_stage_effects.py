"""Play and dead band of a record against those of the model: each hides in the other."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from mazeplan.diagnosis.stage.comparison import Known, stage_effects
from mazeplan.learning.modelfile import RigModel
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.rig.stage import StageAxis, StageModel

ERRORS = dict.fromkeys(("gain", "dead_time", "backlash", "deadband"), 1e-4) | {
    "natural_frequency": 0.3,
    "damping": 0.01,
}
AXIS = StageAxis(1.0, 24.0, 0.9, stderr=ERRORS)
KNOWN = Known.of_model(RigModel(StageModel(AXIS, AXIS), {1: BallModel(())}, kind="pi"))


def found(**beta):
    stage = SimpleNamespace(axes=(replace(AXIS, **beta), AXIS))
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
