"""A run adopts the servo that it sees; a healthy rig is never said to differ from its model."""

from __future__ import annotations

import pytest
from planar_rig import PATIENT, PlanarRig
from strange_rigs import StrangeRig

from mazeplan.learning.rig_model import RigModel
from mazeplan.maze.mapfile import load_map
from mazeplan.run.campaign.one_run import start_angle
from mazeplan.run.execution import run_job
from mazeplan.run.specification import Job, Setup

MAZE = load_map("cme")
SETUP = Setup(MAZE, RigModel.nominal(MAZE), settings=PATIENT)
RIGS = {"planar": PlanarRig, "strange": lambda maze: StrangeRig(maze, {})}


def misfits(rig, start, seconds):
    return run_job(rig, SETUP, Job(1, 5, start_angle(start), start, seconds)).misfits


@pytest.mark.parametrize("settings", [{"servo": "first", "servo_hz": 1.5}, {"servo": "rate", "slew_deg_s": 30.0}])
def test_another_servo_is_adopted_soon(settings):
    for start in (0, 2):
        found = misfits(StrangeRig(MAZE, settings), start, 5.0)
        assert found
        assert all(misfit.adopted and misfit.t <= 4.0 for misfit in found)


@pytest.mark.parametrize("rig", RIGS)
def test_a_healthy_rig_fits(rig):
    for start in range(5):
        assert misfits(RIGS[rig](MAZE), start, 20.0) == ()
