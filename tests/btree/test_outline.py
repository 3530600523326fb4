"""A tree as text: an outline with repeated SubTrees folded."""

from __future__ import annotations

import pytest

from mazeplan.behavior.registry import registry_with
from mazeplan.behavior.trees import load_tree
from mazeplan.btree.tree import tree_text

TWICE = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main"><Sequence><SubTree ID="Rest"/><Repeat num_cycles="2"><SubTree ID="Rest" name="more"/></Repeat>
  <LevelPlate name="end"/></Sequence></BehaviorTree>
  <BehaviorTree ID="Rest"><Fallback><Dither/><LevelPlate/></Fallback></BehaviorTree></root>"""


class Context:
    def clock(self):
        return 0.0


@pytest.fixture
def tree():
    return load_tree(TWICE, registry_with(), Context())


def test_a_subtree_that_stands_in_the_tree_again_is_folded(tree):
    assert len(tree_text(tree).splitlines()) == 8
    assert tree_text(tree).splitlines()[-2:] == [
        "│   └── SubTree 'more' ID=Rest (as above)", "└── LevelPlate 'end'"
    ]  # fmt: skip
    assert len(tree_text(tree, whole=True).splitlines()) == 11
