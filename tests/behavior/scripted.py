"""Leaves that return what a script says, with counts of what happened to them; shared by the tests of the nodes."""

from __future__ import annotations

from mazeplan.behavior.blackboard import Blackboard
from mazeplan.behavior.decorators import DECORATORS, SubTree
from mazeplan.behavior.leaf import Leaf
from mazeplan.behavior.nodes import CONTROLS
from mazeplan.behavior.status import FAILURE, RUNNING, SKIPPED, SUCCESS

LETTERS = {"R": RUNNING, "S": SUCCESS, "F": FAILURE}
SHORT = {RUNNING: "R", SUCCESS: "S", FAILURE: "F", SKIPPED: "-"}
NODES = {**CONTROLS, **DECORATORS, "SubTree": SubTree}


class Run:
    now = 0.0

    def clock(self):
        return self.now

    def failed(self, failure):
        pass


class Scripted(Leaf):
    """Returns the letters of its script one after the other, the last one for ever; - is a precondition that skips it,
    whether it is idle or running. Counts steps, starts, halts and how often it finished."""

    def __init__(self, script, run):
        super().__init__("leaf", run, Blackboard(), {})
        self.script, self.at, self.ticks, self.starts, self.halts, self.ends = script, 0, 0, 0, 0, 0
        self.conditions = self  # type: ignore[assignment]  # it decides itself

    def decide(self, running):
        if self.script[self.at] != "-":
            return None
        self.at = min(self.at + 1, len(self.script) - 1)
        return SKIPPED

    def start(self):
        self.starts += 1

    def step(self):
        letter = self.script[self.at]
        self.at = min(self.at + 1, len(self.script) - 1)
        self.ticks += 1
        self.ends += letter != "R"
        return LETTERS[letter]

    def halt(self):
        self.halts += 1


def build(kind, scripts, values=None, run=None):
    run = run or Run()
    leaves = [Scripted(script, run) for script in scripts]
    return wrap(kind, leaves, values, run), leaves


def wrap(kind, children, values=None, run=None):
    return NODES[kind](kind, children, (run or Run()).clock, Blackboard(), values or {})


def tick(node):
    for _ in node.tick():
        pass
    return SHORT[node.result]
