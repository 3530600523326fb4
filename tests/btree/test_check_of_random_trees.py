"""What a check says of a tree holds when the tree is ticked: tried on random trees."""

from __future__ import annotations

import re
from contextlib import suppress

import pytest
from btcpp_cases import KEYS, random_case  # pyright: ignore[reportMissingImports]
from btcpp_reference import LEAVES  # pyright: ignore[reportMissingImports]

from mazeplan.behavior.trees import check_tree, load_tree
from mazeplan.btree.blackboard import EMPTY
from mazeplan.btree.key_uses import scope_of
from mazeplan.core.errors import TreeError

READS = re.compile(r"reads {(\w+)}, which .* later$")


class Ticked:
    """Context and probe of a tree: which nodes were ticked, and which keys had a value when a node was first ticked."""

    def __init__(self) -> None:
        self.lines, self.had = set(), {}

    def clock(self):
        return 0.0

    def failed(self, failure):
        pass

    def note(self, *event):
        pass

    def before(self, node):
        self.lines.add(node.place.line)
        entries = ((name, scope_of(node).find(name)) for name in KEYS)
        self.had.setdefault(id(node), {name for name, entry in entries if entry and entry.value is not EMPTY})

    def after(self, node, result):
        pass


def tick_all(tree, case, ticked):
    for node in tree.nodes():
        node.probe = ticked
    with suppress(TreeError):  # of a script: the tree has come so far
        for _ in range(case.ticks):
            tree.tick()


@pytest.mark.slow
def test_a_node_that_is_never_ticked_by_a_check_is_not_ticked():
    told = 0
    for seed in range(400):
        case, ticked = random_case(seed), Ticked()
        try:
            tree = load_tree(case.xml, LEAVES, ticked)
        except TreeError:
            continue
        for key, value in case.board.items():
            tree.blackboard.set_external(key, value)
        unreached = {w.line for w in check_tree(tree).warnings if w.line and w.problem.startswith("never ticked")}
        tick_all(tree, case, ticked)
        uses = [node.place.line for node in tree.nodes() if node.place]
        once = {line for line in unreached if uses.count(line) == 1}  # not in a tree that is used again
        assert not once & ticked.lines, (seed, once & ticked.lines)
        told += len(once)
    assert told > 50


@pytest.mark.slow
def test_a_key_that_is_read_too_early_by_a_check_has_no_value_when_its_reader_is_ticked():
    seen = 0
    for seed in range(2500):
        case, ticked = random_case(seed), Ticked()
        try:  # nothing has a value before the tree sets it
            tree = load_tree(case.xml, LEAVES, ticked)
        except TreeError:
            continue
        found = ((w.line, READS.search(w.problem)) for w in check_tree(tree).warnings)
        early = [(line, match[1]) for line, match in found if match]
        nodes = list(tree.nodes())
        tick_all(tree, case, ticked)
        for line, key in early:
            at_line = [node for node in nodes if node.place and node.place.line == line]
            if len(at_line) == 1 and id(at_line[0]) in ticked.had:
                assert key not in ticked.had[id(at_line[0])], (seed, line, key)
                seen += 1
    assert seen > 50
