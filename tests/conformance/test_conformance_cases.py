"""Each node, attribute and part of the script language does what BehaviorTree.CPP does: the trees of cases.txt, with
what version 4.10.0 of the original did with them in expected.txt."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from recorded_trees import cases, expected, played

from mazeplan.btree.controls import CONTROLS
from mazeplan.btree.decorators import DECORATORS
from mazeplan.btree.leaf import BUILTIN_LEAVES
from mazeplan.btree.node import CONDITIONS
from mazeplan.btree.script import ASSIGNMENTS, POWERS, PREFIXES

CASES, EXPECTED = cases(), expected()


@pytest.mark.parametrize("name", CASES)
def test_a_tree_does_what_the_original_does(name):
    assert played(CASES[name]) == EXPECTED[name]


def test_there_are_enough_cases_and_none_without_an_answer():
    assert len(CASES) >= 150
    assert set(CASES) == set(EXPECTED)
    assert sum(lines == ["refused"] for lines in EXPECTED.values()) < 20


def test_every_node_and_attribute_occurs():
    text = " ".join(case.xml for case in CASES.values())
    kinds = {*CONTROLS, *DECORATORS, *BUILTIN_LEAVES, "SubTree"} - {"ManualSelector"}  # which asks at a terminal there
    assert {kind for kind in kinds if f"<{kind}" not in text} == set()
    assert {name for name in (*CONDITIONS, "_autoremap") if f"{name}=" not in text} == set()


def test_every_operator_occurs():
    scripts = " ".join(re.findall(r'(?:code|if|_[a-zA-Z]+)="([^"]*)"', " ".join(c.xml for c in CASES.values())))
    scripts = scripts.replace("&amp;", "&").replace("&lt;", "<").replace("&gt;", ">")
    signs = (*POWERS, *ASSIGNMENTS, *PREFIXES, "?", ";", "0x", "true", "'")
    assert {sign for sign in signs if sign not in scripts} == set()


def test_every_attribute_is_in_the_documentation():
    text = (Path(__file__).resolve().parents[2] / "docs" / "tree-nodes.md").read_text()
    assert {name for name in CONDITIONS if f"`{name}`" not in text} == set()
