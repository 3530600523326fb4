"""What `behavior check` warns of, what it does not, and constants that travel by keys."""

from __future__ import annotations

import pytest
from tree_checks import HEAD, Still, found_in, main

from mazeplan.behavior.own_nodes import registry_with
from mazeplan.behavior.trees import check_file, choices_of
from mazeplan.maze.mapfile import load_map

WARNED = [
    ('<SubTree ID="Leg" ring="2" rang="3"/>', "rang: nothing in Leg reads it"),
    ('<SubTree ID="Leg" ring="2" rang="{goal}"/>', "rang: nothing in Leg reads it"),
    ('<Replan _skipIf="true"/>', "never ticked: _skipIf is always true"),
    ('<Replan _skipIf="CALM == 1"/>', "never ticked: _skipIf is always true"),
    ('<Sequence _while="1 &gt; 2"><Replan/></Sequence>', "never ticked: _while is always false"),
    ('<Replan _failureIf="goal == 1" _successIf="true"/>', "never ticked: _successIf is always true"),
    ('<Fallback><Replan _successIf="true"/>\n</Fallback>', "never ticked: _successIf"),
    ('<Repeat num_cycles="0"><Replan/></Repeat>', "never ticked: num_cycles of the Repeat above it is 0"),
    ("<IfThenElse><AlwaysSuccess/><Replan/><Replan/></IfThenElse>", "never ticked: the condition AlwaysSuccess never"),
    ('<Precondition if="false"><Replan/></Precondition>', "never ticked: the script `if` of the Precondition"),
    ("<Fallback><Sequence><AlwaysSuccess/><AlwaysSuccess/></Sequence><Replan/></Fallback>", "never ticked: Sequence"),
    ('<Fallback><Script code="a := 1"/><Replan/></Fallback>', "never ticked: Script before it never ends with FAILURE"),
    (
        '<Fallback><SetBlackboard value="1" output_key="a"/><Replan/></Fallback>',
        "never ticked: SetBlackboard before it",
    ),
    (
        "<Sequence><KeepRunningUntilFailure><BallSeen/></KeepRunningUntilFailure><Replan/></Sequence>",
        "never ticked: KeepRunningUntilFailure before it never ends with SUCCESS",
    ),
    (
        '<Fallback><RetryUntilSuccessful num_attempts="-1"><BallSeen/></RetryUntilSuccessful><Replan/></Fallback>',
        "never ticked: RetryUntilSuccessful before it never ends with FAILURE",
    ),
    (
        '<Sequence><Repeat num_cycles="-1"><Delay delay_msec="5"><BallSeen/></Delay></Repeat><Replan/></Sequence>',
        "never ticked: Repeat before it never ends with SUCCESS",
    ),
]
QUIET = [
    '<SubTree ID="Leg" ring="{goal}"/>',
    '<SubTree ID="Out" found="{ring}"/>',
    '<SubTree ID="Auto" goal="{goal}"/>',
    '<SubTree ID="Model"/>',
    '<Script code="calm := 2"/>',
    '<Replan _skipIf="false"/>',
    '<Replan _skipIf="goal == 1"/>',
    '<Replan _while="true"/>',
    '<Replan _onSuccess="done := true"/>',
    '<Fallback><ForceSuccess><Sequence><Replan _skipIf="goal == 1"/></Sequence></ForceSuccess><Replan/></Fallback>',
    '<Fallback><Sequence><AlwaysSuccess/><InRing ring="2"/></Sequence><Replan/></Fallback>',
    '<Fallback><AlwaysSuccess _onSuccess="a := 1" _while="goal == 2"/><Replan/></Fallback>',
    "<Sequence><RunOnce><AlwaysSuccess/></RunOnce><Replan/></Sequence>",
    '<Fallback><SetBlackboard value="{goal}" output_key="a"/><Replan/></Fallback>',  # which may have no value
    '<Fallback><Script code="a := 1" _skipIf="goal == 1"/><Replan/></Fallback>',
    '<Fallback><RetryUntilSuccessful num_attempts="{goal}"><BallSeen/></RetryUntilSuccessful><Replan/></Fallback>',
    '<Sequence><Repeat num_cycles="2"><BallSeen/></Repeat><Replan/></Sequence>',
    '<Sequence><RetryUntilSuccessful num_attempts="-1"><BallSeen/></RetryUntilSuccessful><Replan/></Sequence>',
    "<Fallback><KeepRunningUntilFailure><BallSeen/></KeepRunningUntilFailure><Replan/></Fallback>",
    '<Replan _skipIf="a := 1; goal == a"/>',
    '<Replan _onSuccess="goal = 3"/>',
    '<Sequence><Replan _skipIf="goal == 1" _onSuccess="b := a"/><Script code="a := 1"/></Sequence>',
    '<Sequence><Script code="a := 1"/><InRing ring="{a}"/><Script code="a := 2"/></Sequence>',
    '<Sequence><Fallback><Replan/><InRing ring="{a}"/></Fallback><Script code="a := 1"/></Sequence>',
    '<Fallback><Sequence><Replan/><InRing ring="{a}"/></Sequence><Script code="a := 1"/></Fallback>',
    '<Sequence><ForceSuccess><Sequence><Replan/><InRing ring="{a}"/></Sequence></ForceSuccess>'
    '<Script code="a := 1"/></Sequence>',
    '<Switch2 variable="{goal}" case_1="1" case_2="2"><InRing ring="{a}"/><Script code="a := 1"/><Replan/></Switch2>',
    '<Script code="a := 1; a := a + 1"/>',
    '<Script code="b := goal == 1 ? a : 2; a := b"/>',
    '<Replan _skipIf="goal == 1" _onSuccess="b := a" _onFailure="a := 1"/>',
    '<Script code="b := a" _skipIf="a := 1; goal == 1"/>',
    '<Sequence><SkipUnlessUpdated entry="{a}"><Replan/></SkipUnlessUpdated><Script code="a := 1"/></Sequence>',
    '<Sequence><Script code="d := 1"/><Settle ring="1" hold_s="{d}"/></Sequence>',
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


MAZE = load_map("cme")


class OnTheMap(Still):
    def choices(self, name):
        return choices_of(MAZE, name)


CONSTANTS = [
    (
        '<SetBlackboard value="soon" output_key="d"/>',
        "hold_s",
        "got 'soon', expected a finite number >= 0",
    ),
    ("<Script code=\"d := 'long'\"/>", "hold_s", "got 'long', expected a finite number >= 0"),
    ('<Script code="d := -(1 + 2)"/>', "hold_s", "got -3.0, expected a finite number >= 0"),
    ("<Replan _onSuccess=\"d := 'long'\"/>", "hold_s", "got 'long', expected a finite number >= 0"),
]


@pytest.mark.parametrize(("setter", "port", "said"), CONSTANTS)
def test_a_constant_that_the_port_which_reads_it_refuses_is_told_where_it_is_set(setter, port, said):
    (error,) = found_in(main(f'<Sequence>{setter}\n<Settle ring="1" {port}="{{d}}"/></Sequence>')).errors
    assert error.line == 2
    assert said in error.problem


def on_the_map(content):
    text = HEAD + main(content) + '<BehaviorTree ID="Leg"><InRing ring="{ring}"/></BehaviorTree></root>'
    found = check_file(text, registry_with(), OnTheMap())
    return found.errors, [e.problem for e in found.warnings if not e.problem.startswith("not used")]


def test_a_constant_that_is_not_the_only_value_is_no_error():
    setters = '<Script code="a := 0"/><Script code="a := 3"/>'
    assert on_the_map(f'<Sequence>{setters}<InRing ring="{{a}}"/></Sequence>') == ((), [])


def test_a_queue_given_to_a_subtree_is_checked():
    loop = '<BehaviorTree ID="Many"><LoopInt queue="{stops}" value="{r}"><InRing ring="{r}"/></LoopInt></BehaviorTree>'
    assert found_in(main('<SubTree ID="Many" stops="4;5"/>'), loop).errors == ()
    (error,) = found_in(main('<SubTree ID="Many" stops="4;x"/>'), loop).errors
    assert error.line == 2


@pytest.mark.parametrize(
    ("value", "condition", "fails"),
    [
        ("true", "!calm", False),
        ("0", "!calm", False),
        ("yes", "!calm", True),
        ("yes", "calm", True),
        ("fast", "calm &gt; 2", True),
        ("3", "calm &gt; 2", False),
        ("fast", "calm == 'fast'", False),
    ],
)
def test_a_script_that_fails_on_the_literal_of_a_subtree_is_an_error_there(value, condition, fails):
    tree = f'<BehaviorTree ID="Careful"><Sleep msec="1" _skipIf="{condition}"/></BehaviorTree>'
    errors = found_in(main(f'<SubTree ID="Careful" calm="{value}"/>'), tree).errors
    assert [error.line for error in errors] == [2] * fails
    constant = f'<Sequence><SetBlackboard value="{value}" output_key="calm"/><Replan _skipIf="{condition}"/></Sequence>'
    assert len(found_in(main(constant)).errors) == fails


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
        ('<Replan _skipif="true"/>', "_skipif is ignored here; did you mean _skipIf?"),
        ('<SubTree ID="Rest" _onSucces="a := 1"/>', "_onSucces is ignored here; did you mean _onSuccess?"),
        ('<SubTree ID="Rest" _autoRemap="true"/>', "_autoRemap is ignored here; did you mean _autoremap?"),
        ('<Replan _autoremap="true"/>', "_autoremap is ignored here"),
    ],
)
def test_an_attribute_that_is_ignored_but_looks_like_another_is_a_warning(content, said):
    rest = '<BehaviorTree ID="Rest"><Replan/></BehaviorTree><BehaviorTree ID="Used"><SubTree ID="Rest"/></BehaviorTree>'
    found = found_in(main(content), rest)
    assert [(e.line, e.problem) for e in found.warnings if not e.problem.startswith("not used")] == [(2, said)]
    assert found.errors == ()


def test_a_precondition_of_a_whole_tree_is_ignored_with_a_warning():
    (warning,) = found_in(main("<Replan/>").replace('ID="Main"', 'ID="Main" _skipIf="true"')).warnings
    assert warning.problem == "_skipIf is ignored here"
