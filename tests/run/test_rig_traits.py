"""What a rig says of itself: its latency counts for more than the model's, and how long a ball may be unseen."""

from __future__ import annotations

from dataclasses import replace

import pytest
from planar_rig import PATIENT, PlanarRig, known

from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.core.records import FailureKind, Latency
from mazeplan.learning.modelfile import load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.run.execution import run_job
from mazeplan.run.replay import replay
from mazeplan.run.specification import Job, Setup

MAZE = load_map("cme")
SETUP = Setup(MAZE, known(MAZE), rig_name="planar", settings=PATIENT)
LATE = Latency(camera_s=0.05, command_s=0.03)


class Told(PlanarRig):
    """The light rig, with something to say; its ball hides from sample `hides` on."""

    def __init__(self, latency=None, unseen_s=None, hides=10**6, back=10**6):
        super().__init__(MAZE)
        self.latency, self.unseen_s, self.hides, self.back, self.k = latency, unseen_s, hides, back, 0

    def observe(self):
        sample = super().observe()
        self.k += 1
        return replace(sample, x=None, y=None) if self.hides <= self.k < self.back else sample


def test_a_measured_latency_takes_the_place_of_the_models():
    model = load_model("toy")
    late = model.late_by(LATE)
    assert late.camera_delay == 0.05
    assert (late.stage.beta.dead_time, late.stage.gamma.dead_time) == (0.03, 0.03)
    assert late.stage.beta.natural_frequency == model.stage.beta.natural_frequency
    assert late.late_s == pytest.approx(0.08)
    assert SETUP.on(PlanarRig(MAZE)).driving_model is SETUP.model
    assert SETUP.on(Told(LATE)).driving_model.camera_delay == 0.05
    assert SETUP.on(Told(LATE)).model is SETUP.model


def test_a_run_with_a_latency_is_replayed_with_it(tmp_path):
    log = tmp_path / "run.mcap"
    run_job(Told(Latency(0.0, 0.02)), SETUP, Job(4, 5, 0.3), log=log)
    header = read_log(log).header
    assert header["replay"]["latency"] == {"camera_s": 0.0, "command_s": 0.02}
    assert replay(log, model=known(MAZE)).difference is None


def test_a_ball_that_is_unseen_for_too_long_ends_the_run_with_a_level_plate(tmp_path):
    rig, log = Told(unseen_s=1.0, hides=12), tmp_path / "run.mcap"
    result = run_job(rig, SETUP, Job(1, 5, 0.3), log=log)
    assert (result.success, result.reason) == (False, "ball_lost")
    assert rig.k == 11 + 30
    assert rig.levelled >= 1
    assert result.failures[-1].kind is FailureKind.BALL_LOST
    assert "not seen for 1.0 s" in result.failures[-1].words
    assert replay(log, model=known(MAZE)).difference is None
