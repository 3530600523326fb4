"""Stage and tilt sensor of a record against those of the model."""

from __future__ import annotations

import numpy as np
import pytest
from plant import DAMPING, SERVO, play
from ring_records import DECLARED, names, parameters

from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.record import record_of
from mazeplan.diagnosis.ring.diagnose import diagnose
from mazeplan.diagnosis.stage.comparison import Known
from mazeplan.learning.modelfile import RigModel
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effects.ball import rolling_inertia, viscous_friction
from mazeplan.physics.rig.stage import StageAxis, StageModel

RADIUS = 0.0925
STAGE = StageModel(*[StageAxis(1.0, SERVO, DAMPING, stderr={"gain": 1e-3, "natural_frequency": 0.3})] * 2)
MODEL = RigModel(STAGE, {1: BallModel((rolling_inertia(5 / 7), viscous_friction(0.35)))}, kind="pi")


def found(columns, model=MODEL):
    return diagnose(record_of(Table(columns)), RADIUS, model.declared(1), known=Known.of_model(model))


def recorded(mix, **effects):
    """A record whose commands say less than what reached the servos: mix (2, 2) of them did."""
    columns = play(seed=5, seconds=90.0, **effects)
    u = np.linalg.solve(np.array(mix), np.stack([columns["u_beta"], columns["u_gamma"]]))
    return {**columns, "u_beta": u[0], "u_gamma": u[1]}


def sizes(done, name):
    return {p: number["value"] for p, number in parameters(done, name).items()}


@pytest.mark.slow
def test_a_stage_that_is_as_the_model_says_is_no_news():
    assert found(play(seed=5, seconds=90.0)).verdict == "nothing_missing"


@pytest.mark.slow
def test_a_servo_that_turns_too_little_is_told_from_a_sensor_that_says_so():
    done = found(recorded([[0.85, 0.0], [0.0, 1.0]]))
    assert names(done) == ["servo_gain"]
    assert sizes(done, "servo_gain") == pytest.approx({"beta": 0.85, "gamma": 1.0}, abs=4e-3)
    assert done.after.rollout40 < 0.5 * done.before.rollout40, "the model's own stage is scored before"
    done = found(play(seed=5, seconds=90.0, gain=(1.1, 1.0)))
    assert names(done) == ["tilt_gain"]
    assert sizes(done, "tilt_gain") == pytest.approx({"beta": 1.1, "gamma": 1.0}, abs=4e-3)


@pytest.mark.slow
def test_axes_that_share_commands():
    done = found(recorded([[1.0, 0.08], [-0.05, 1.0]]))
    assert names(done) == ["axis_coupling"]
    assert sizes(done, "axis_coupling") == pytest.approx({"beta_from_gamma": 0.08, "gamma_from_beta": -0.05}, abs=5e-3)
    assert done.after.rollout40 < 0.5 * done.before.rollout40


@pytest.mark.slow
def test_a_servo_slower_than_the_model_says():
    quick = StageModel(*[StageAxis(1.0, 26.0, DAMPING)] * 2)
    done = found(play(seed=5, seconds=90.0), RigModel(quick, MODEL.balls, kind="pi"))
    assert names(done) == ["servo_lag"]
    values = sizes(done, "servo_lag")
    assert values["beta_natural_frequency"] == pytest.approx(SERVO, rel=0.1)
    assert values["gamma_damping"] == pytest.approx(DAMPING, rel=0.1)
    told = done.document()["effects"][0]
    assert told["known_before"]["beta_natural_frequency"] == 26.0
    assert told["planned"]


@pytest.mark.slow
def test_of_a_stage_that_nobody_declared_nothing_is_said():
    columns = recorded([[0.85, 0.0], [0.0, 1.0]])
    assert diagnose(record_of(Table(columns)), RADIUS, DECLARED).verdict == "nothing_missing"
