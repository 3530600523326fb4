"""`behavior check` finds what would fail when the ball already rolls."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from mazeplan.apps.cli.app import app
from mazeplan.behavior.trees import tree_names

TREE = """<root BTCPP_format="4" main_tree_to_execute="Main">
<BehaviorTree ID="Main">{}</BehaviorTree>
<BehaviorTree ID="Leg">
  <Sequence>
    <PlanInRing opening="{{opening}}" plan="{{plan}}"/>
    <Track opening="{{opening}}" plan="{{plan}}"/>
  </Sequence>
</BehaviorTree>
</root>"""
CHOOSE = '<ChooseOpening goal="{goal}" opening="{opening}"/>'
LEG = '<SubTree ID="Leg" opening="{opening}"/>'
PLANTED = [
    ('\n<Align opening="{openning}"/>', 3, "nothing sets {openning}; did you mean {opening}?"),
    (
        '\n<SubTree ID="Leg" name="none"/>',
        3,
        "none: opening is missing: inside, PlanInRing reads {opening} at tree.xml:6",
    ),
    (
        '\n<SubTree ID="Leg" opening="{gate}"/>',
        3,
        "opening: nothing sets {gate}; inside, PlanInRing reads {opening} at tree.xml:6; set are goal, opening, ",
    ),
    (
        '\n<SubTree ID="Leg" opening="1-2@46"/>',
        6,
        "got '1-2@46' from {opening}, which a SubTree gives, expected one of 1-2@",
    ),
    ('\n<Align opening="1-2@46"/>', 3, "got '1-2@46', expected one of"),
    ('\n<InRing ring="9"/>', 3, "got '9', expected one of"),
    ('\n<Settle ring="{goal}" _skipIf="tries &gt; 2"/>', 3, "_skipIf: nothing sets {tries}"),
    ('\n<Script code="m = 2"/>', 3, "code: nothing sets {m}"),
    ('\n<LoopInt queue="{rings}" value="{ring}"><Replan/></LoopInt>', 3, "nothing sets {rings}"),
    ('\n<SubTree ID="Lag"/>', 3, "got 'Lag', expected one of Main, Leg"),
    ('\n<Repeat num_cycles="2" _while="go on"><Replan/></Repeat>', 3, "_while: nothing sets {go}"),
]


def checked(tmp_path, content, *options):
    path = tmp_path / "tree.xml"
    path.write_text(TREE.format(content))
    done = CliRunner().invoke(app, ["behavior", "check", str(path), "--json", *options])
    return done.exit_code, json.loads(done.stdout)[0]


@pytest.mark.parametrize(("more", "line", "said"), PLANTED)
def test_a_planted_mistake_is_found_at_its_line(tmp_path, more, line, said):
    code, found = checked(tmp_path, f"<Sequence>{CHOOSE}{LEG}{more}</Sequence>", "--map", "cme")
    assert code == 2
    assert not found["ok"]
    assert any(said in error and f"tree.xml:{line}:" in error for error in found["errors"]), found["errors"]


def test_a_tree_without_a_mistake_is_clean(tmp_path):
    code, found = checked(tmp_path, f"<Sequence>{CHOOSE}{LEG}</Sequence>", "--map", "cme")
    assert (code, found["errors"], found["warnings"]) == (0, [], [])


@pytest.mark.parametrize("name", tree_names())
def test_the_packaged_trees_are_clean(name):
    done = CliRunner().invoke(app, ["behavior", "check", name, "--map", "cme", "--json"])
    found = json.loads(done.stdout)[0]
    assert (found["errors"], found["warnings"]) == ([], [])


def test_a_check_loads_nothing_that_plans_or_computes_routes():
    code = (
        "import sys\nfrom mazeplan.behavior.registry import registry_with\n"
        "from mazeplan.behavior.trees import StaticContext, check_file\n"
        "assert not check_file('navigate', registry_with(), StaticContext()).errors\n"
        "print(*sorted({'numba', 'scipy', 'networkx', 'pandas', 'mujoco'} & sys.modules.keys()))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "\n"
