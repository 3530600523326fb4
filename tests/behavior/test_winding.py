"""Leaves that ask for ticks after a halt: how many they get, and that the plate goes level meanwhile."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planar_rig import PATIENT, PlanarRig, known

from mazeplan.behavior.own_nodes import MOST_WIND_DOWN, registry_with
from mazeplan.core.errors import InputError, TreeError
from mazeplan.core.logs.run_log import read_log
from mazeplan.maze.mapfile import load_map
from mazeplan.run.execution import run_job
from mazeplan.run.goals import Goals
from mazeplan.run.replay import replay
from mazeplan.run.specification import Job, Setup

MAZE = load_map("cme")
LEAVES = '''
from mazeplan import MazeLeaf, Status
from mazeplan.core.records import Command

TOLD = []
WANTED = []


class Drive(MazeLeaf):
    """Tilts, and goes on until it is halted."""

    tilt = Command(0.06, -0.04)
    wind_down_ticks = {ticks}

    def step(self):
        self.context.steer(self.name, self.tilt)
        return Status.RUNNING

    def halt(self):
        TOLD.append("halt")


class Slow(Drive):
    def wind_down(self):
        TOLD.append(self.name)
        wanted = WANTED.pop(0) if WANTED else self.tilt
        if wanted is not None:
            self.context.steer(self.name, Command(*wanted) if isinstance(wanted, tuple) else wanted)
        return {answer}


class Quiet(Drive):
    """Runs beside another one; only its wind-down commands."""

    def step(self):
        return Status.RUNNING

    wind_down = Slow.wind_down
'''
TREE = '<root BTCPP_format="4"><BehaviorTree ID="Main">{}</BehaviorTree></root>'


@pytest.fixture
def world(tmp_path, monkeypatch):
    """make(leaf or tree, ticks=..., answer=...) -> (setup, module)."""
    made = []

    def make(tree, ticks="15", answer="Status.RUNNING"):
        name = f"winding_{tmp_path.name}_{len(made)}".replace("-", "_").replace("[", "_").replace("]", "_")
        (tmp_path / f"{name}.py").write_text(LEAVES.replace("{ticks}", ticks).replace("{answer}", answer))
        (tmp_path / "tree.xml").write_text(TREE.format(tree))
        made.append(name)
        setup = Setup(MAZE, known(MAZE), str(tmp_path / "tree.xml"), settings=PATIENT, behavior_modules=(name,))
        registry_with([name])
        import sys

        return setup, sys.modules[name]

    monkeypatch.chdir(tmp_path)
    return make


def stopped_at(setup, k, limit=20.0, log=None):
    goals = Goals(MAZE)
    rig = PlanarRig(MAZE, mishap=lambda rig: goals.stop() if len(rig.commands) == k else None)
    return run_job(rig, setup, Job(1, 5, 0.3, 0, limit), goals=goals, log=log), rig


def sizes(rig, k):
    return [math.hypot(*command) for command in rig.commands[k:]]


def test_a_leaf_gets_as_many_ticks_as_it_asks_for_after_its_halt(world, tmp_path):
    setup, module = world("<Slow/>", answer="Status.RUNNING if len(TOLD) < 5 else Status.SUCCESS")
    result, rig = stopped_at(setup, 10, log=tmp_path / "a.mcap")
    assert result.reason == "stopped"
    assert result.time_s == pytest.approx(10 / 30)  # when it was stopped
    assert ["halt", *["Slow"] * 4] == module.TOLD
    assert len(rig.commands) == 10 + 4
    log = read_log(tmp_path / "a.mcap")
    assert list(log.ticks["leaf"][-5:]) == ["Slow"] * 5
    assert list(log.ticks["status"][-5:]) == ["RUNNING", *["HALTED"] * 4]
    assert rig.levelled
    module.TOLD.clear()
    assert replay(tmp_path / "a.mcap", model=known(MAZE)).identical


@pytest.mark.parametrize("ticks", [1, 6, 15])
def test_no_more_than_its_bound_and_the_plate_goes_level_whatever_it_commands(world, ticks):
    setup, module = world("<Slow/>", ticks=str(ticks))
    _, rig = stopped_at(setup, 10)
    assert ["halt", *["Slow"] * ticks] == module.TOLD
    began = math.hypot(0.06, -0.04)
    assert sizes(rig, 10) == pytest.approx([began * (1.0 - k / ticks) for k in range(1, ticks + 1)])
    assert rig.commands[-1] == (0.0, 0.0)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.lists(st.none() | st.tuples(*[st.floats(-10.0, 10.0) | st.just(math.nan)] * 2), max_size=20), st.integers(1, 20)
)
def test_no_command_of_a_wind_down_is_larger_than_the_last_one(wanted, ticks):
    from mazeplan.behavior.winding import WindDown
    from mazeplan.btree.blackboard import Blackboard
    from mazeplan.btree.leaf import Leaf
    from mazeplan.btree.status import RUNNING
    from mazeplan.btree.tree import BehaviorTree
    from mazeplan.control.tilt import Plate
    from mazeplan.core.records import Command

    class Endless(Leaf):
        wind_down_ticks = ticks

        def step(self):
            return RUNNING

        def wind_down(self):
            return RUNNING

    tree = BehaviorTree(Endless("leaf", None, Blackboard(), {}), Blackboard())
    tree.tick()
    sent, plate = Command(0.08, -0.07), Plate(0.1)
    winding, last, k = WindDown(tree, sent, plate), math.hypot(0.08, 0.07), 0
    while winding.going:
        winding.tick()
        wish = wanted[k] if k < len(wanted) else (0.3, 0.3)
        command = winding.towards_level(None if wish is None else Command(*wish))
        size = math.hypot(command.u_beta, command.u_gamma)
        assert size <= last * (1.0 + 1e-12)
        assert max(abs(command.u_beta), abs(command.u_gamma)) <= 0.1
        if wish is not None and size > 0.0:
            assert np.sign([command.u_beta, command.u_gamma]).tolist() == np.sign(wish).tolist()
        last, k = size, k + 1
    assert k == ticks
    assert last < 1e-12


def test_the_time_limit_winds_down_too_and_an_own_end_does_not(world):
    setup, module = world("<Slow/>", ticks="4")
    goals_free = PlanarRig(MAZE)
    result = run_job(goals_free, setup, Job(1, 5, 0.3, 0, 0.5))
    assert result.reason == "out_of_time"
    assert ["halt", *["Slow"] * 4] == module.TOLD
    setup, module = world('<Timeout msec="500"><Slow/></Timeout>')
    rig = PlanarRig(MAZE)
    result = run_job(rig, setup, Job(1, 5, 0.3, 0, 5.0))
    assert result.reason == "failed"
    assert module.TOLD == ["halt"]  # within the tree, what comes next commands at once
    assert rig.levelled


def test_leaves_without_a_wind_down_take_no_tick_more(world):
    setup, module = world("<Drive/>")
    result, rig = stopped_at(setup, 10)
    assert result.reason == "stopped"
    assert module.TOLD == ["halt"]
    assert rig.commands[10:] == [(0.0, 0.0)]
    rig = PlanarRig(MAZE)
    run_job(rig, setup, Job(1, 5, 0.3, 0, 0.5))
    assert (0.0, 0.0) not in rig.commands


def test_another_goal_does_not_wait_for_a_wind_down(world):
    setup, module = world("<Slow/>")
    goals = Goals(MAZE)
    rig = PlanarRig(MAZE, mishap=lambda rig: goals.aim(3) if len(rig.commands) == 10 else None)
    run_job(rig, setup, Job(1, 5, 0.3, 0, 0.5), goals=goals)
    assert module.TOLD[0] == "halt"
    assert module.TOLD.index("Slow") > 1  # the halt of the first tree, then that of the second one at the time limit
    assert sizes(rig, 0)[:20] == pytest.approx([math.hypot(0.06, 0.04)] * 20)


def test_two_leaves_that_wind_down_side_by_side_may_not_both_command(world):
    tree = '<Parallel success_count="2"><Slow/><Quiet/></Parallel>'
    setup, module = world(tree)
    module.WANTED[:] = [(0.01, 0.0), None, (0.01, 0.0), (0.01, 0.0)]
    with pytest.raises(TreeError, match="Quiet and Slow both command the rig"):
        stopped_at(setup, 10)
    assert module.TOLD == ["halt", "halt", "Slow", "Quiet", "Slow", "Quiet"]


def test_what_a_wind_down_returns_is_checked(world):
    setup, _ = world("<Slow/>", answer="None")
    with pytest.raises(TreeError, match=r"tree\.xml:1: Main/Slow: Slow\.wind_down returned None, expected RUNNING"):
        stopped_at(setup, 10)


@pytest.mark.parametrize("ticks", ["0", "-3", "2.5", "True", "'a'", str(MOST_WIND_DOWN + 1)])
def test_the_bound_of_a_wind_down_is_checked(world, ticks):
    with pytest.raises(InputError, match=f"wind_down_ticks: got {ticks}, expected a whole number from 1 to 90"):
        world("<Slow/>", ticks=ticks)
