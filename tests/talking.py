"""A run on the planar rig with orders at given ticks, for the tests of goals."""

from __future__ import annotations

from planar_rig import PATIENT, PlanarRig, known

from mazeplan.maze.mapfile import load_map
from mazeplan.run.execution import run_job
from mazeplan.run.specification import Job, Setup

MAZE = load_map("cme")
SETUP = Setup(MAZE, known(MAZE), rig_name="planar", settings=PATIENT)
NAMES = [opening.name for opening in MAZE.openings]
FIRST = tuple(opening.name for opening in MAZE.openings_between(1, 2))


class Script:
    """A mishap of the planar rig: call `acts[k]` at tick k, and further mishaps at each tick."""

    def __init__(self, acts, *others):
        self.acts, self.others, self.k = acts, others, -1

    def __call__(self, rig):
        self.k += 1
        for other in self.others:
            other(rig)
        if self.k in self.acts:
            self.acts[self.k]()


def go(acts, *others, goals=None, start=1, goal=5, theta=0.3, limit=20.0, setup=SETUP, log=None, closed=()):
    rig = PlanarRig(setup.maze, mishap=Script(acts, *others))
    result = run_job(rig, setup, Job(start, goal, theta, 0, limit, closed), log=log, goals=goals)
    return result, rig


def said(log):
    return [(e.t, e.kind, e.detail) for e in log.events if e.kind in ("goal", "closed", "opened", "stopped")]
