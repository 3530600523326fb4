"""How a run ends whose tree succeeds in the wrong place, or has a leaf that does what no rig and no run can use: with a
reason by name in a whole log, the plate level, and the line of the tree."""

from __future__ import annotations

import pytest
from planar_rig import PATIENT, PlanarRig, known

from mazeplan.data.runlog_reader import read_log
from mazeplan.goals import Goals
from mazeplan.job import Job, Setup
from mazeplan.maze.mapfile import load_map
from mazeplan.replay import replay
from mazeplan.run import run_job

MAZE = load_map("cme")
TREE = '<root BTCPP_format="4"><BehaviorTree ID="Main">\n{}\n</BehaviorTree></root>'


@pytest.fixture
def world(tmp_path, monkeypatch):
    """Run a tree with leaves of one's own; (result or what was raised, rig, log)."""
    monkeypatch.chdir(tmp_path)

    def go(tree, leaves="", *, start=1, goal=5, goals=None, mishap=None, time_limit=2.0):
        modules = ()
        if leaves:
            name = f"leaves_{tmp_path.name}"
            (tmp_path / f"{name}.py").write_text("from mazeplan import MazeLeaf, Port, Status\n" + leaves)
            modules = (name,)
        (tmp_path / "tree.xml").write_text(TREE.format(tree))
        setup = Setup(MAZE, known(MAZE), "tree.xml", settings=PATIENT, behavior_modules=modules)
        rig = PlanarRig(MAZE, mishap=mishap)
        try:
            result = run_job(rig, setup, Job(start, goal, 0.3, 0, time_limit), log="run.mcap", goals=goals)
        except Exception as problem:
            result = problem
        assert rig.levelled
        return result, rig, read_log("run.mcap")

    return go


def test_a_tree_that_succeeds_in_another_ring_has_not_arrived(world):
    result, _, log = world("<BallSeen/>")
    assert (result.success, result.reason) == (False, "elsewhere")
    assert result.failures[-1].detail == "the tree succeeded with the ball in ring 1, the goal is ring 5"
    assert (log.result["success"], log.result["reason"]) == (False, "elsewhere")
    assert replay("run.mcap", model=known(MAZE)).identical
    result, *_ = world("<BallSeen/>", goal=1)
    assert (result.success, result.reason, result.failures) == (True, "arrived", ())


def test_where_the_ball_is_counts_by_what_was_measured_and_for_the_newest_goal(world):
    for first, newest, reason in ((5, 1, "arrived"), (1, 4, "elsewhere")):
        goals = Goals(MAZE)
        goals.aim(newest)
        assert world("<BallSeen/>", goal=first, goals=goals)[0].reason == reason


def test_a_ball_that_is_lost_is_not_there(world):
    def hide(rig):
        rig.hidden = True

    result, *_ = world('<Delay delay_msec="900"><ForceSuccess><BallSeen/></ForceSuccess></Delay>', goal=1, mishap=hide)
    assert (result.success, result.reason) == (False, "elsewhere")
    assert "with the ball nobody knows where" in result.failures[-1].detail
