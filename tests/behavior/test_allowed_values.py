"""What a port allows: words from a list, what the map has, numbers between bounds; refused at the line of the node."""

from __future__ import annotations

import sys

import pytest
from commands import call as command

from mazeplan.apps.testing import tick_tree
from mazeplan.behavior.registry import REGISTRY
from mazeplan.core.errors import TreeError
from mazeplan.core.records import FailureKind

KINDS = ", ".join(map(str, FailureKind))
OPENINGS = "expected one of 1-2@"
RINGS = "expected one of 1, 2, 3, 4, 5"
HEAD = '<root BTCPP_format="4" main_tree_to_execute="M"><BehaviorTree ID="M">'
TREE = HEAD + "<Sequence>\n{}</Sequence></BehaviorTree>{}</root>"


@pytest.fixture
def call(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: command(monkeypatch, capsys, *arguments)


@pytest.mark.parametrize(
    ("leaf", "said"),
    [
        ('<FailureIs kinds="stuk"/>', f"kinds: got 'stuk', expected one or more, separated by ;, of {KINDS}"),
        ('<FailureIs kinds="stuck;stuk"/>', "kinds: got 'stuck;stuk', expected one or more"),
        ('<FailureIs kinds=""/>', "kinds: got '', expected one or more"),
        ('<FailureIs kinds="stuck" at_most="-1"/>', "at_most: got '-1', expected a whole number >= 0"),
        ('<LevelPlate timeout_s="-1"/>', "timeout_s: got '-1', expected a finite number >= 0"),
        ('<LevelPlate timeout_s="inf"/>', "timeout_s: got 'inf', expected a finite number >= 0"),
        ('<Dither duration_s="1e999"/>', "duration_s: got '1e999', expected a finite number >= 0"),
        ('<Dither amplitude_deg="91"/>', "amplitude_deg: got '91', expected a finite number >= 0 and <= 90"),
        ('<Dither frequency_hz="1e308"/>', "frequency_hz: got '1e308', expected a finite number >= 0 and <= 1000"),
        ('<BackOff tilt_deg="-2"/>', "tilt_deg: got '-2', expected a finite number >= 0 and <= 90"),
        ('<Settle ring="1" hold_s="-.1"/>', "hold_s: got '-.1', expected a finite number >= 0"),
        ('<AvoidOpening times="2000"/>', "times: got '2000', expected a whole number >= 0 and <= 1000"),
    ],
)
def test_check_refuses_what_no_run_could_use(call, tmp_path, leaf, said):
    (tmp_path / "tree.xml").write_text(TREE.format(leaf, ""))
    code, out, err = call("behavior", "check", "tree.xml")
    assert (code, out) == (2, "")
    assert err.startswith(f"mazeplan: tree.xml:2: M/Sequence/{leaf[1:].split()[0]}: {said}")


def test_every_duration_and_tilt_of_a_packaged_leaf_is_bounded():
    for leaf in REGISTRY.values():
        for name, port in leaf.ports.items():
            if port.type is float:
                assert port.least == 0.0, (leaf, name)
            if name.endswith("_deg"):
                assert port.most == 90.0, (leaf, name)
            if name in ("ring", "goal", "opening") and port.direction == "in":
                assert port.choices == ("openings" if name == "opening" else "rings"), (leaf, name)


@pytest.mark.parametrize(
    ("leaf", "more", "said"),
    [
        ('<Align opening="9-9@1"/>', "", f"Sequence/Align: opening: got '9-9@1', {OPENINGS}"),
        ('<PassOpening opening=""/>', "", f"Sequence/PassOpening: opening: got '', {OPENINGS}"),
        ('<InRing ring="99"/>', "", f"Sequence/InRing: ring: got '99', {RINGS}"),
        ('<Settle ring="0"/>', "", f"Sequence/Settle: ring: got '0', {RINGS}"),
        ('<PlanRoute goal="six"/>', "", f"Sequence/PlanRoute: goal: got 'six', {RINGS}"),
        (
            '<SubTree ID="S" way="9-9@1"/>',
            '<BehaviorTree ID="S"><Align opening="{way}"/></BehaviorTree>',
            f"Sequence/S/Align: opening: got '9-9@1' from {{way}}, which a SubTree gives, {OPENINGS}",
        ),
    ],
)
def test_what_the_map_does_not_have_is_refused_when_the_tree_is_built(call, tmp_path, leaf, more, said):
    (tmp_path / "tree.xml").write_text(TREE.format(leaf, more))
    assert call("behavior", "check", "tree.xml")[0] == (2 if "six" in leaf else 0)  # nobody knows the map there
    code, _, err = call("navigate", "--rig", "ideal", "--behavior", "tree.xml", "--log", "run.mcap")
    assert code == 2
    assert err.splitlines()[-1].startswith(f"mazeplan: tree.xml:2: M/{said}")
    assert "Traceback" not in err


@pytest.mark.parametrize(
    ("leaf", "keys", "said"),
    [
        ('<Align opening="{way}"/>', {"way": "9-9@1"}, f"Align: opening: got '9-9@1' from {{way}}, {OPENINGS}"),
        ('<Align opening="{way}"/>', {"way": None}, f"Align: opening: got None from {{way}}, {OPENINGS}"),
        ('<InRing ring="{goal}"/>', {"goal": 99}, f"InRing: ring: got 99 from {{goal}}, {RINGS}"),
        ('<InRing ring="{goal}"/>', {"goal": "99"}, f"InRing: ring: got '99' from {{goal}}, {RINGS}"),
    ],
)
def test_what_the_map_does_not_have_is_refused_when_it_comes_from_the_blackboard(leaf, keys, said):
    with pytest.raises(TreeError) as error:
        tick_tree(TREE.format(leaf, ""), keys=keys)
    assert str(error.value).startswith(f"<text>:2: M/Sequence/{said}")


def test_the_list_of_leaves_shows_what_is_allowed(call):
    out = call("behavior", "list")[1]
    assert f"    kinds (list, needed): kinds of failure, separated by ;; allowed: {KINDS}\n" in out
    assert "    ring (int, needed): number of the ring; allowed: rings of the map\n" in out


@pytest.mark.parametrize(
    ("choices", "said"), [("('fast', 'slow')", ""), ("['fast']", ""), ("'walls'", "got 'walls'"), ("3", "got 3")]
)
def test_a_leaf_of_ones_own_has_choices_too(call, tmp_path, monkeypatch, choices, said):
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    name = f"chosen_{tmp_path.name}"
    (tmp_path / f"{name}.py").write_text(
        "from mazeplan import MazeLeaf, Port, Status\n\n\nclass Go(MazeLeaf):\n"
        f'    ports = {{"how": Port(str, "fast", "how", choices={choices})}}\n\n'
        "    def step(self):\n        return Status.SUCCESS\n"
    )
    (tmp_path / "tree.xml").write_text(TREE.format('<Go how="quick"/>', ""))
    code, _, err = call("behavior", "check", "tree.xml", "--behavior-module", name)
    assert code == 2
    if said:
        assert f"ports['how']: choices: {said}, expected a tuple of values, or one of openings, rings" in err
    else:
        assert "tree.xml:2: M/Sequence/Go: how: got 'quick', expected one of fast" in err


def test_the_palette_tells_conditions_from_actions(call):
    out = call("behavior", "palette")[1]
    conditions = {name for name in REGISTRY if f'<Condition ID="{name}"' in out}
    assert conditions == {"BallSeen", "BallsStay", "InRing", "FailureIs"}
