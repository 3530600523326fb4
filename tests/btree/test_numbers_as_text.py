"""A number is the same in each of its forms: 3, 3.0 and 3.000000, as scripts write it into a text."""

from __future__ import annotations

from typing import ClassVar

import pytest

from mazeplan.behavior.trees import load_tree
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.ports import Port
from mazeplan.btree.script_values import number_of
from mazeplan.btree.status import FAILURE, SUCCESS
from mazeplan.core.errors import TreeError


class Run:
    def __init__(self):
        self.took = []

    def clock(self):
        return 0.0

    def failed(self, failure):
        pass


class Take(Leaf):
    """Takes one of three texts, some of several, or one of two numbers."""

    ports: ClassVar[dict[str, Port]] = {
        "text": Port(str, None, "a text", choices=("3", "4.5", "all")),
        "texts": Port(list, None, "texts", choices=("3", "4.5", "all")),
        "number": Port(float, None, "a number", choices=(3.0, 4.5)),
    }

    def step(self):
        self.context.took += [self.get(port) for port in self.ports if port in self.values]
        return SUCCESS


def ticked(content):
    run = Run()
    tree = load_tree(
        f'<root BTCPP_format="4"><BehaviorTree ID="Main">{content}</BehaviorTree></root>', {"Take": Take}, run
    )
    return tree.tick(), run.took


SWITCH = '<Switch2 variable="{}" case_1="{}" case_2="x"><AlwaysSuccess/><AlwaysFailure/><AlwaysFailure/></Switch2>'


@pytest.mark.parametrize("form", ["3", "3.0", "3.000000", "3e0"])
def test_a_port_and_a_switch_take_a_number_in_any_form(form):
    for port, value in (("text", "3"), ("texts", ["3"]), ("number", 3.0)):
        assert ticked(f'<Take {port}="{form}"/>') == (SUCCESS, [value])
        assert ticked(f'<Sequence><Script code="n := {form}"/><Take {port}="{{n}}"/></Sequence>') == (SUCCESS, [value])
    for other in ("3", "3.0", "3.000000"):
        assert ticked(SWITCH.format(form, other))[0] is SUCCESS
    assert ticked(SWITCH.format(form, "3.1"))[0] is FAILURE
    assert ticked(f"<ScriptCondition code=\"3 == '{form}'\"/>")[0] is SUCCESS


def test_a_number_has_one_minus_and_no_letters():
    assert ticked(SWITCH.format("-3", "-3.0"))[0] is SUCCESS
    for text in ("-0x1F", "--3", "-", "- 3"):
        assert number_of(text, {}) is None
        assert ticked(SWITCH.format("2", text))[0] is FAILURE


@pytest.mark.parametrize("form", ["3.5", "4", "x3", "nan", "inf", "true"])
def test_another_number_is_another_one(form):
    with pytest.raises(TreeError, match=r"expected one of 3, 4\.5, all"):
        ticked(f'<Take text="{form}"/>')
    with pytest.raises(TreeError, match="expected one or more"):
        ticked(f'<Take texts="3;{form}"/>')


def test_a_script_joins_a_number_that_is_not_whole_with_six_decimals_as_the_original_does():
    script = "<ScriptCondition code=\"{} == '{}'\"/>"
    for joined, text in (("'v' .. 3", "v3"), ("'v' .. 3.0", "v3.000000"), ("'v' .. 1 + 2", "v3.000000")):
        assert ticked(script.format(joined.replace("1 + 2", "(1 + 2)"), text))[0] is SUCCESS
    assert ticked(script.format("'3.0'", "3.000000"))[0] is FAILURE, "two texts are compared as texts"


def test_a_selection_may_be_computed():
    selector = "<ManualSelector><AlwaysFailure/><AlwaysSuccess/></ManualSelector>"
    for selection in ("2", "1 + 1", "2.0"):
        assert ticked(f'<Sequence><Script code="selection := {selection}"/>{selector}</Sequence>')[0] is SUCCESS
    for selection in ("1.5", "3", "true", "0"):
        with pytest.raises(TreeError, match="expected one of AlwaysFailure, AlwaysSuccess, or 1 to 2"):
            ticked(f"<Sequence><Script code=\"selection := '{selection}'\"/>{selector}</Sequence>")
