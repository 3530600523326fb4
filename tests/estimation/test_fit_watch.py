"""Pictures that are mirrored or turned over are named soon; those of a healthy rig never are."""

from __future__ import annotations

from dataclasses import replace

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
WRONG = {
    "x": lambda x, y: (-x, y),
    "y": lambda x, y: (x, -y),
    "both": lambda x, y: (-x, -y),
    "exchanged": lambda x, y: (y, x),
}


class Wired:
    """A rig whose pictures show the ball elsewhere."""

    def __init__(self, rig, place):
        self.rig, self.place = rig, place

    def __getattr__(self, name):
        return getattr(self.rig, name)

    def observe(self):
        seen = self.rig.observe()
        return seen if seen.x is None else replace(seen, **dict(zip("xy", self.place(seen.x, seen.y), strict=True)))


def misfits(rig, start, seconds):
    return run_job(rig, SETUP, Job(1, 5, start_angle(start), start, seconds)).misfits


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("way", WRONG)
def test_pictures_that_are_wrong_are_named_and_end_a_run(rig, way):
    for start in (0, 2):
        [misfit] = misfits(Wired(RIGS[rig](MAZE), WRONG[way]), start, 5.0)
        assert not misfit.adopted
        assert misfit.t <= 4.0


@pytest.mark.parametrize("rig", RIGS)
def test_pictures_of_a_healthy_rig_are_never_named(rig):
    for start in range(5):
        assert misfits(RIGS[rig](MAZE), start, 20.0) == ()


@pytest.mark.parametrize("way", ["y", "exchanged"])
def test_they_are_named_also_after_a_limited_rate_was_adopted(way):
    slow = StrangeRig(MAZE, {"servo": "rate", "servo_hz": 8.0, "slew_deg_s": 34.0, "noise_mm": 1.0, "late_ms": 60.0})
    adopted, wrong = misfits(Wired(slow, WRONG[way]), 1, 5.0)
    assert "the plate turns at most 32 degrees a second" in adopted.words
    assert wrong.t <= 4.0
    assert not wrong.adopted
