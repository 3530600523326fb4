"""Nodes in time, and when they are halted; what they do tick by tick is in `test_tree_conformance`."""

from __future__ import annotations

import pytest
from scripted import Run, build, tick

from mazeplan.btree.controls import CONTROLS
from mazeplan.btree.decorators import DECORATORS


def test_timeout_is_in_rig_time_and_halts_its_child_once():
    run = Run()
    node, (leaf,) = build("Timeout", ["R"], {"msec": 100}, run)
    for now, expected in ((0.0, "R"), (0.09, "R"), (0.1, "F")):
        run.now = now
        assert tick(node) == expected
    assert leaf.halts == 1
    run.now = 5.0  # entered anew, the time starts anew
    assert tick(node) == "R"
    assert leaf.starts == 2


def test_delay_is_in_rig_time():
    run = Run()
    node, (leaf,) = build("Delay", ["S"], {"delay_msec": 50}, run)
    for now, expected, ticks in ((1.0, "R", 0), (1.04, "R", 0), (1.05, "S", 1)):
        run.now = now
        assert tick(node) == expected
        assert leaf.ticks == ticks


OTHERS = ("Delay", "Manual", "Precondition", "Loop", "WaitValue", "Switch", "TryCatch", "SkipUnless")


@pytest.mark.parametrize("kind", [k for k in (*CONTROLS, *DECORATORS) if not k.startswith(OTHERS)])
def test_halting_reaches_the_running_child_exactly_once(kind):
    values = {"RetryUntilSuccessful": {"num_attempts": 2}, "Repeat": {"num_cycles": 2}, "Timeout": {"msec": 1000}}
    node, (leaf,) = build(kind, ["R"], values.get(kind))
    assert tick(node) == "R"
    node.reset()
    node.reset()
    assert (leaf.starts, leaf.halts) == (1, 1)
    assert tick(node) == "R"
    assert leaf.starts == 2


def test_a_finished_child_starts_anew():
    node, leaves = build("Sequence", ["S", "S"])
    tick(node)
    tick(node)
    assert [leaf.starts for leaf in leaves] == [2, 2]
    assert [leaf.halts for leaf in leaves] == [0, 0]
