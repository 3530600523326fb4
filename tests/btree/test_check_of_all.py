"""`behavior check` tells all mistakes of a file in one go, and what does no harm as warnings."""

from __future__ import annotations

import json

import pytest
from commands import call as run_command
from tree_checks import HEAD, Still, found_in, lines_of, main

from mazeplan.behavior.registry import registry_with
from mazeplan.behavior.trees import check_file, load_tree
from mazeplan.core.errors import TreeError

MANY = (
    '<BehaviorTree ID="Main" colour="red"><Sequence nam="all">',
    '<Sai word="a"><Setle/></Sai>',
    '<Settle ring="one" hold_s="none"/>',
    '<Repeat num_cycles="x"><Replan times="2"/></Repeat>',
    '<Settle ring="{rong}" _skipIf="1 +"/>',
    '<SubTree ID="Lag"/>',
    "<Inverter><Replan/><Replan/></Inverter>",
    '<Parallel success_count="3"><Replan/></Parallel>',
    '<SubTree ID="Leg"/><SubTree ID="Leg"/>',
    "</Sequence></BehaviorTree>",
    '<BehaviorTree ID="Leg"><Sequence><InRing ring="x"/></Sequence></BehaviorTree>',
    '<BehaviorTree ID="Main"><Replan/></BehaviorTree><Tree/>',
)


def test_all_mistakes_of_a_file_are_told_each_once():
    found = found_in(*MANY)
    assert lines_of(found.errors) == [
        (2, "unknown"), (2, "unknown"), (3, "unknown"), (3, "unknown"), (4, "ring:"),
        (5, "num_cycles:"), (5, "unknown"), (6, "_skipIf:"), (7, "SubTree:"), (8, "Inverter:"), (9, "success_count:"),
        (12, "ring:"), (13, "a"), (13, "got"),
    ]  # fmt: skip
    assert found.nodes is None


def test_every_other_reader_raises_at_the_first_mistake():
    with pytest.raises(TreeError, match="unknown attribute 'colour'"):
        load_tree(HEAD + "\n".join(MANY[:10]) + "\n</root>", registry_with(), Still())


def test_mistakes_of_the_file_itself_come_before_those_of_files_that_it_includes(tmp_path):
    (tmp_path / "a.xml").write_text(
        HEAD.replace(' main_tree_to_execute="Main"', "")
        + '<BehaviorTree ID="Other"><Sequence>'
        + "<Sai/>\n" * 30
        + "</Sequence></BehaviorTree></root>"
    )
    path = tmp_path / "tree.xml"
    path.write_text(HEAD + '<include path="a.xml"/>' + main('\n<InRing ring="x"/>') + "</root>")
    errors = check_file(path, registry_with(), Still()).errors
    assert [(e.file, e.line) for e in errors[:2]] == [(path, 3), (tmp_path / "a.xml", 2)]
    assert str(errors[-1]) == f"{path}: and 11 more mistakes"


def test_a_file_that_multiplies_is_given_up():
    trees = [main('<SubTree ID="T0"/>')]
    for i in range(30):
        inner = f'<SubTree ID="T{i + 1}"/>' * 2 if i < 29 else "<Sai/>"
        trees.append(f'<BehaviorTree ID="T{i}"><Sequence>{inner}</Sequence></BehaviorTree>')
    found = found_in(*trees)
    assert found.nodes is None
    assert [e.problem for e in found.errors if "more than" in e.problem] == ["more than 5000 nodes"]


@pytest.mark.parametrize("levels", [61, 250])
def test_nesting_has_a_limit(levels):
    text = HEAD + main("<Inverter>\n" * levels + "<Replan/>" + "</Inverter>" * levels) + "</root>"
    with pytest.raises(TreeError, match=r"^<text>:\d+:( \S+)? more than 60 levels of nesting$"):
        load_tree(text, registry_with(), Still())


def test_a_node_of_ones_own_that_cannot_be_made_is_one_mistake(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "unmade_nodes.py").write_text(
        "from mazeplan import Control\n"
        "class Bad(Control):\n    def __init__(self, *more):\n        raise KeyError('k')\n    def run(self): ...\n"
        "class Lazy(Control):\n    def __init__(self, *more): pass\n    def run(self): ...\n"
    )
    found = found_in(
        main("<Sequence>\n<Bad><Replan/></Bad><Lazy><Replan/></Lazy>\n<Nope/></Sequence>"), module=["unmade_nodes"]
    )
    bad, lazy, nope = sorted(found.errors, key=lambda e: e.problem)
    assert (bad.line, lazy.line, nope.line) == (3, 3, 4)
    assert bad.problem.startswith("Bad could not be made: ")
    assert bad.problem.endswith("unmade_nodes.py:4: KeyError: 'k'")
    assert lazy.problem.endswith("its __init__ does not call super().__init__(name, children, clock, board, values)")
    assert nope.problem.startswith("unknown node 'Nope'")


def test_they_go_out_one_line_each_and_with_json(tmp_path, monkeypatch, capsys):
    path = tmp_path / "tree.xml"
    path.write_text(HEAD + main('<Sequence>\n<Replam/>\n<InRing ring="x"/></Sequence>') + "</root>")
    code, out, err = run_command(monkeypatch, capsys, "behavior", "check", str(path))
    assert (code, out) == (2, "")
    assert [line.split(": ")[1:3] for line in err.splitlines()] == [
        [f"{path}:3", "Main/Sequence/Replam"], [f"{path}:4", "Main/Sequence/InRing"],
    ]  # fmt: skip
    code, out, _ = run_command(monkeypatch, capsys, "behavior", "check", str(path), "--json")
    (document,) = json.loads(out)
    assert (code, document["nodes"], len(document["errors"])) == (2, None, 2)
    assert document["error"] == document["errors"][0]


LEG = (
    '<BehaviorTree ID="Leg"><Sequence><InRing ring="{ring}"/><SubTree ID="Deep" to="{ring}"/></Sequence></BehaviorTree>'
)
DEEP = '<BehaviorTree ID="Deep"><Settle ring="{to}" hold_s="{hold}"/></BehaviorTree>'


def test_a_port_that_a_subtree_misses_is_told_at_the_call_once():
    found = found_in(main('<Sequence><SubTree ID="Leg" ring="2"/>\n<SubTree ID="Leg"/></Sequence>'), LEG, DEEP)
    assert [(e.line, e.problem) for e in found.errors] == [
        (3, "ring is missing: inside, InRing reads {ring} at <text>:4"),
        (4, "hold is missing: inside, Settle reads {hold} at <text>:5"),
    ]


def test_a_wrong_value_that_a_subtree_gives_is_told_where_it_is_read():
    leg = LEG.replace("<Sequence>", '<Sequence><Settle ring="{ring}"/>')
    found = found_in(main('<Sequence><SubTree ID="Leg" ring="2.5"/></Sequence>'), leg, DEEP)
    assert next((e.line, e.key, e.problem) for e in found.errors) == (
        3, "Main/Sequence/Leg/Sequence/Settle",
        "ring: got 2.5 from {ring}, which a SubTree gives, expected a whole number",
    )  # fmt: skip


PASS = '<BehaviorTree ID="Pass"><SubTree ID="Leg" ring="{gate}"/></BehaviorTree>'


def test_a_key_that_nothing_sets_is_told_at_the_outermost_call_that_gives_it_once():
    leg = '<BehaviorTree ID="Leg"><Sequence><InRing ring="{ring}"/><Settle ring="{ring}"/></Sequence></BehaviorTree>'
    content = '<Sequence><SubTree ID="Pass" gate="{gaol}"/>\n<SubTree ID="Leg" ring="{gaol}"/></Sequence>'
    found = found_in(main(content), PASS, leg)
    assert [(e.line, e.problem) for e in found.errors] == [
        (2, "gate: nothing sets {gaol}; inside, InRing reads {ring} at <text>:5; did you mean {goal}?"),
        (3, "ring: nothing sets {gaol}; inside, InRing reads {ring} at <text>:5; did you mean {goal}?"),
    ]
    auto = found_in(main('<SubTree ID="Leg" _autoremap="true"/>'), leg).errors
    assert [(e.line, e.problem.partition(";")[0]) for e in auto] == [(3, "ring: nothing sets {ring}")]


def test_a_tree_that_contains_itself_is_a_mistake():
    trees = (
        '<BehaviorTree ID="A"><SubTree ID="B"/></BehaviorTree>\n<BehaviorTree ID="B"><SubTree ID="A"/></BehaviorTree>'
    )
    found = found_in(main('<Sequence><SubTree ID="Main"/><SubTree ID="A"/><SubTree ID="B"/></Sequence>'), trees)
    assert {(e.line, e.problem) for e in found.errors} == {
        (2, "Main contains itself: Main > Main"),
        (3, "B contains itself: B > A > B"),
        (4, "A contains itself: A > B > A"),
    }


def test_an_element_that_has_lost_its_first_sign_is_a_mistake_other_text_is_ignored():
    found = found_in(
        'include path="a.xml"/>;',
        "<!-- a comment",
        "of two lines -->",
        main('<Sequence>\n<Replan/><!--\n\n-->\n  Settle ring="2"/>\n<Replan/> <![CDATA[a]]>b\n</Sequence>'),
        '<TreeNodesModel><Action ID="Replan"><input_port name="a">a -> b</input_port></Action></TreeNodesModel>',
    )
    assert [str(e) for e in found.errors] == [
        "<text>:1: got the text 'include path=\"a.xml\"/>;' in <root>: a < is missing",
        "<text>:6: got the text 'Settle ring=\"2\"/>' after <Replan>: a < is missing",
    ]


def test_scripts_that_do_something_are_no_mistake():
    found = found_in(
        main('<Sequence><Script code="a := 1 b := (c := a) + 1;"/><ScriptCondition code="b == 2"/></Sequence>')
    )
    assert not found.warnings
    assert not found.errors


def test_a_file_of_another_format_is_refused():
    for head in ('<root BTCPP_format="3">', "<root>", "<Main>"):
        text = f'{head}<BehaviorTree ID="Main"><Replan/></BehaviorTree></{head[1:5]}>'
        with pytest.raises(TreeError, match=r'<text>:1: got .*, expected <root BTCPP_format="4">'):
            load_tree(text, registry_with(()), Still())


def test_a_tree_with_the_name_of_an_included_one_is_a_mistake(tmp_path):
    (tmp_path / "other.xml").write_text(HEAD + '<BehaviorTree ID="Leg"><Replan/></BehaviorTree></root>')
    own = tmp_path / "own.xml"
    text = HEAD + '<include path="other.xml"/>\n<BehaviorTree ID="Leg"><Replan/></BehaviorTree>\n'
    own.write_text(text + main("<Replan/>") + "</root>")
    (error,) = check_file(str(own), registry_with(()), Still()).errors
    assert (error.file, error.line) == (tmp_path / "other.xml", 2)
    assert error.problem == f"a second tree of this name; the first is at {own}:3"


def test_a_whole_number_may_be_written_with_a_point():
    lines = '<SetBlackboard value="3.0" output_key="r"/><Settle ring="3.0"/><Settle ring="{r}"/>'
    tree = load_tree(HEAD + main(f"<Sequence>{lines}</Sequence>") + "</root>", registry_with(()), Still())
    settle = [node for node in tree.nodes() if type(node).__name__ == "Settle"]
    assert settle[0].get("ring") == 3
    (error,) = found_in(main('<Settle ring="3.5"/>')).errors
    assert error.problem.startswith("ring: got '3.5', expected ")
