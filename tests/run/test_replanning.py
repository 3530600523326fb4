"""The route is planned anew where something changed it, in the tick in which that is seen; and recoveries are bounded,
for each kind and in total, by what stands in the tree."""

from __future__ import annotations

import math
import re

import pytest
from planar_rig import PATIENT, PlanarRig, known

from mazeplan.core import resources
from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.core.maths.angles import difference
from mazeplan.maze.mapfile import load_map
from mazeplan.run.execution import run_job
from mazeplan.run.goals import Goals
from mazeplan.run.specification import Job, Setup

MAZE = load_map("cme")
PACKAGED = (resources.share("behaviors") / "navigate.xml").read_text(encoding="utf-8")


class Recorded:
    """A run and its log."""

    def __init__(
        self, path, mishap=None, start=1, goal=5, theta=0.3, limit=20.0, closed=(), behavior="navigate", act=None
    ):
        goals = Goals(MAZE)

        def both(rig):
            if mishap is not None:
                mishap(rig)
            if act is not None:
                act(rig, goals)

        self.rig = PlanarRig(MAZE, mishap=both)
        setup = Setup(MAZE, known(MAZE), str(behavior), settings=PATIENT)
        job = Job(start, goal, theta, 0, limit, closed)
        self.result = run_job(self.rig, setup, job, log=path / "run.mcap", goals=goals)
        self.log = read_log(path / "run.mcap")

    def events(self, kind, t=None):
        return [e.detail for e in self.log.events if e.kind == kind and (t is None or e.t == t)]

    @property
    def kinds(self):
        return [str(failure.kind) for failure in self.result.failures]

    @property
    def recoveries(self):
        return [failure.recovery for failure in self.result.failures]

    def replanned(self, kind):
        """The route and the opening that the first failure of this kind led to, in its own tick, and who commanded."""
        t = next(failure.t for failure in self.result.failures if str(failure.kind) == kind)
        (route,), (opening,) = self.events("route", t), self.events("opening", t)
        leaf = str(self.log.ticks["leaf"][self.log.ticks["t"] == t][0])
        return route["openings"], opening["opening"], leaf


# -- four reasons for another route ----------------------------------------------------------------------------------


def test_an_opening_that_fails_is_left_for_another_route(tmp_path):
    """Three of the four openings are plugged, so that it happens more than once."""
    angle, floor = MAZE.opening("1-2@45").angle, MAZE.ring(1).inner_radius + MAZE.ball.radius - 1e-3
    free = MAZE.opening("1-2@225").angle

    def plug(rig):
        r, theta = math.hypot(*rig.z[:2]), math.atan2(rig.z[1], rig.z[0])
        if MAZE.ring(2).outer_radius < r < floor and abs(difference(theta, free)) > 0.2:
            rig.z[:2] *= floor / r
            rig.z[2:4] = 0.0

    run = Recorded(tmp_path, plug, theta=angle)
    assert run.result.success
    assert run.recoveries[:3] == ["replan", "back_off", "avoid_opening"]
    routes = [route["openings"][0] for route in run.events("route")]
    assert routes[0] == "1-2@45"
    assert routes[-1] != "1-2@45"
    assert run.result.rings[0].opening == routes[-1]


def at_tick(k, deed):
    return lambda rig, goals: deed(goals) if len(rig.commands) == k else None


def test_the_opening_ahead_closed_from_outside(tmp_path):
    run = Recorded(tmp_path, theta=0.3, act=at_tick(5, lambda goals: goals.close("1-2@45")))
    assert run.events("opening")[0]["opening"] == "1-2@45"
    assert run.result.success
    assert run.kinds == ["opening_closed"]
    assert run.recoveries == ["replan"]
    assert run.result.failures[0].t == pytest.approx(5 / 30)  # in the tick in which it was heard
    route, opening, leaf = run.replanned("opening_closed")
    assert "1-2@45" not in (opening, *route)
    assert leaf == "Track"
    assert run.result.rings[0].opening == opening


# -- budgets ---------------------------------------------------------------------------------------------------------


def tree_with(path, *changes):
    text = PACKAGED
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    file = path / "tree.xml"
    file.write_text(text, encoding="utf-8")
    return file


def glue(rig):
    rig.glued = True


def hide(rig):
    rig.hidden = rig.t > 0.3


def throw_back(rig):
    if rig.ring > 1:
        rig.place(1, 2.0)


def plug_all(rig):
    floor = MAZE.ring(1).inner_radius + MAZE.ball.radius - 1e-3
    r = math.hypot(*rig.z[:2])
    if r < floor:
        rig.z[:2] *= floor / r
        rig.z[2:4] = 0.0


def test_every_recovery_of_the_packaged_tree_has_a_budget_in_the_file():
    recover = PACKAGED.split('<BehaviorTree ID="Recover">')[1].split("</BehaviorTree>")[0]
    conditions, branches = re.findall(r"<FailureIs [^>]*>", recover), re.findall(r"<Sequence ", recover)
    assert len(conditions) == len(branches) == 7
    budgets = [int(re.search(r'at_most="(\d+)"', condition).group(1)) for condition in conditions]
    total = int(re.search(r'num_attempts="(\d+)"', PACKAGED).group(1))
    assert all(0 < budget < total for budget in budgets)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mishap", "old", "new", "recovery", "times"),
    [
        (glue, 'kinds="stuck" at_most="6"', 'kinds="stuck" at_most="2"', "dither", 2),
        (
            glue,
            'kinds="missed_opening;stuck" at_most="12"',
            'kinds="missed_opening;stuck" at_most="9"',
            "avoid_opening",
            3,
        ),
        (hide, 'kinds="ball_lost" at_most="8"', 'kinds="ball_lost" at_most="2"', "level_plate", 2),
        (plug_all, 'kinds="missed_opening" at_most="2"', 'kinds="missed_opening" at_most="4"', "back_off", 3),
        (throw_back, 'out_of_time" at_most="12"', 'out_of_time" at_most="3"', "replan", 3),
    ],
)
def test_each_budget_of_a_kind_binds(tmp_path, mishap, old, new, recovery, times):
    run = Recorded(tmp_path, mishap, limit=19.0, behavior=tree_with(tmp_path, (old, new)))
    assert not run.result.success
    assert run.recoveries.count(recovery) == times
    assert len(run.result.failures) > times  # there were more, for which it was not used
