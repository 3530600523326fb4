"""Ports at run time: where values come from, what they become, and the errors at the line of the node."""

from __future__ import annotations

from typing import ClassVar

import pytest

from mazeplan.behavior.trees import load_tree
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.ports import REQUIRED, Port
from mazeplan.btree.status import Status
from mazeplan.btree.tree import tree_text
from mazeplan.btree.treefile import write_palette
from mazeplan.core.errors import TreeError

HEAD = '<root BTCPP_format="4" main_tree_to_execute="Main">\n'


class Run:
    def __init__(self):
        self.now, self.seen, self.halted = 0.0, [], []

    def clock(self):
        return self.now

    def failed(self, failure):
        pass


class Take(Leaf):
    """Takes a value of each type."""

    category = "Condition"
    ports: ClassVar[dict[str, Port]] = {
        "number": Port(int, 0, "a count", least=0),
        "real": Port(float, 0.5, "a size"),
        "flag": Port(bool, True, "yes or no"),
        "words": Port(list, ["a", "b"], "some words"),
        "thing": Port(str, None, "anything"),
    }

    def step(self):
        self.context.seen.append(tuple(self.get(port) for port in self.ports))
        return Status.SUCCESS


class Put(Leaf):
    """Puts a text."""

    ports: ClassVar[dict[str, Port]] = {"text": Port(str, REQUIRED, "what"), "to": Port(str, None, "where", "out")}

    def step(self):
        self.set("to", self.get("text"))
        return Status.SUCCESS


class Wait(Leaf):
    """Never ends."""

    def step(self):
        return Status.RUNNING

    def halt(self):
        self.context.halted.append(self.name)


class Break(Leaf):
    """Raises."""

    def step(self):
        raise RuntimeError("broken")


class Odd(Leaf):
    """Forgets to return a status."""

    def step(self):
        return None


LEAVES: dict[str, type[Leaf]] = {leaf.__name__: leaf for leaf in (Take, Put, Wait, Break, Odd)}


def load(tmp_path, content, more="", run=None) -> tuple:
    path = tmp_path / "tree.xml"
    path.write_text(f'{HEAD}<BehaviorTree ID="Main">\n{content}\n</BehaviorTree>{more}</root>', encoding="utf-8")
    run = run or Run()
    return load_tree(path, LEAVES, run), run


def tree_s(content):
    return f'<BehaviorTree ID="S">{content}</BehaviorTree>'


def test_a_literal_given_to_a_subtree_has_the_type_of_the_port_that_reads_it(tmp_path):
    inside = '<Take number="{n}" real="{x}" flag="{f}" words="{w}" thing="{n}"/>'
    tree, run = load(tmp_path, '<SubTree ID="S" n="3" x="4" f="false" w="p;q"/>', tree_s(inside))
    assert tree.tick() is Status.SUCCESS
    assert run.seen == [(3, 4.0, False, ["p", "q"], "3")]


def test_the_type_is_kept_through_two_subtrees(tmp_path):
    more = tree_s('<SubTree ID="T" m="{n}"/>') + '<BehaviorTree ID="T"><Take number="{m}"/></BehaviorTree>'
    tree, run = load(tmp_path, '<SubTree ID="S" n="7"/>', more)
    tree.tick()
    assert run.seen[0][0] == 7
    with pytest.raises(TreeError, match=r"Main/S/T/Take: number: got -7 from \{m\}, which a SubTree gives, expected"):
        load(tmp_path, '<SubTree ID="S" n="-7"/>', more)


def test_objects_and_numbers_from_the_program_pass(tmp_path):
    tree, run = load(tmp_path, '<Take number="{n}" real="{n}" words="{w}" thing="{o}"/>')
    thing = object()
    for key, value in {"n": 2, "w": ("a",), "o": thing}.items():
        tree.blackboard.set(key, value)
    tree.tick()
    assert run.seen == [(2, 2, True, ("a",), thing)]


@pytest.mark.parametrize(
    ("port", "value", "said"),
    [
        ("number", "two", "number: got 'two' from {k}, expected a whole number >= 0"),
        ("number", -1, "number: got -1 from {k}, expected a whole number >= 0"),
        ("number", 1.5, "number: got 1.5 from {k}, expected a whole number"),
        ("number", True, "number: got True from {k}, expected a whole number"),
        ("real", float("nan"), "real: got nan from {k}, expected a finite number"),
        ("real", None, "real: got None from {k}, expected a finite number"),
        ("flag", 2, "flag: got 2 from {k}, expected true or false"),
        ("words", object, "words: got <class 'object'> from {k}, expected words separated by ;"),
    ],
)
def test_a_value_of_the_wrong_type_is_an_error_at_the_node(tmp_path, port, value, said):
    tree, _ = load(tmp_path, f'<Sequence>\n<Take {port}="{{k}}"/></Sequence>')
    tree.blackboard.set("k", value)
    with pytest.raises(TreeError) as error:
        tree.tick()
    assert str(error.value).startswith(f"{tmp_path / 'tree.xml'}:4: Main/Sequence/Take: {said}")


def test_a_key_that_was_never_set_is_an_error_at_the_node(tmp_path):
    tree, _ = load(tmp_path, '<Repeat num_cycles="{often}">\n<Wait/></Repeat>')
    tree.blackboard.set("goal", 5)
    with pytest.raises(TreeError, match=r"tree.xml:3: Main/Repeat: num_cycles: .* no 'often'; it has goal"):
        tree.tick()


def test_a_leaf_that_returns_no_status_is_named(tmp_path):
    tree, _ = load(tmp_path, '<Odd name="mine"/>')
    with pytest.raises(TreeError, match=r"tree.xml:3: Main/mine: Odd.step returned None, expected RUNNING"):
        tree.tick()


def test_equal_sign_autoremap_and_private_keys(tmp_path):
    more = tree_s('<Sequence><Take thing="{k}"/><Put text="in" to="{k}"/><Put text="own" to="{_p}"/></Sequence>')
    for given in ('k="{=}"', '_autoremap="true"', 'k=" {k} "'):
        content = f'<Sequence><Put text="out" to="{{k}}"/><SubTree ID="S" {given}/></Sequence>'
        tree, run = load(tmp_path, content, more)
        assert tree.tick() is Status.SUCCESS
        assert run.seen[0][-1] == "out"
        assert tree.blackboard.get("k") == "in"
        assert "_p" not in tree.blackboard


def test_a_literal_stays_inside_whatever_is_remapped(tmp_path):
    tree, run = load(tmp_path, '<SubTree ID="S" k="lit" _autoremap="true"/>', tree_s('<Take thing="{k}"/>'))
    tree.tick()
    assert run.seen[0][-1] == "lit"
    assert "k" not in tree.blackboard


def test_a_retry_asks_for_its_limit_after_each_attempt(tmp_path):
    content = (
        '<RetryUntilSuccessful num_attempts="{n}"><ForceFailure><Sequence><Take/><Put text="2" to="{n}"/></Sequence>'
        "</ForceFailure></RetryUntilSuccessful>"
    )
    tree, run = load(tmp_path, content)
    tree.blackboard.set("n", 5)
    assert tree.tick() is Status.FAILURE
    assert len(run.seen) == 2


@pytest.mark.parametrize("content", ["<Parallel><Wait/><Break/></Parallel>", "<Sequence><Break/></Sequence>"])
def test_halt_reaches_what_an_exception_left_running(tmp_path, content):
    tree, run = load(tmp_path, content)
    with pytest.raises(RuntimeError, match="broken"):
        tree.tick()
    tree.halt()
    tree.halt()
    assert run.halted == ["Wait"] * ("Wait" in content)
    assert all(node.status is Status.INVALID for node in tree.nodes())


def test_what_editors_note_in_a_file_is_no_port(tmp_path):
    note = '_description="why" _fullpath="a/b" _uid="3"'
    tree, _ = load(tmp_path, f'<Sequence {note}><Take {note}/><SubTree ID="S" {note}/></Sequence>', tree_s("<Take/>"))
    assert tree.tick() is Status.SUCCESS


def test_a_named_subtree_goes_by_its_name(tmp_path):
    tree, _ = load(tmp_path, '<SubTree ID="S" name="there" n="3"/>', tree_s('<Take number="{n}"/>'))
    assert [path for path, _ in tree.snapshot()] == ["there", "there/Take"]
    assert tree_text(tree).splitlines() == ["SubTree 'there' ID=S n=3", "└── Take number={n}"]


def test_a_list_of_numbers_is_drawn_and_in_the_palette(tmp_path):
    class Pick(Take):
        """Takes some numbers."""

        ports: ClassVar[dict[str, Port]] = {"some": Port(list, [1, 2], "which", choices=(1, 2, 3))}

    path = tmp_path / "tree.xml"
    path.write_text(f'{HEAD}<BehaviorTree ID="Main"><Pick some="3;2"/></BehaviorTree></root>')
    assert tree_text(load_tree(path, {"Pick": Pick}, Run())) == "Pick some=3;2"
    assert 'default="1;2"' in write_palette({"Pick": Pick})
