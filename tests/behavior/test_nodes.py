"""Semantics of the nodes, from the documentation of BehaviorTree.CPP 4: one row a case, statuses of the children
tick by tick."""

from __future__ import annotations

import pytest
from py_trees.common import Status

from mazeplan.behavior.blackboard import Blackboard
from mazeplan.behavior.leaf import Leaf
from mazeplan.behavior.nodes import CONTROLS, DECORATORS

LETTERS = {"R": Status.RUNNING, "S": Status.SUCCESS, "F": Status.FAILURE}


class Run:
    now = 0.0

    def clock(self):
        return self.now

    def failed(self, failure):
        pass


class Scripted(Leaf):
    """Returns the letters of its script one after the other, the last one for ever; counts starts and halts."""

    def __init__(self, script, run):
        super().__init__("leaf", run, Blackboard(), {})
        self.script, self.ticks, self.starts, self.halts = script, 0, 0, 0

    def start(self):
        self.starts += 1

    def step(self):
        letter = self.script[min(self.ticks, len(self.script) - 1)]
        self.ticks += 1
        return LETTERS[letter]

    def halt(self):
        self.halts += 1


def build(kind, scripts, values=None, run=None):
    run = run or Run()
    leaves = [Scripted(script, run) for script in scripts]
    return {**CONTROLS, **DECORATORS}[kind](kind, leaves, run.clock, Blackboard(), values or {}), leaves


def tick(node):
    for _ in node.tick():
        pass
    return node.status.name[0]


@pytest.mark.parametrize(
    ("kind", "values", "scripts", "expected", "ticks"),
    [
        ("Sequence", {}, ["S", "S"], "S", [1, 1]),
        ("Sequence", {}, ["S", "RS", "S"], "RS", [1, 2, 1]),  # resumes at the running child
        ("Sequence", {}, ["S", "FS", "S"], "FS", [2, 2, 1]),  # after a failure it starts over
        ("SequenceWithMemory", {}, ["S", "FS", "S"], "FS", [1, 2, 1]),  # ... but not with memory
        ("ReactiveSequence", {}, ["S", "RRS"], "RRS", [3, 3]),  # conditions are asked again
        ("ReactiveSequence", {}, ["SF", "R"], "RF", [2, 1]),
        ("Fallback", {}, ["F", "S"], "S", [1, 1]),
        ("Fallback", {}, ["F", "RF", "S"], "RS", [1, 2, 1]),
        ("Fallback", {}, ["F", "F"], "F", [1, 1]),
        ("ReactiveFallback", {}, ["FS", "R"], "RS", [2, 1]),
        ("Parallel", {}, ["S", "RS"], "RS", [1, 2]),
        ("Parallel", {}, ["F", "R"], "F", [1, 0]),
        ("Parallel", {"success_count": 1, "failure_count": 2}, ["F", "RS"], "RS", [1, 2]),
        ("Parallel", {"success_count": 1, "failure_count": -1}, ["F", "F"], "F", [1, 1]),
        ("Parallel", {"success_count": -2, "failure_count": -1}, ["S", "R", "S"], "S", [1, 1, 1]),  # -2: all but one
        ("Parallel", {"success_count": 1, "failure_count": -2}, ["F", "F", "R"], "F", [1, 1, 0]),
        ("Parallel", {}, ["S", "RRS"], "RRS", [1, 3]),  # a child that has finished is not ticked again
        ("SequenceWithMemory", {}, ["S", "FS", "FS"], "FFS", [1, 2, 2]),
        ("SequenceWithMemory", {}, ["S", "S"], "SS", [2, 2]),  # after success it starts over
        ("ReactiveFallback", {}, ["F", "RRF"], "RRF", [3, 3]),
        ("ReactiveSequence", {}, ["RS", "S"], "RS", [2, 1]),
        ("RetryUntilSuccessful", {"num_attempts": 3}, ["FFS"], "S", [3]),  # loops within the tick
        ("RetryUntilSuccessful", {"num_attempts": 2}, ["F"], "F", [2]),
        ("RetryUntilSuccessful", {"num_attempts": 2}, ["FRF"], "RF", [3]),  # attempts are counted over ticks
        ("RetryUntilSuccessful", {"num_attempts": -1}, ["FFS"], "RRS", [3]),  # without end: one attempt a tick
        ("Repeat", {"num_cycles": 3}, ["S"], "S", [3]),
        ("Repeat", {"num_cycles": 3}, ["SF"], "F", [2]),
        ("Repeat", {"num_cycles": 2}, ["RSRS"], "RRS", [4]),
        ("Repeat", {"num_cycles": -1}, ["S"], "RRR", [3]),
        ("Repeat", {"num_cycles": 0}, ["F"], "S", [0]),
        ("Inverter", {}, ["RSF"], "RFS", [3]),
        ("ForceSuccess", {}, ["RF"], "RS", [2]),
        ("ForceFailure", {}, ["RS"], "RF", [2]),
        ("KeepRunningUntilFailure", {}, ["SRF"], "RRF", [3]),
    ],
)
def test_conformance(kind, values, scripts, expected, ticks):
    node, leaves = build(kind, scripts, values)
    assert "".join(tick(node) for _ in expected) == expected
    assert [leaf.ticks for leaf in leaves] == ticks


def test_reactive_sequence_halts_what_runs_behind_a_condition_that_fails():
    node, (_, action) = build("ReactiveSequence", ["SF", "R"])
    assert tick(node) == "R"
    assert tick(node) == "F"
    assert action.halts == 1


def test_reactive_fallback_halts_what_runs_behind_a_condition_that_succeeds():
    node, (_, action) = build("ReactiveFallback", ["FS", "R"])
    assert [tick(node), tick(node)] == ["R", "S"]
    assert action.halts == 1


def test_parallel_halts_the_rest_when_it_is_decided():
    node, (_, other) = build("Parallel", ["F", "R"])
    tick(node)
    tick(node)
    assert other.halts == 0  # it never got to run: the first failure decided at once
    node, (_, other) = build("Parallel", ["RF", "R"])
    assert [tick(node), tick(node)] == ["R", "F"]
    assert other.halts == 1


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


@pytest.mark.parametrize("kind", [k for k in (*CONTROLS, *DECORATORS) if k != "Delay"])
def test_halting_reaches_the_running_child_exactly_once(kind):
    values = {"RetryUntilSuccessful": {"num_attempts": 2}, "Repeat": {"num_cycles": 2}, "Timeout": {"msec": 1000}}
    node, (leaf,) = build(kind, ["R"], values.get(kind))
    assert tick(node) == "R"
    node.stop(Status.INVALID)
    node.stop(Status.INVALID)
    assert (leaf.starts, leaf.halts) == (1, 1)
    assert tick(node) == "R"
    assert leaf.starts == 2


def test_a_finished_child_starts_anew():
    node, leaves = build("Sequence", ["S", "S"])
    tick(node)
    tick(node)
    assert [leaf.starts for leaf in leaves] == [2, 2]
    assert [leaf.halts for leaf in leaves] == [0, 0]
