"""What a check says of a tree holds when the tree is ticked: tried on random trees."""

from __future__ import annotations

from btcpp_cases import random_case  # pyright: ignore[reportMissingImports]
from btcpp_reference import LEAVES  # pyright: ignore[reportMissingImports]

from mazeplan.behavior.check import check_tree
from mazeplan.behavior.treefile import load_tree
from mazeplan.core.errors import TreeError


class Ticked:
    """Context and probe of a tree: which nodes were ticked."""

    def __init__(self) -> None:
        self.lines = set()

    def clock(self):
        return 0.0

    def failed(self, failure):
        pass

    def note(self, *event):
        pass

    def before(self, node):
        self.lines.add(node.place.line)

    def after(self, node, result):
        pass


def test_a_node_that_is_never_ticked_by_a_check_is_not_ticked():
    told = 0
    for seed in range(400):
        case, ticked = random_case(seed), Ticked()
        try:
            tree = load_tree(case.xml, LEAVES, ticked)
        except TreeError:
            continue
        for key, value in case.board.items():
            tree.blackboard.give(key, value)
        unreached = {w.line for w in check_tree(tree).warnings if w.line and w.problem.startswith("never ticked")}
        for node in tree.nodes():
            node.probe = ticked
        try:
            for _ in range(case.ticks):
                tree.tick()
        except TreeError:  # of a script: the tree has come so far
            pass
        uses = [node.place.line for node in tree.nodes() if node.place]
        once = {line for line in unreached if uses.count(line) == 1}  # not in a tree that is used again
        assert not once & ticked.lines, (seed, once & ticked.lines)
        told += len(once)
    assert told > 50
