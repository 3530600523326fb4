"""What `behavior check` warns of, and what it does not."""

from __future__ import annotations

import pytest
from tree_checks import found_in, main

WARNED = [
    ('<SubTree ID="Leg" ring="2" rang="3"/>', "rang: nothing in Leg reads it"),
    ('<SubTree ID="Leg" ring="2" rang="{goal}"/>', "rang: nothing in Leg reads it"),
]
QUIET = [
    '<SubTree ID="Leg" ring="{goal}"/>',
    '<SubTree ID="Out" found="{ring}"/>',
    '<SubTree ID="Auto" goal="{goal}"/>',
    '<SubTree ID="Model"/>',
    '<Script code="calm := 2"/>',
    '<Replan _onSuccess="done := true"/>',
    '<Replan _skipIf="a := 1; goal == a"/>',
    '<Sequence><Replan _skipIf="goal == 1" _onSuccess="b := a"/><Script code="a := 1"/></Sequence>',
    '<Fallback><Sequence><Replan/><InRing ring="{a}"/></Sequence><Script code="a := 1"/></Fallback>',
    '<Sequence><SetBlackboard value="0.5" output_key="d"/><Settle ring="1" hold_s="{d}"/></Sequence>',
    '<LoopInt queue="3;5" value="{r}"><InRing ring="{r}"/></LoopInt>',
]
OTHERS = """<BehaviorTree ID="Leg"><InRing ring="{ring}"/></BehaviorTree>
<BehaviorTree ID="Out"><Script code="found := 2"/></BehaviorTree>
<BehaviorTree ID="Auto"><SubTree ID="Inner" _autoremap="true"/></BehaviorTree>
<BehaviorTree ID="Inner"><InRing ring="{goal}"/></BehaviorTree>
<BehaviorTree ID="Model"><Replan/></BehaviorTree>
<BehaviorTree ID="All"><Sequence><SubTree ID="Leg" ring="1"/><SubTree ID="Out"/><SubTree ID="Auto" goal="1"/>
<SubTree ID="Model"/></Sequence></BehaviorTree>
<TreeNodesModel><SubTree ID="Model"><input_port name="never" default="3"/></SubTree></TreeNodesModel>"""


def warnings_of(content, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "enum_of_paces.py").write_text("from enum import IntEnum\nclass Pace(IntEnum):\n    CALM = 1\n")
    found = found_in(main(content), OTHERS, module=["enum_of_paces"])
    assert found.errors == ()
    return [(e.line, e.problem) for e in found.warnings if not e.problem.startswith("not used")]


@pytest.mark.parametrize(("content", "said"), WARNED)
def test_what_does_nothing_is_a_warning(tmp_path, monkeypatch, content, said):
    ((line, problem),) = warnings_of(content, tmp_path, monkeypatch)
    assert line == 2
    assert said in problem


@pytest.mark.parametrize("content", QUIET)
def test_what_may_do_something_is_none(tmp_path, monkeypatch, content):
    assert warnings_of(content, tmp_path, monkeypatch) == []


def test_a_tree_of_the_file_that_none_uses_is_a_warning(tmp_path):
    found = found_in(
        main('<SubTree ID="Used"/>'),
        '<include path="navigate.xml"/>',  # whose trees are those of another file
        '<BehaviorTree ID="Used"><Replan/></BehaviorTree>',
        '<BehaviorTree ID="Left"><SubTree ID="Below"/></BehaviorTree>',
        '<BehaviorTree ID="Below"><Replan/></BehaviorTree>',
    )
    assert [(e.line, e.key, e.problem) for e in found.warnings] == [
        (5, "Left", "not used: it is not the main tree, and no SubTree names it")
    ]


def test_attributes_of_editors_are_ignored():
    content = '<Sequence _collapsed="1"><SubTree ID="S" _favorite="x" _uid="3"/><Replan _note="{=}"/></Sequence>'
    tree = '<BehaviorTree ID="S" _favorite="true"><Sleep msec="1" _description="a"/></BehaviorTree>'
    found = found_in(main(content).replace('ID="Main"', 'ID="Main" _collapsed="1"'), tree)
    assert (found.errors, found.warnings, found.nodes) == ((), (), 4)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ('<Replan _skipif="true"/>', "'_skipif', expected one of _failureIf,"),
        ('<SubTree ID="Rest" _onSucces="a := 1"/>', "did you mean _onSuccess?"),
        ('<SubTree ID="Rest" _autoRemap="true"/>', "did you mean _autoremap?"),
        ('<Replan _autoremap="true"/>', "unknown attribute '_autoremap'"),
    ],
)
def test_an_attribute_that_looks_like_one_with_a_meaning_is_refused(content, said):
    (error,) = found_in(main(content), '<BehaviorTree ID="Rest"><Replan/></BehaviorTree>').errors
    assert error.line == 2
    assert said in error.problem


def test_a_precondition_of_a_whole_tree_is_refused():
    (error,) = found_in(main("<Replan/>").replace('ID="Main"', 'ID="Main" _skipIf="true"')).errors
    assert error.problem.startswith("unknown attribute '_skipIf'")
