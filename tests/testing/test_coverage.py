"""Coverage of a tree: what counts as reached, with file and line of what was not."""

from __future__ import annotations

import pytest

from mazeplan.apps.testing import Coverage, tick_tree
from mazeplan.core.errors import InputError

TREE = """\
<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence name="row">
      <Fallback name="choice">
        <Dither/>
        <Sequence name="other"><Replan/></Sequence>
        <AvoidOpening name="last"/>
      </Fallback>
      <SubTree ID="Twice" name="one"/>
      <SubTree ID="Twice" name="two"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Twice">
    <Sequence><BackOff _skipIf="mood == 'calm'"/><BallSeen/></Sequence>
  </BehaviorTree>
</root>
"""
LEAVES = {"Dither": "F", "Replan": "F", "last": "F", "BackOff": "S", "BallSeen": "S"}


def go(path, **scripts):
    moods = {"mood": "bad"}
    tree = str(path)
    return tick_tree(tree, {**LEAVES, **scripts}, keys=moods)


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "tree.xml"
    file.write_text(
        TREE.replace('name="one"', 'name="one" _autoremap="1"').replace('name="two"', 'name="two" mood="calm"')
    )
    return file


def test_leaves_and_branches_over_several_runs(path):
    coverage = Coverage(go(path))
    assert coverage.leaves == pytest.approx(3 / 5)
    assert coverage.missing() == [
        f"{path}:14: Twice/Sequence/BackOff: never ticked",
        f"{path}:14: Twice/Sequence/BallSeen: never ticked",
    ]
    assert coverage.missing("branches") == [
        f"{path}:5: Main/row/choice/Dither: child 1 of Fallback never taken",
        f"{path}:6: Main/row/choice/other: child 2 of Fallback never taken",
        f"{path}:14: Twice/Sequence/BackOff: _skipIf never decided",
        f"{path}:14: Twice/Sequence/BackOff: _skipIf never let it pass",
    ]
    coverage.add(go(path, Dither="RS"))  # BackOff runs in the first Twice and is skipped in the second
    assert coverage.runs == 2
    assert coverage.leaves == 1.0
    assert coverage.missing("branches") == [f"{path}:6: Main/row/choice/other: child 2 of Fallback never taken"]
    assert coverage.branches == pytest.approx(4 / 5)
    coverage.add(go(path, Replan="S"))
    coverage.covers().covers(of="branches")


def test_what_is_missing_is_said_with_file_and_line(path):
    coverage = Coverage(go(path))
    coverage.covers(0.6).covers(at_least=0.2, of="branches")
    with pytest.raises(AssertionError) as caught:
        coverage.covers(0.7)
    assert str(caught.value).splitlines()[:2] == [
        "expected 70% of the leaves, 1 run covered 60%",
        f"  {path}:14: Twice/Sequence/BackOff: never ticked",
    ]
    with pytest.raises(AssertionError, match="expected 100% of the branches, 1 run covered 20%"):
        coverage.covers(of="branches")
    with pytest.raises(AssertionError, match="0 runs"):
        Coverage().covers()
    for wrong in ({"of": "nodes"}, {"at_least": 80}):
        with pytest.raises(InputError, match="expected 0 to 1, and one of leaves, branches"):
            coverage.covers(**wrong)


def test_what_the_leaves_ended_with(path):
    coverage = Coverage(go(path), go(path, Dither="RS"))
    assert coverage.results("Dither") == {"RUNNING", "SUCCESS", "FAILURE"}
    assert coverage.results("BackOff") == {"SUCCESS", "SKIPPED"}
    coverage.add(tick_tree(str(path), {**LEAVES, "Dither": "R"}, keys={"mood": ""}, ticks=2, halt=True))
    assert "HALTED" in coverage.results("Dither")
    with pytest.raises(InputError, match="coverage: got 'Dithr', expected one of Dither"):
        coverage.results("Dithr")


def test_the_report_is_a_table_and_a_list(path):
    text = Coverage(go(path), go(path, Dither="RS")).report()
    lines = text.splitlines()
    assert lines[0] == "2 runs: 5 of 5 leaves ticked, 4 of 5 branches taken"
    assert lines[1].split() == ["leaf", "line", "ticks", "SUCCESS", "FAILURE", "HALTED"]
    row = next(line for line in lines if line.startswith("Main/row/choice/Dither "))
    assert row.split()[1:] == ["5", "3", "x", "x", "-"]
    assert lines[-1].endswith("child 2 of Fallback never taken")


def test_trees_of_several_files_are_kept_apart(path, tmp_path):
    other = tmp_path / "other.xml"
    other.write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence><Dither/><Replan/></Sequence></BehaviorTree></root>'
    )
    coverage = Coverage(go(path, Dither="S"), tick_tree(str(other), {"Dither": "F", "Replan": "S"}))
    assert f"{other}:1: Main/Sequence/Replan: never ticked" in coverage.missing()


def test_postconditions_are_no_branches(path):
    path.write_text(path.read_text().replace("<Dither/>", '<Dither _onSuccess="done := true" _post="done := true"/>'))
    coverage = Coverage(go(path, Dither="S"))
    assert not any(": _onSuccess " in line or ": _post " in line for line in coverage.missing("branches"))
    assert len(coverage.all_branches()) == 5
