"""Rigs as strangers write them: a run arrives without a model, and with the model of a short record."""

from __future__ import annotations

import pytest
from planar_rig import PATIENT
from strange_rigs import SIX, Springy, Stepper, StrangeRig, drawn

from mazeplan.core.logs.table import read_table
from mazeplan.core.records import FailureKind
from mazeplan.learning import identification
from mazeplan.learning.modelfile import load_model, save_model
from mazeplan.learning.rig_model import RigModel
from mazeplan.maze.mapfile import load_map
from mazeplan.run.campaign.one_run import start_angle
from mazeplan.run.collect import Collection, run_collection
from mazeplan.run.commands.learn import learn_model
from mazeplan.run.execution import run_job
from mazeplan.run.specification import Job, Setup

pytestmark = pytest.mark.slow
MAZE = load_map("cme")
EACH = pytest.mark.parametrize("rig", SIX, ids=lambda rig: rig.__name__)


def runs(rig, model):
    setup = Setup(MAZE, model, rig_name=rig.__name__, settings=PATIENT)
    return [run_job(rig(MAZE, {}), setup, Job(1, 5, start_angle(i), i, 20.0)) for i in range(3)]


@EACH
def test_without_a_model_a_run_arrives_or_says_soon_what_is_wrong(rig):
    for result in runs(rig, RigModel.nominal(MAZE)):
        assert result.success or any(misfit.t <= 2.0 for misfit in result.misfits), result.reason


@EACH
def test_with_the_model_of_two_minutes_a_run_arrives(rig, tmp_path):
    log, machine = tmp_path / "log.mcap", rig(MAZE, {})
    seconds = max(120.0, 2700.0 / machine.rate_hz)  # a fit needs stretches of 13 samples: slow pictures take longer
    run_collection(machine, MAZE, Collection(seconds, (1, 2, 3, 4, 5), seed=0), log)
    learned = learn_model([read_table(log)], MAZE, "pi").model
    model = load_model(save_model(learned, tmp_path / "model"))
    again = load_model(save_model(model, tmp_path / "again"))
    assert again == model
    assert (model.kind, model.stage.beta.order, model.stage.gamma.order) == (
        learned.kind, learned.stage.beta.order, learned.stage.gamma.order
    )  # fmt: skip
    assert [result.reason for result in runs(rig, model)] == ["arrived"] * 3


def test_beads_that_are_far_off_are_fitted_again_with_the_delay_and_the_tilt_of_the_rigid_ball(tmp_path, monkeypatch):
    log = tmp_path / "log.mcap"
    run_collection(Stepper(MAZE, {}), MAZE, Collection(90.0, (1, 2, 3, 4), seed=0), log)
    monkeypatch.setattr(identification, "_best_delay", lambda *given: (0.17, 0.002))
    done = learn_model([read_table(log)], MAZE, "pi")
    assert done.model.camera_delay < 0.05  # 33 ms, less what the steps of the servos stand in for
    assert done.fit.model.camera_delay == done.model.camera_delay
    for axis in ("beta", "gamma"):
        lean = done.model.balls[2].parameter("tilt_offset", axis, 0.0)
        assert lean == pytest.approx(done.model.body.values[f"tilt_{axis}"], abs=1e-3)


def test_beads_that_are_fitted_again_take_no_picture_before_the_plate_moved(tmp_path):
    run_collection(Springy(MAZE, {}), MAZE, Collection(120.0, (1, 2, 3, 4, 5), seed=4), log := tmp_path / "log.mcap")
    model = learn_model([read_table(log)], MAZE, "pi").model
    assert load_model(save_model(model, tmp_path / "model")).camera_delay >= -model.stage.dead_time - 1e-6


@pytest.mark.parametrize("start", [3, 7])
def test_a_ball_held_in_a_throat_is_freed(start):
    """Walls with friction and a ball with a heavy side: the ball rests between the walls of an opening."""
    setup = Setup(MAZE, RigModel.nominal(MAZE), settings=PATIENT)
    result = run_job(StrangeRig(MAZE, drawn(7032)), setup, Job(1, 5, start_angle(start), start, 12.0))
    assert result.success
    assert sum(failure.kind == FailureKind.STUCK for failure in result.failures) <= 1


def test_a_limited_rate_is_found_by_the_ball_alone(tmp_path):
    log, limited = tmp_path / "log.mcap", {"servo": "stepper", "slew_deg_s": 30.0, "measured": False, "late_ms": 25.0}
    run_collection(StrangeRig(MAZE, limited), MAZE, Collection(120.0, (1, 2, 3, 4), seed=0), log)
    assert learn_model([read_table(log)], MAZE, "pi").model.stage.beta.rate_limit == pytest.approx(0.524, rel=0.15)
