"""Play and dead band of a record against those of the model: each hides in the other."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from stage_kinds import DT, jumps

from mazeplan.diagnosis.rig.reference import textbook
from mazeplan.diagnosis.rig.verdict import RigVerdict
from mazeplan.diagnosis.stage.comparison import Known, moved_by, settled_on, stage_effects
from mazeplan.diagnosis.stage.plate_motion import Stage, fit_stage
from mazeplan.learning.modelfile import RigModel
from mazeplan.learning.stage_fit import StageFit
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.rig.stage import StageAxis, StageModel, actuator_output, simulate_axis

ERRORS = dict.fromkeys(("gain", "dead_time", "backlash", "deadband"), 1e-4) | {
    "natural_frequency": 0.3,
    "damping": 0.01,
}
AXIS = StageAxis(1.0, 24.0, 0.9, stderr=ERRORS)
KNOWN = Known.of_model(RigModel(StageModel(AXIS, AXIS), {1: BallModel(())}, kind="pi"))


def found(**beta):
    stage = SimpleNamespace(axes=(replace(AXIS, **beta), AXIS), differs=frozenset())
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


def stage_of(beta, gamma):
    return Stage(StageFit(beta, 1e-3, 900), StageFit(gamma, 1e-3, 900), {})


def known_of(axis):
    return Known.of_model(RigModel(StageModel(axis, axis), {1: BallModel(())}, kind="pi"))


def test_axes_that_follow_at_once_are_later_by_whole_samples():
    prompt = replace(StageAxis.prompt(1.0, 0.05), stderr={"gain": 1e-4, "dead_time": 1.0 / 30.0 / math.sqrt(12.0)})
    within, later = (stage_of(*[replace(prompt, dead_time=0.05 + late)] * 2) for late in (0.02, 1.0 / 30.0))
    assert stage_effects(within, known_of(prompt)) == []
    assert [effect["name"] for effect in stage_effects(later, known_of(prompt))] == ["command_delay"]
    moves = moved_by(within, known_of(prompt))
    assert moves is not None
    assert moves.beta.dead_time == pytest.approx(0.05)
    limited = replace(prompt, dead_time=0.03, rate_limit=0.3, stderr={"dead_time": 1e-4, "rate_limit": 1e-3})
    assert [effect["name"] for effect in stage_effects(stage_of(limited, limited), known_of(prompt))] == ["rate_limit"]


def test_the_old_stage_moves_the_plate_unless_the_record_surely_differs():
    near = moved_by(stage_of(replace(AXIS, gain=1.0003, natural_frequency=24.5, offset=0.01), AXIS), KNOWN)
    assert near is not None
    assert (near.beta.gain, near.beta.natural_frequency, near.beta.offset) == pytest.approx((1.0, 24.0, 0.01))
    weaker = moved_by(stage_of(replace(AXIS, gain=0.9, natural_frequency=24.5), AXIS), KNOWN)
    assert weaker is not None
    assert (weaker.beta.gain, weaker.beta.natural_frequency) == pytest.approx((0.9, 24.0))
    slower = moved_by(stage_of(replace(AXIS, natural_frequency=12.0), AXIS), KNOWN)
    assert slower is not None
    assert slower.beta.natural_frequency == pytest.approx(12.0)


def coarse_record(seed, pole, dead, coupling=0.0):
    """A minute of a servo of first order, whose angle is measured in tenths of a degree."""
    u, step = jumps(seed, 1800), math.radians(0.1)
    axis = StageAxis(1.0, pole, 1.0, dead, order=1)
    moved = [simulate_axis(axis, u[:, i] + coupling * u[:, 1 - i], DT) for i in (0, 1)]
    tilts = [step * np.round(tilt / step) for tilt in moved]
    begins = np.arange(1800) == 0
    record: Any = SimpleNamespace(u=u, beta=tilts[0], gamma=tilts[1], dt=DT, begins=begins)
    return record


@pytest.mark.parametrize(
    ("pole", "dead", "coupling", "names"),
    [
        (35.0, 0.04, 0.0, []), (12.0, 0.04, 0.0, ["servo_lag"]), (20.0, 0.04, 0.0, ["servo_lag"]),
        (35.0, 0.08, 0.0, ["command_delay"]), (35.0, 0.04, 0.15, ["axis_coupling"]),
    ],
)  # fmt: skip
def test_the_motion_tells_what_numbers_that_stand_in_for_each_other_hide(pole, dead, coupling, names):
    rows = np.ones(1800, dtype=bool)
    was = fit_stage(coarse_record(1, 35.0, 0.04), rows)  # of second order: its frequency and damping are uncertain
    assert was is not None
    known = Known.of_model(RigModel(StageModel(*was.axes), {1: BallModel(())}, kind="pi"))
    record = coarse_record(2, pole, dead, coupling)
    stage = settled_on(fit_stage(record, rows), record, known)
    assert [effect["name"] for effect in stage_effects(stage, known)] == names


HOBBY = StageAxis(1.0, 35.0, 1.0, order=1, backlash=0.004, behind=True)


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({}, []), ({"backlash": 0.014}, ["backlash"]), ({"rate_limit": 0.4}, ["rate_limit"]),
        ({"natural_frequency": 22.0}, ["servo_lag"]), ({"dead_time": 0.03}, ["command_delay"]),
        ({"deadband": 0.008}, ["deadband"]),
    ],
)  # fmt: skip
def test_one_change_of_a_servo_with_gears_behind_its_lag_is_named_alone(changes, names):
    rows, begins, u = np.ones(3000, dtype=bool), np.arange(3000) == 0, jumps(4, 3000)
    rng = np.random.default_rng(4)

    def record(axis: StageAxis) -> Any:
        moved = [simulate_axis(axis, actuator_output(u[:, i], axis), DT) for i in (0, 1)]
        tilts = [tilt + 5e-4 * rng.standard_normal(3000) for tilt in moved]
        return SimpleNamespace(u=u, beta=tilts[0], gamma=tilts[1], dt=DT, begins=begins)

    was = fit_stage(record(HOBBY), rows, StageModel(HOBBY, HOBBY))
    assert was is not None
    known = Known.of_model(RigModel(StageModel(*was.axes), {1: BallModel(())}, kind="pi"))
    now = record(replace(HOBBY, **changes))
    stage = settled_on(fit_stage(now, rows, known.kind), now, known)
    (*entries,) = stage_effects(stage, known)
    assert [entry["name"] for entry in entries] == names
    for key, value in changes.items():
        assert getattr(stage.beta.axis, key) == pytest.approx(value, rel=0.03, abs=5e-4)


@pytest.mark.parametrize(("fits", "said"), [({"stage": 1.5, "ball": 1.0}, True), ({"stage": 1.2}, False), ({}, False)])
def test_whether_the_stage_fits_is_said_of_the_reference(fits, said):
    model = RigModel(StageModel(AXIS, AXIS), {1: BallModel(())}, kind="pi", scores={"fits": fits})
    was: Any = replace(textbook(), stage=Known.of_model(model), remaining=1.0)
    done: Any = SimpleNamespace(was=was, stage=None)
    assert RigVerdict.misfit.fget(done) == ("a servo of another kind" if said else "")
