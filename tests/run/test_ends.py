"""How a run ends whose tree succeeds in the wrong place, or has a leaf that does what no rig and no run can use: with a
reason by name in a whole log, the plate level, and the line of the tree."""

from __future__ import annotations

import re

import pytest
from planar_rig import PATIENT, PlanarRig, known

from mazeplan.core.errors import TreeError
from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.maze.mapfile import load_map
from mazeplan.run.execution import run_job
from mazeplan.run.replay import replay
from mazeplan.run.specification import Job, Setup

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
    assert result.failures[-1].words == "the tree succeeded with the ball in ring 1, the goal is ring 5"
    assert (log.result["success"], log.result["reason"]) == (False, "elsewhere")
    assert replay("run.mcap", model=known(MAZE)).identical
    result, *_ = world("<BallSeen/>", goal=1)
    assert (result.success, result.reason, result.failures) == (True, "arrived", ())


def test_a_ball_that_is_lost_is_not_there(world):
    def hide(rig):
        rig.hidden = True

    result, *_ = world('<Delay delay_msec="900"><ForceSuccess><BallSeen/></ForceSuccess></Delay>', goal=1, mishap=hide)
    assert (result.success, result.reason) == (False, "elsewhere")
    assert "with the ball nobody knows where" in result.failures[-1].words


LEAN = """
from mazeplan.core.records import Command

class Lean(MazeLeaf):
    def step(self):
        told = 0.01 if self.context.now < 0.49 else {}
        self.context.steer(self.name, {})
        return Status.RUNNING
"""


@pytest.mark.parametrize(
    ("told", "command", "got"),
    [
        ('float("nan")', "Command(told, 0.0)", "u_beta = nan, u_gamma = 0.0, expected finite numbers, rad"),
        ('float("-inf")', "Command(0.0, told)", "u_beta = 0.0, u_gamma = -inf, expected finite numbers, rad"),
        ("None", "told and Command(told, 0.0)", "None, expected a Command"),
    ],
)
def test_a_command_that_is_none_is_an_error_of_the_leaf_and_not_of_the_rig(world, told, command, got):
    problem, rig, log = world("<Sequence>\n<Lean/></Sequence>", LEAN.format(told, command))
    assert isinstance(problem, TreeError)
    assert str(problem) == f"tree.xml:3: Main/Sequence/Lean: command: got {got}"
    assert log.result["reason"] == "leaf_failed"
    assert len(log.ticks["t"]) == 15
    assert set(rig.commands) in ({(0.01, 0.0)}, {(0.0, 0.01)})
    assert replay("run.mcap", model=known(MAZE)).identical


BROKEN = """
class Broken(MazeLeaf):
    def step(self):
        return Status.RUNNING if self.context.now < {at} else {{}}["nothing"]

    def halt(self):
        {halt}
"""


@pytest.mark.parametrize(("at", "halt", "n"), [(0.49, "pass", 15), (9, "1 / 0", 16)])
def test_a_leaf_that_raises_is_named_and_the_log_is_whole(world, at, halt, n):
    leaves = BROKEN.format(at=at, halt=halt)
    problem, _, log = world("<Sequence>\n<Broken/></Sequence>", leaves, time_limit=0.48)
    assert type(problem) is (KeyError if at == 0.49 else ZeroDivisionError)
    (note,) = problem.__notes__
    assert re.fullmatch(r"raised by the leaf at tree\.xml:3: Main/Sequence/Broken \(.*\.py:\d+\)", note)
    assert (log.result["success"], log.result["reason"]) == (False, "leaf_failed")
    last = log.events[-1].detail
    assert (last["kind"], last["where"]) == ("leaf_failed", "tree")
    said = "KeyError: 'nothing'" if at == 0.49 else "ZeroDivisionError: division by zero"
    assert last["detail"] == f"{said}, {problem.__notes__[0]}"
    assert len(log.ticks["t"]) == n


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('self.fail("stuck")', "fail: got 'stuck', expected a Failure; fail_as(kind, detail) makes one"),
        ('self.fail_as("greasy", "of butter")', "fail_as: got 'greasy', expected one of stuck, missed_opening"),
        ('self.get("sped")', "get: got 'sped', expected one of speed"),
    ],
)
def test_what_a_leaf_says_wrongly_is_an_error_at_its_line(world, line, said):
    leaves = f"""
class Odd(MazeLeaf):
    ports = {{"speed": Port(float, 1.0)}}

    def step(self):
        return {line}
"""
    problem, *_ = world("<Odd/>", leaves)
    assert str(problem).startswith(f"tree.xml:2: Main/Odd: {said}")
