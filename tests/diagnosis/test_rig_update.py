"""The numbers of a model of beads change by as much as those of the rigid ball did."""

from __future__ import annotations

import pytest

from mazeplan.core.constants import FREE_ROLLING
from mazeplan.diagnosis.rig.update import changes_model, moved_model
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.registry import EFFECTS
from mazeplan.physics.rig.entries import part_values

MODEL = RigModel.nominal(load_map("cme"))


def moved(name, before, after, ring=2, stderr=0.01):
    """The model after one effect of a verdict."""
    effect = {
        "name": name,
        "rings": {str(ring): {"before": before, "after": after}},
        "parameters": {key: {"stderr": stderr} for key in after},
    }
    assert changes_model([effect])
    return moved_model(MODEL, [effect], None)


def test_the_inertia_beyond_that_of_a_point_changes_in_proportion():
    own = MODEL.ball(2).parameter("rolling_inertia", "factor", FREE_ROLLING)
    found = moved("rolling_inertia", {"factor": 5 / 7}, {"factor": 3 / 5}).ball(2)
    # 1/factor - 1 is the ball's inertia over m R^2: 2/5 for a solid ball, 2/3 for a hollow one
    assert 1.0 / found.parameter("rolling_inertia", "factor", 0.0) - 1.0 == pytest.approx((1.0 / own - 1.0) * 5 / 3)
    same = moved("rolling_inertia", {"factor": 0.6}, {"factor": 0.6}).ball(2)
    assert same.parameter("rolling_inertia", "factor", 0.0) == pytest.approx(own)


def test_other_numbers_of_the_ball_change_by_their_difference():
    own = MODEL.ball(2).parameter("dry_friction", "coefficient", 0.0)
    found = moved("dry_friction", {"coefficient": 0.9}, {"coefficient": 1.5}).ball(2)
    assert found.parameter("dry_friction", "coefficient", 0.0) == pytest.approx(own + 0.6)


def test_scales_change_by_their_ratio():
    found = moved("tilt_gain", {"beta": 1.1, "gamma": 1.0}, {"beta": 1.32, "gamma": 1.0})
    effect = {
        "name": "tilt_gain",
        "rings": {"1": {"before": {"beta": 1.0, "gamma": 1.0}, "after": {"beta": 1.5, "gamma": 1.0}}},
        "parameters": {},
    }
    twice = moved_model(found, [effect], None)
    gains = [part_values(model, EFFECTS["tilt_gain"])["beta"] for model in (found, twice)]
    assert gains == pytest.approx([1.2, 1.8])


def test_a_bump_too_small_to_matter_is_left_out():
    place = {"centre": 1.0, "width": 0.2}
    flat = moved("surface_bump", {"height": 0.0, **place}, {"height": 1e-4, **place})
    assert flat == MODEL
    high = moved("surface_bump", {"height": 0.0, **place}, {"height": -3.0, **place})
    assert high.ball(2).parameter("surface_bump", "height", 0.0) == -3.0


def test_what_no_model_can_hold_changes_nothing():
    assert not changes_model([{"name": "ball_imbalance"}])
    assert moved_model(MODEL, [{"name": "ball_imbalance", "rings": {}}], None) == MODEL
