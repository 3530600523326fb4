"""Trees from files: what is read, what is refused, and where the error is said to be."""

from __future__ import annotations

import time
from typing import ClassVar

import pytest

from mazeplan.behavior.registry import REGISTRY
from mazeplan.behavior.trees import load_tree, tree_names
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.ports import REQUIRED, Port
from mazeplan.btree.status import Status
from mazeplan.btree.tree import tree_text
from mazeplan.btree.treefile import write_palette
from mazeplan.core.errors import TreeError


class Run:
    def __init__(self):
        self.said, self.failures = [], []

    def clock(self):
        return 0.0

    def failed(self, failure):
        self.failures.append(failure)


class Say(Leaf):
    """Says a word."""

    ports: ClassVar[dict[str, Port]] = {
        "word": Port(str, REQUIRED, "what to say"),
        "times": Port(int, 1, "how often"),
        "said": Port(str, None, "what was said", "out"),
        "loud": Port(bool, False, "whether to shout"),
    }

    def step(self):
        words = [self.get("word")] * self.get("times")
        self.context.said.extend(word.upper() if self.get("loud") else word for word in words)
        self.set("said", self.get("word"))
        return Status.SUCCESS


LEAVES = {"Say": Say}
HEAD = '<root BTCPP_format="4" main_tree_to_execute="Main">\n'


def load(tmp_path, body, registry=LEAVES, run=None):
    path = tmp_path / "tree.xml"
    path.write_text(HEAD + body + "\n</root>", encoding="utf-8")
    return load_tree(path, registry, run or Run())


def main(content):
    return f'<BehaviorTree ID="Main">\n{content}\n</BehaviorTree>'


SUB = '<BehaviorTree ID="S"><Say word="w" times="{n}"/></BehaviorTree>'


def test_both_forms_ports_and_names(tmp_path):
    run = Run()
    tree = load(
        tmp_path,
        main(
            '<Sequence name="all"><Say word="a" times="2"/><Action ID="Say" word="b" loud="true" said="{x}"/>'
            '<Say word="{x}"/></Sequence>'
        ),
        run=run,
    )
    assert tree.tick() is Status.SUCCESS
    assert run.said == ["a", "a", "B", "b"]
    assert tree.blackboard.get("x") == "b"
    assert [path for path, _ in tree.snapshot()][:2] == ["all", "all/Say"]


def test_subtrees_have_blackboards_of_their_own_but_for_ports(tmp_path):
    run = Run()
    body = main(
        '<Sequence><Say word="one" said="{outer}"/><SubTree ID="Sub" inner="{outer}" fixed="two"/>'
        '<Say word="{result}"/></Sequence>'
    ).replace('inner="{outer}"', 'inner="{outer}" result="{result}"')
    body += (
        '<BehaviorTree ID="Sub"><Sequence><Say word="{inner}"/><Say word="{fixed}" said="{result}"/>'
        '<Say word="secret" said="{private}"/></Sequence></BehaviorTree>'
    )
    tree = load(tmp_path, body, run=run)
    assert tree.tick() is Status.SUCCESS
    assert run.said == ["one", "one", "two", "secret", "two"]
    assert "private" not in tree.blackboard


def test_two_trees_in_one_process_do_not_see_each_other(tmp_path):
    first, second = (load(tmp_path, main('<Say word="a" said="{x}"/>')) for _ in range(2))
    first.tick()
    assert "x" in first.blackboard
    assert "x" not in second.blackboard


@pytest.mark.parametrize(
    ("body", "line", "said"),
    [
        (main("<Sai word='a'/>"), 3, "did you mean Say?"),
        (main("<Say/>"), 3, "word is missing"),
        (main("<Say word='a' colour='red'/>"), 3, "unknown attribute 'colour', expected one of name, word, times"),
        (main("<Say word='a' times='two'/>"), 3, "got 'two', expected a whole number"),
        (main("<Say word='a' loud='maybe'/>"), 3, "got 'maybe', expected true or false"),
        (main("<Say word='a' said='x'/>"), 3, "blackboard entry such as {said}"),
        (main("<Sequence>\n</Sequence>"), 3, "got 0 children, expected at least 1"),
        (main("<Inverter>\n<Say word='a'/>\n<Say word='b'/>\n</Inverter>"), 3, "got 2 children, expected exactly 1"),
        (main("<Say word='a'>\n<Say word='b'/></Say>"), 3, "is a leaf"),
        (main("<SubTree ID='Other'/>"), 3, "got 'Other', expected one of Main"),
        (main("<Sequence>\n<SubTree ID='Main'/></Sequence>"), 4, "contains itself: Main > Main"),
        (main("<RetryUntilSuccessful>\n<Say word='a'/></RetryUntilSuccessful>"), 3, "num_attempts is missing"),
        (main("<Say word='a'/>") + "\n" + main("<Say word='b'/>"), 5, "second tree of this name"),
        (main("<Say word='a'/><Say word='b'/>"), 2, "exactly one root node"),
        (main("<Action word='a'/>"), 3, "<Action> without ID"),
        ("<BehaviorTree>\n<Say word='a'/></BehaviorTree><BehaviorTree ID='B'/>", 2, "without ID"),
        (
            "<BehaviorTree ID='Root'>\n<Say word='a'/></BehaviorTree>",
            2,
            "ID: got 'Root', expected a name other than Root",
        ),
        ("<BehaviorTree ID='a b'>\n<Say word='a'/></BehaviorTree>", 2, "ID: got 'a b', expected a name other than"),
        (
            "<BehaviorTree ID='Repeat'>\n<Say word='a'/></BehaviorTree>",
            2,
            "ID: got 'Repeat', which is the name of a node",
        ),
        ("<BehaviorTree ID='Else'><Say word='a'/></BehaviorTree>", 1, "got 'Main', expected one of Else"),
        ("<include/>", 2, "include: got no attribute, expected path alone"),
        ("<include path='navigate.xml' ros_pkg='x'/>", 2, "include: got path, ros_pkg, expected path alone"),
        ("<include path='other.xml'/>", 2, "include: got 'other.xml', expected an XML file, seen from"),
        (f"<include path='{'x' * 5000}.xml'/>", 2, "include: got 'xxx"),
        (main("<Say word='{my key}'/>"), 3, "got '{my key}', expected {key} of letters"),
        (main("<Say word='a' times='1_0'/>"), 3, "got '1_0', expected a whole number"),
        (
            main("<Say word='a' _skipIf='x ] 1'/>"),
            3,
            "Main/Say: _skipIf: column 3: got '] 1', expected numbers, 'text'",
        ),
        (main("<Say word='a' _onSuccess='x ] 1'/>"), 3, "_onSuccess: column 3: got"),
        (main("<Sequence _while='(a'>\n<Say word='a'/></Sequence>"), 3, "_while: column 3: got the end, expected"),
        (main("<Sequence name='a&#10;b'><Say word='a'/></Sequence>"), 3, "printing characters"),
        (main("<Decorator ID='Say' word='a'/>"), 3, 'expected <Action ID="Say">'),
        (main("<Action ID='Inverter'><Say word='a'/></Action>"), 3, 'expected <Decorator ID="Inverter">'),
        (main("<Timeout msec='-1'><Say word='a'/></Timeout>"), 3, "got '-1', expected a whole number >= 0"),
        (main("<Repeat num_cycles='-2'><Say word='a'/></Repeat>"), 3, "got '-2', expected a whole number >= -1"),
        (main("<Parallel success_count='2'>\n<Say word='a'/></Parallel>"), 3, "at most its number of children, 1"),
        (main("<SubTree ID='S'>\n<Say word='a'/></SubTree>") + SUB, 3, "a SubTree has no children"),
        (main("<SubTree ID='S' _successIf='1 +'/>") + SUB, 3, "Main/S: _successIf: column 4: got the end"),
        (main("<SubTree ID='S' _autoremap='perhaps'/>") + SUB, 3, "got 'perhaps', expected true or false"),
        (
            main("<SubTree ID='S' n='three'/>") + "\n" + SUB,
            5,
            "Main/S/Say: times: got 'three' from {n}, which a SubTree gives, expected a whole number",
        ),
        ("<BehaviorTree ID='Main' colour='red'><Say word='a'/></BehaviorTree>", 2, "unknown attribute 'colour'"),
        ("", 1, "no <BehaviorTree"),
        (main("<Sequence>\n<Say word='a'/>\n"), None, "not XML"),
        (main("<Say word=“a”/>"), 3, "not XML: AttValue"),
        (main("<Say word=a/>"), 3, "not XML: AttValue"),
    ],
)
def test_errors_name_file_line_and_what_is_allowed(tmp_path, body, line, said):
    with pytest.raises(TreeError) as error:
        load(tmp_path, body)
    assert said in str(error.value)
    assert str(error.value).startswith(f"{tmp_path / 'tree.xml'}:{'' if line is None else line}")
    assert "\n" not in str(error.value)


def test_an_error_names_the_path_in_the_tree(tmp_path):
    with pytest.raises(TreeError, match=r"Main/all/again/Say: times: got"):
        load(
            tmp_path,
            main('<Sequence name="all"><Inverter name="again"><Say word="a" times="x"/></Inverter></Sequence>'),
        )


def test_trees_that_are_not_used_are_checked_too(tmp_path):
    with pytest.raises(TreeError, match="did you mean Say"):
        load(tmp_path, main("<Say word='a'/>") + "<BehaviorTree ID='Unused'><Sya word='a'/></BehaviorTree>")


ENTITY = (
    '<?xml version="1.0" encoding="utf-16"?><!DOCTYPE root [<!ENTITY a "hello">]>'
    + HEAD
    + "<BehaviorTree ID='Main'><Say word='&a;'/></BehaviorTree></root>"
)
DTD = ENTITY.replace('[<!ENTITY a "hello">]', 'SYSTEM "file:///etc/passwd"').replace("&a;", "a")
BOMB = "<!DOCTYPE r [" + "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10 if i else "x"}">' for i in range(9)) + "]>"


@pytest.mark.parametrize(
    "data",
    [
        ENTITY.encode("utf-16"),
        DTD.encode("utf-16"),
        b'<?xml version="1.0" encoding="UTF-7"?>' + ENTITY.partition("?>")[2].replace("<!", "+ADwAIQ-").encode(),
        HEAD.encode() + b"<BehaviorTree ID='Main'><Say word='a' times='" + b"9" * 900_000 + b"'/></BehaviorTree>"
        + b"</root>",
        HEAD.encode() + b"<BehaviorTree ID='" + b"n" * 900_000 + b"'><Nope/></BehaviorTree></root>",
        b"",
        b"\x00\x01\x02",
        b"rings: [1, 2]",
        BOMB.encode() + b"<root>&e8;</root>",
        b'<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><root>&x;</root>',
        BOMB.encode("utf-16"),
        b"<root>" * 100_000,
        HEAD.encode() + b"<!--" + b"x" * 2_000_000 + b"--></root>",
        HEAD.encode() + b"<BehaviorTree ID='Main'>" + b"<Inverter>" * 200 + b"<Say word='a'/>" + b"</Inverter>" * 200
        + b"</BehaviorTree></root>",
    ],
    ids=["utf-16 entity", "utf-16 dtd", "utf-7", "long value", "long name",
         "empty", "binary", "yaml", "laughs", "external", "utf-16", "deep", "large", "nested"],
)  # fmt: skip
def test_hostile_files_are_refused_at_once(tmp_path, data):
    path = tmp_path / "hostile.xml"
    path.write_bytes(data)
    began = time.perf_counter()
    with pytest.raises(TreeError) as error:
        load_tree(path, LEAVES, Run())
    assert time.perf_counter() - began < 5.0  # a bound for a crash or a bomb, not a measure of speed
    assert "root:" not in str(error.value)
    assert len(str(error.value)) < 1000
    assert "\n" not in str(error.value)


def test_packaged_trees_load_and_can_be_shown():
    assert "navigate" in tree_names()
    for name in tree_names():
        tree = load_tree(name, REGISTRY, Run())
        text = tree_text(tree, whole=True)
        assert "PassOpening opening={opening}" in text
        assert len(text.splitlines()) == len(list(tree.nodes()))


def test_halt(tmp_path):
    class Wait(Leaf):
        """Never ends."""

        halted = 0

        def step(self):
            return Status.RUNNING

        def halt(self):
            Wait.halted += 1

    registry = {**LEAVES, "Wait": Wait}
    tree = load(tmp_path, main('<Sequence name="s"><Say word="a"/><Wait name="w"/></Sequence>'), registry)
    assert tree.tick() is Status.RUNNING
    assert ("s/w", "RUNNING") in tree.snapshot()
    tree.halt()
    tree.halt()
    assert Wait.halted == 1


def test_palette_has_every_leaf_with_its_ports():
    from lxml import etree

    root = etree.fromstring(write_palette(REGISTRY))
    actions = {action.get("ID"): action for action in root.iter("Action", "Condition")}
    assert set(actions) == set(REGISTRY)
    ports = {port.get("name"): port for port in actions["Track"]}
    assert ports["timeout_s"].get("default") == "4.0"
    assert ports["opening"].get("default") is None
    assert [p.tag for p in actions["ChooseOpening"]] == ["input_port", "input_port", "output_port"]
