"""A run ticked by hand: commands given from outside, another goal, and the slew limit of the tree's commands."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from planar_rig import PATIENT, PlanarRig, known

from mazeplan.core.errors import RigError
from mazeplan.core.progress import Display
from mazeplan.core.records import Command
from mazeplan.maze.mapfile import load_map
from mazeplan.run.execution import run_job
from mazeplan.run.loop import Run
from mazeplan.run.specification import Job, Setup

MAZE = load_map("cme")
SETUP = Setup(MAZE, known(MAZE), rig_name="planar", settings=PATIENT)


def placed(goal=5, start=1, theta=0.3, **more):
    rig = PlanarRig(MAZE)
    run = Run(rig, SETUP, Job(start, goal, theta), None, Display(), **more)
    rig.reset(ring=start, theta=theta, rng=None)
    return rig, run


def until_done(rig, run, limit=10.0):
    while True:
        status = run.tick(rig.observe())
        if status != "RUNNING" or rig.t > limit:
            return status


def test_a_given_command_goes_out_and_the_tree_rests():
    rig, run = placed()
    for k in range(20):
        assert run.tick(rig.observe(), Command(0.01 * (k % 3), -0.02), "somebody") == "RUNNING"
        assert run.context.commanded_by == "somebody"
    assert rig.commands == [(0.01 * (k % 3), -0.02) for k in range(20)]
    assert run.context.leg.opening is None
    assert until_done(rig, run) == "SUCCESS"  # and takes over from where the ball is
    assert rig.ring == 5


def test_another_goal_is_reached_from_where_the_ball_is():
    rig, run = placed(goal=2)
    assert until_done(rig, run) == "SUCCESS"
    assert rig.ring == 2
    t = rig.t
    avoided = tuple(opening.name for opening in MAZE.openings_between(2, 3))[:3]
    run.aim(3, avoided)
    assert run.context.now == t
    assert until_done(rig, run) == "SUCCESS"
    assert rig.ring == 3
    assert run.context.leg.opening is not None
    assert run.context.leg.opening.name == "2-3@270"
    assert [passage.ring for passage in run.result(True, "").rings] == [1, 2, 3]
    assert rig.t > t


def test_the_tree_commands_no_faster_than_the_slew_limit():
    slew = math.radians(30.0)
    rig, run = placed(goal=4, slew=slew)
    assert until_done(rig, run) == "SUCCESS"
    steps = np.abs(np.diff([(0.0, 0.0), *rig.commands], axis=0))
    assert steps.max() <= slew / 30.0 + 1e-12
    assert np.mean(np.isclose(steps, slew / 30.0)) > 0.05  # it does limit
    free, fast = placed(goal=4)
    until_done(free, fast)
    assert np.abs(np.diff(free.commands, axis=0)).max() > 2.0 * slew / 30.0


class Told(Display):
    def __init__(self):
        self.lines = []

    def ring_entered(self, ring, t):
        self.lines.append((round(t, 3), f"in ring {ring}"))

    def event(self, t, text):
        self.lines.append((round(t, 3), text))


class BeginsElsewhere(PlanarRig):
    ring = 3

    def reset(self, *, ring, theta, rng):
        super().reset(ring=self.ring, theta=theta, rng=rng)


def test_a_ball_that_is_not_where_it_was_to_begin_is_told():
    told = Told()
    run_job(BeginsElsewhere(MAZE), SETUP, Job(1, 5, 0.3), display=told)
    assert told.lines[:2] == [(0.0, "in ring 3"), (0.0, "the ball is not in ring 1, where it was to begin")]
    told = Told()
    run_job(PlanarRig(MAZE), SETUP, Job(1, 5, 0.3), display=told)
    assert "to begin" not in " ".join(text for _, text in told.lines)


def test_a_rig_that_shows_the_time_of_day_has_failed_and_says_why():
    class Daytime(PlanarRig):
        def observe(self):
            seen = super().observe()
            return replace(seen, t=seen.t + 1.7e9)

    with pytest.raises(RigError, match=r"first sample after reset\(\) is at t = 1700000000\.\d s, expected about 0"):
        run_job(Daytime(MAZE), SETUP, Job(1, 5, 0.3))
