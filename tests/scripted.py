"""Nodes over leaves that do what letters say; shared by the tests of the nodes."""

from __future__ import annotations

from mazeplan.apps.testing import Player, script
from mazeplan.btree.blackboard import Blackboard
from mazeplan.btree.controls import CONTROLS
from mazeplan.btree.decorators import DECORATORS, SubTree
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.status import FAILURE, RUNNING, SKIPPED, SUCCESS

SHORT = {RUNNING: "R", SUCCESS: "S", FAILURE: "F", SKIPPED: "-"}
NODES = {**CONTROLS, **DECORATORS, "SubTree": SubTree}


class Run:
    now = 0.0

    def clock(self):
        return self.now

    def failed(self, failure):
        pass


def scripted(letters, run=None):
    return Player(Leaf("leaf", run or Run(), Blackboard(), {}), script(letters))


def build(kind, scripts, values=None, run=None):
    run = run or Run()
    players = [scripted(letters, run) for letters in scripts]
    return wrap(kind, [player.leaf for player in players], values, run), players


def wrap(kind, children, values=None, run=None):
    return NODES[kind](kind, children, (run or Run()).clock, Blackboard(), values or {})


def tick(node):
    return SHORT[node.execute()]
