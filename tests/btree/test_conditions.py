"""Preconditions of nodes in a file: order, when they are looked at, whose blackboard, errors at the line."""

from __future__ import annotations

from typing import ClassVar

import pytest

from mazeplan.behavior.trees import load_tree
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.ports import Port
from mazeplan.btree.status import FAILURE, INVALID, RUNNING, SKIPPED, SUCCESS
from mazeplan.btree.tree import tree_text
from mazeplan.core.errors import TreeError

HEAD = '<root BTCPP_format="4" main_tree_to_execute="Main">\n<BehaviorTree ID="Main">\n'


class Run:
    def __init__(self):
        self.did = []

    def clock(self):
        return 0.0

    def failed(self, failure):
        pass


class Do(Leaf):
    """Succeeds."""

    ports: ClassVar[dict[str, Port]] = {"to": Port(str, None, "where", "out"), "text": Port(str, "", "what")}

    def step(self):
        self.context.did.append(self.name)
        self.set("to", self.get("text"))
        return SUCCESS


class Wait(Leaf):
    """Never ends."""

    def step(self):
        self.context.did.append(self.name)
        return RUNNING

    def halt(self):
        self.context.did.append(f"halt {self.name}")


LEAVES: dict[str, type[Leaf]] = {"Do": Do, "Wait": Wait}


def load(tmp_path, content, more="", **keys):
    path = tmp_path / "tree.xml"
    path.write_text(f"{HEAD}{content}\n</BehaviorTree>{more}</root>", encoding="utf-8")
    run = Run()
    tree = load_tree(path, LEAVES, run)
    for key, value in keys.items():
        tree.blackboard.set(key, value)
    return tree, run.did


@pytest.mark.parametrize(
    ("attributes", "result"),
    [
        ('_failureIf="x"', FAILURE),
        ('_successIf="x"', SUCCESS),
        ('_skipIf="x"', SKIPPED),
        ('_while="!x"', SKIPPED),
        ('_while="!x" _skipIf="x" _successIf="x" _failureIf="x"', FAILURE),  # in BehaviorTree.CPP's order
        ('_while="!x" _skipIf="x" _successIf="x" _failureIf="!x"', SUCCESS),
        ('_failureIf="x &amp;&amp; y" _skipIf="x"', SKIPPED),
    ],
)
@pytest.mark.parametrize(
    "node", ["<Wait {0}/>", "<Sequence {0}><Wait/></Sequence>", "<Inverter {0}><Wait/></Inverter>"]
)
def test_what_decides_is_not_ticked(tmp_path, node, attributes, result):
    tree, did = load(tmp_path, node.format(attributes), x=True, y=0)
    assert [tree.tick(), tree.tick()] == [result, result]
    assert tree.snapshot()[0][1] == result.name
    assert did == []
    tree.blackboard.set("x", False)
    tree.blackboard.set("y", True)
    if "_failureIf" not in attributes or "&amp;" in attributes:
        assert tree.tick() is RUNNING
        assert did == ["Wait"]


def test_only_while_is_looked_at_in_a_node_that_runs(tmp_path):
    tree, did = load(tmp_path, '<Wait _skipIf="x" _failureIf="x" _successIf="x" _while="!y"/>', x=False, y=False)
    assert tree.tick() is RUNNING
    tree.blackboard.set("x", True)
    assert tree.tick() is RUNNING
    tree.blackboard.set("y", True)
    assert tree.tick() is SKIPPED
    assert did == ["Wait", "Wait", "halt Wait"]
    tree.halt()
    assert did.count("halt Wait") == 1


def test_while_halts_all_that_runs_below(tmp_path):
    tree, did = load(tmp_path, '<Sequence _while="go"><Do/><Wait/></Sequence>', go=True)
    assert tree.tick() is RUNNING
    tree.blackboard.set("go", "false")  # text reads as what it says
    assert tree.tick() is SKIPPED
    assert did == ["Do", "Wait", "halt Wait"]
    assert dict(tree.snapshot())["Sequence/Wait"] == "INVALID"
    tree.blackboard.set("go", 1)
    assert tree.tick() is RUNNING
    assert did[3:] == ["Do", "Wait"]


def test_a_skipped_child_is_shown_and_the_next_is_ticked(tmp_path):
    tree, did = load(tmp_path, '<Sequence><Do name="a" _skipIf="n &gt; 1"/><Do name="b"/></Sequence>', n=2)
    assert tree.tick() is SUCCESS
    assert did == ["b"]
    assert tree.snapshot() == [("Sequence", "SUCCESS"), ("Sequence/a", "SKIPPED"), ("Sequence/b", "SUCCESS")]
    assert tree.root.last is SUCCESS


def test_names_are_those_around_a_subtree_and_within_it_those_of_its_ports(tmp_path):
    more = '<BehaviorTree ID="S"><Do name="in" _skipIf="k == \'no\'"/></BehaviorTree>'
    content = '<Sequence><Do to="{w}" text="{t}"/><SubTree ID="S" k="{w}" _skipIf="w == \'out\'"/></Sequence>'
    for text, expected in (("out", ["Do"]), ("no", ["Do"]), ("yes", ["Do", "in"])):
        tree, did = load(tmp_path, content, more, t=text)
        assert tree.tick() is SUCCESS
        assert did == expected
    tree, did = load(tmp_path, '<SubTree ID="S" k="{w}" _skipIf="k == \'out\'"/>', more, w="yes")
    with pytest.raises(TreeError, match=r"tree.xml:3: Main/S: _skipIf: the blackboard has no 'k'; it has w"):
        tree.tick()


def test_the_explicit_form_takes_them_too(tmp_path):
    assert load(tmp_path, '<Action ID="Do" _skipIf="true"/>')[0].tick() is SKIPPED


@pytest.mark.parametrize(
    ("expression", "said"),
    [
        ("k", "_skipIf: the blackboard has no 'k'; it has n"),
        ("n - 'x'", "_skipIf: got 'x' beside -, expected a number"),
        ("1 / (n - 1)", "_skipIf: got 1 / 0, expected a divisor"),
    ],
)
def test_an_expression_without_a_value_is_an_error_at_its_line(tmp_path, expression, said):
    tree, did = load(tmp_path, f'<Parallel>\n<Wait/>\n<Do _skipIf="{expression}"/></Parallel>', n=1)
    with pytest.raises(TreeError) as error:
        tree.tick()
    assert str(error.value).startswith(f"{tmp_path / 'tree.xml'}:5: Main/Parallel/Do: {said}")
    tree.halt()
    assert did == ["Wait", "halt Wait"]
    assert all(node.status is INVALID for node in tree.nodes())


def test_conditions_are_shown(tmp_path):
    content = '<Wait _skipIf="n &lt; 2 &amp;&amp; s == \'a$\'" _while="go"/>'
    tree, _ = load(tmp_path, f"<Sequence>{content}</Sequence>")
    assert tree_text(tree).splitlines()[1] == '└── Wait _skipIf="n < 2 && s == \'a$\'" _while="go"'


def test_a_threshold_that_so_few_children_cannot_reach_is_an_error_at_its_line(tmp_path):
    tree, _ = load(tmp_path, '<Parallel success_count="{n}"><Do/></Parallel>', n=2)
    with pytest.raises(TreeError, match=r"tree.xml:3: Main/Parallel: success_count: got 2, expected at most .* 1"):
        tree.tick()
