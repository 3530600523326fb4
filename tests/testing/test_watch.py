"""Scripts of leaves, and leaves in a tree that play them."""

from __future__ import annotations

import pytest

from mazeplan.apps.testing import script, tick_tree
from mazeplan.btree.status import FAILURE, RUNNING, SKIPPED, SUCCESS
from mazeplan.core.errors import InputError
from mazeplan.core.records import FailureKind

HEAD = '<root BTCPP_format="4"><BehaviorTree ID="Main">{}</BehaviorTree></root>'


def tree(inside: str) -> str:
    return HEAD.format(inside)


def test_words_and_letters():
    assert [act.status for act in script("RUNNING x3 then SUCCESS").acts] == [RUNNING] * 3 + [SUCCESS]
    assert [act.status for act in script("RF-S").acts] == [RUNNING, FAILURE, SKIPPED, SUCCESS]
    stuck = script("FAILURE(stuck) x2 then SKIPPED")
    assert [act.kind for act in stuck.acts] == [FailureKind.STUCK, FailureKind.STUCK, None]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("RUNING x3", "got 'RUNING x3', expected acts such as RUNNING x3"),
        ("SUCCESS then", "expected acts"),
        ("", "expected acts"),
        ("FAILURE(late)", "KIND is one of stuck, missed_opening"),
        ("SUCCESS(stuck)", "expected acts"),
        ("RUNNING x999999", "expected acts"),
    ],
)
def test_what_is_no_script_is_refused(text, said):
    with pytest.raises(InputError, match=said.replace("(", r"\(")) as caught:
        script(text)
    assert "\n" not in str(caught.value)


def test_the_last_act_goes_on_for_ever():
    loop = tree('<Repeat num_cycles="3"><Replan/></Repeat>')
    record = tick_tree(loop, {"Replan": "RUNNING x2 then SUCCESS"})
    assert record.statuses("Replan") == ["RUNNING", "RUNNING", *["SUCCESS"] * 3]
    assert [tick.t for tick in record.ticks] == pytest.approx([k / 30 for k in range(3)])


def test_a_script_keeps_the_preconditions_of_its_leaf_and_may_skip_it():
    fallback = tree('<Sequence><Dither _skipIf="goal == 5"/><Replan/></Sequence>')
    assert tick_tree(fallback, {"Dither": "F", "Replan": "S"}).statuses("Dither") == ["SKIPPED"]
    assert tick_tree(fallback, {"Dither": "F", "Replan": "S"}, goal=4).statuses("Dither") == ["FAILURE"]
    record = tick_tree(fallback, {"Dither": "R-", "Replan": "RS"}, goal=4)
    assert record.statuses("Dither") == ["RUNNING", "SKIPPED", "HALTED"]
    record.ends_with("SUCCESS")


def test_a_script_leaves_failures_by_kind_and_writes_ports():
    body = '<Sequence><PlanRoute goal="{goal}" legs="{legs}"/><Repeat num_cycles="{legs}"><Dither/></Repeat></Sequence>'
    record = tick_tree(tree(body), {"PlanRoute": script("SUCCESS", legs=2), "Dither": "S"})
    assert record.statuses("Dither") == ["SUCCESS"] * 2
    failed = tick_tree(tree(body), {"PlanRoute": "FAILURE(no_route)"})
    assert failed.failures == ["no_route"]
    assert failed.events[0].detail["where"] == "PlanRoute"


def test_what_stands_on_the_blackboard_and_what_failed_before_may_be_given():
    body = tree('<Sequence><FailureIs kinds="stuck" at_most="2"/><Replan _skipIf="mood == \'calm\'"/></Sequence>')
    record = tick_tree(body, failures=["stuck", "stuck"], keys={"mood": "calm"})
    assert record.statuses("Replan") == ["SKIPPED"]
    assert record.failures == []  # those of before are not of this run
    assert tick_tree(body, failures=["stuck"] * 3, keys={"mood": "bad"}).reason == "FAILURE"
    with pytest.raises(InputError, match="failures: got 'stck', expected one of stuck"):
        tick_tree(body, failures=["stck"])
