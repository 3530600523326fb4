"""A leaf that raises: the error comes out, and what was entered is halted once, itself and what ran beside it."""

from __future__ import annotations

import pytest
from scripted import Run

from mazeplan.behavior.trees import load_tree
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.status import RUNNING

TREE = '<root BTCPP_format="4"><BehaviorTree ID="Main">{}</BehaviorTree></root>'


class Noted(Leaf):
    """Notes its life in the run's list."""

    def start(self):
        self.context.noted.append(f"{self.name} starts")

    def step(self):
        return RUNNING

    def halt(self):
        self.context.noted.append(f"{self.name} halts")


class BreaksAtOnce(Noted):
    """Raises as soon as it is entered."""

    def start(self):
        super().start()
        raise ZeroDivisionError


class BreaksInStep(Noted):
    """Raises in its first step."""

    def step(self):
        raise ZeroDivisionError


class BreaksLater(Noted):
    """Raises in its second step."""

    def step(self):
        if "again" in self.context.noted:
            raise ZeroDivisionError
        self.context.noted.append("again")
        return RUNNING


LEAVES = {leaf.__name__: leaf for leaf in (Noted, BreaksAtOnce, BreaksInStep, BreaksLater)}


@pytest.mark.parametrize("kind", ["BreaksAtOnce", "BreaksInStep", "BreaksLater"])
@pytest.mark.parametrize("around", ["{}", "<Parallel><Noted/>{}</Parallel>", "<Repeat num_cycles='2'>{}</Repeat>"])
def test_what_was_entered_before_an_error_is_halted_once(kind, around):
    run = Run()
    run.noted = []
    tree = load_tree(TREE.format(around.format(f"<{kind}/>")), LEAVES, run)
    if kind == "BreaksLater":
        tree.tick()
    with pytest.raises(ZeroDivisionError):
        tree.tick()
    for _ in range(2):
        tree.halt()
    beside = ["Noted"] if "Noted" in around else []
    for name in (*beside, kind):
        assert [said for said in run.noted if said.startswith(f"{name} ")] == [f"{name} starts", f"{name} halts"]
    assert all(node.status is not RUNNING for node in tree.nodes())
