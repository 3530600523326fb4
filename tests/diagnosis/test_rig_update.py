"""The numbers of a model of beads change by as much as those of the rigid ball did."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from mazeplan.control.estimation.rigid_body_filter import BodyModel
from mazeplan.control.estimation.rigid_body_fit import bead_values, with_body, with_values
from mazeplan.core.constants import FREE_ROLLING
from mazeplan.diagnosis.rig.imbalance import BALANCED, Imbalance
from mazeplan.diagnosis.rig.reference import reference_by_model
from mazeplan.diagnosis.stage.comparison import Known
from mazeplan.diagnosis.update import kept_in_model, moved_model, reference_after
from mazeplan.learning.modelfile import RigModel
from mazeplan.learning.rig_model import part_stderr, part_values
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.effects.ball import constant_torque, quadratic_drag, surface_profile
from mazeplan.physics.effects.local_forces import drag_drift, floor_bump, table_swing
from mazeplan.physics.registry import EFFECTS

MODEL = RigModel.nominal(load_map("cme"))


def moved(name, before, after, ring=2, stderr=0.01, model=MODEL):
    """The model after one effect of a verdict."""
    effect = {
        "name": name,
        "rings": {str(ring): {"before": before, "after": after}},
        "parameters": {key: {"stderr": stderr} for key in after},
    }
    assert kept_in_model([effect])
    return moved_model(model, [effect], None)


def with_terms(*terms, ring=2):
    """The model with further effects in a ring."""
    ball = MODEL.ball(ring)
    return replace(MODEL, balls={**MODEL.balls, ring: replace(ball, effects=(*ball.effects, *terms))})


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


@pytest.mark.parametrize("had", [0.0, 0.05])
def test_an_effect_that_the_reference_lacks_is_not_added_to_that_of_the_model(had):
    model = with_terms(constant_torque(0.2), surface_profile(cos1=0.4, cos2=0.3))
    found = moved("constant_torque", {"acceleration": had}, {"acceleration": 0.25}, model=model).ball(2)
    assert found.parameter("constant_torque", "acceleration", 0.0) == pytest.approx(0.25 + (0.15 if had else 0.0))
    drag = moved("quadratic_drag", {"coefficient": had}, {"coefficient": 0.25}, model=with_terms(quadratic_drag(0.2)))
    assert drag.ball(2).parameter("quadratic_drag", "coefficient", 0.0) == pytest.approx(0.25 + (0.15 if had else 0.0))
    waves = dict.fromkeys(surface_profile.parameters, 0.0)
    found = moved("surface_profile", waves | {"cos2": had}, waves | {"cos2": 0.35}, model=model).ball(2)
    assert found.parameter("surface_profile", "cos2", 0.0) == pytest.approx(0.35 + (0.25 if had else 0.0))
    assert found.parameter("surface_profile", "cos1", 0.0) == 0.4, "nothing was found out about it"


def test_drag_of_the_model_is_in_its_reference():
    model = with_terms(quadratic_drag(0.3))
    body = reference_by_model(model, load_map("cme")).body.model.ball
    (drag,) = bead_values(model, load_map("cme"), "quadratic")
    assert body.quadratic == pytest.approx(drag)
    assert reference_by_model(MODEL, load_map("cme")).body.model.ball.quadratic == 0.0


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


@pytest.mark.parametrize(
    ("name", "numbers"),
    [("sensor_delay", {"delay": 0.05}), ("command_delay", {"delay": 0.02}), ("camera_scale", {"factor": 1.05}),
     ("servo_gain", {"beta": 1.1, "gamma": 0.9})],
)  # fmt: skip
def test_one_estimate_for_all_rings_is_as_sure_as_it_was(name, numbers):
    both = {"before": numbers, "after": numbers}
    effect = {"name": name, "rings": dict.fromkeys("1234", both)}
    effect["parameters"] = {key: {"stderr": 0.01} for key in numbers}
    new = moved_model(MODEL, [effect], None)
    assert part_stderr(new, EFFECTS[name]) == pytest.approx(dict.fromkeys(numbers, 0.01))


def test_the_lean_of_the_table_is_as_sure_in_a_model_as_it_was_found():
    lean = {"before": {"beta": 0.0, "gamma": 0.0}, "after": {"beta": 0.01, "gamma": 0.02}}
    effect = {"name": "tilt_offset", "rings": dict.fromkeys("1234", lean)}
    effect["parameters"] = {key: {"stderr": 1e-3} for key in ("beta", "gamma")}
    new = moved_model(MODEL, [effect], None)
    for ring in MODEL.balls:
        assert new.ball(ring).parameter("tilt_offset", "gamma", 0.0) == pytest.approx(0.02)
        assert new.ball(ring).stderr["tilt_offset"] == {"beta": 1e-3, "gamma": 1e-3}


SWINGS = table_swing(frequency=0.7, bs=0.01)
DRIFTS = drag_drift(rate=1e-3, start=0.05)


HEAVY = Imbalance(0.1, 0.01, 8.0, 200.0)


def verdict(*terms, effects=(), imbalance=BALANCED):
    """A verdict on 200 s whose fit has these terms."""
    fit = SimpleNamespace(
        model=with_values(BodyModel(), {"viscous": 0.1})._replace(terms=terms),
        stderr={"drag_drift.rate": 1e-4, "drag_drift.start": 0.01, "rolling": 1e-3},
    )
    stage, clock = Known.of_model(MODEL), np.arange(201.0)
    was = SimpleNamespace(body=SimpleNamespace(stderr={"viscous": 0.02}), stage=stage, imbalance=HEAVY)
    body = SimpleNamespace(pictures=SimpleNamespace(t=clock, clock=clock))
    return SimpleNamespace(
        searched=SimpleNamespace(fit=fit), was=was, memory=0.0, remaining=1.0, effects=effects, imbalance=imbalance,
        zero={}, plate=SimpleNamespace(body=body, moves=None, sensor=None, table=None),
    )  # fmt: skip


def test_the_next_reference_is_the_ball_at_the_end_of_the_record():
    next_one = reference_after(verdict(SWINGS, DRIFTS, floor_bump(x=0.05, depth=0.01))).body
    assert [term.name for term in next_one.model.terms] == ["floor_bump"], "what swings has another phase then"
    assert next_one.model.ball.viscous == pytest.approx(0.1 + 0.05 + 0.2)
    assert next_one.stderr == {"viscous": 0.01, "rolling": 1e-3}


@pytest.mark.parametrize("now", [BALANCED, HEAVY._replace(size=0.2)])
def test_an_imbalance_is_no_news_afterwards(now):
    """Nor is one that was known before, in a record that does not show it."""
    assert reference_after(verdict(imbalance=now)).imbalance == max(now, HEAVY)


def test_a_body_in_the_model_has_the_friction_of_the_end_of_the_record():
    model = with_body(MODEL, BodyModel(), {})
    drift = {"before": {"rate": 0.0, "start": 0.0}, "after": DRIFTS.values()}
    effect = {"name": "friction_drift", "rings": {"2": drift}, "until_s": 200.0}
    effect["parameters"] = {"rate": {"stderr": 1e-4}, "start": {"stderr": 0.01}}
    new = moved_model(model, [effect], verdict(DRIFTS).searched.fit)
    assert new.body.values["viscous"] == pytest.approx(0.35)
    was, now = (m.ball(2).parameter("viscous_friction", "coefficient", 0.0) for m in (model, new))
    assert now - was == pytest.approx(0.25)


def test_drift_that_the_reference_has_is_not_added_again():
    was = MODEL.ball(2).parameter("viscous_friction", "coefficient", 0.0)
    before, after = {"rate": 1e-3, "start": 0.05}, {"rate": 2e-3, "start": 0.1}
    effect = {"name": "friction_drift", "rings": {"2": {"before": before, "after": after}}, "until_s": 100.0}
    effect["parameters"] = {"rate": {"stderr": 1e-4}, "start": {"stderr": 0.01}}
    found = moved_model(MODEL, [effect], None).ball(2)
    assert found.parameter("viscous_friction", "coefficient", 0.0) == pytest.approx(was + 0.05 + 0.1)


def test_a_bump_too_small_to_matter_is_left_out():
    place = {"centre": 1.0, "width": 0.2}
    flat = moved("surface_bump", {"height": 0.0, **place}, {"height": 1e-4, **place})
    assert flat == MODEL
    high = moved("surface_bump", {"height": 0.0, **place}, {"height": -3.0, **place})
    assert high.ball(2).parameter("surface_bump", "height", 0.0) == -3.0


def test_what_no_model_can_hold_changes_nothing():
    assert not kept_in_model([{"name": "ball_imbalance"}])
    assert moved_model(MODEL, [{"name": "ball_imbalance", "rings": {}}], None) == MODEL
