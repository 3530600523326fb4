"""Leaves of one's own, in a module in the folder where one works."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from commands import call as command

HEAD = '<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main">\n'
IMPORT = "from mazeplan import MazeLeaf, Port, Status\n"
COUNT = (
    IMPORT
    + '''
class GiveUp(MazeLeaf):
    """Fail after some ticks."""

    ports = {"ticks": Port(int, 2, "how many", least=1)}

    def start(self):
        self.left = self.get("ticks")

    def step(self):
        self.left -= 1
        return Status.RUNNING if self.left else Status.FAILURE


class _Hidden(GiveUp):
    pass


class Base(MazeLeaf):
    """Has no step: to be derived from."""
'''
)


@pytest.fixture
def call(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tree.xml").write_text(f'{HEAD}<GiveUp ticks="3"/>\n</BehaviorTree></root>', encoding="utf-8")
    others = str(tmp_path.parents[1])  # folders of other tests, which call their modules by the same names
    path = [folder for folder in sys.path if others not in folder]
    monkeypatch.setattr(sys, "path", path)  # what is put into it is gone afterwards
    for name, module in list(sys.modules.items()):
        if others in str(getattr(module, "__file__", None)):
            monkeypatch.delitem(sys.modules, name)
    before = list(sys.modules)

    def run(*arguments):
        return command(monkeypatch, capsys, *arguments)

    yield run
    for name in set(sys.modules) - set(before):
        if getattr(sys.modules[name], "__file__", None) and str(tmp_path) in str(sys.modules[name].__file__):
            del sys.modules[name]  # another test has a module of this name


def test_a_leaf_of_ones_own_is_checked_shown_listed_and_in_the_palette(call, tmp_path):
    (tmp_path / "mine.py").write_text(COUNT)
    module = ("--behavior-module", "mine")
    assert call("behavior", "check", "tree.xml", *module)[1] == "tree.xml: ok, 1 nodes\n"
    assert call("behavior", "show", "tree.xml", *module)[1] == "GiveUp ticks=3\n"
    listed = call("behavior", "list", *module)[1]
    assert "GiveUp: Fail after some ticks.\n    ticks (int, default 2): how many\n" in listed
    assert "_Hidden" not in listed
    assert "Base:" not in listed
    assert '<Action ID="GiveUp">' in call("behavior", "palette", *module)[1]
    code, _, err = call("behavior", "check", "tree.xml")
    assert code == 2
    assert "tree.xml:2: Main: unknown node 'GiveUp', expected one of " in err


@pytest.mark.parametrize("name", ["navigate", "evaluate"])
def test_a_run_uses_it(call, tmp_path, name):
    (tmp_path / "mine.py").write_text(COUNT)
    command = ("navigate", "--log", "run.mcap") if name == "navigate" else ("evaluate", "--runs", "1")
    given = ("--rig", "ideal", "--behavior", "tree.xml", "--behavior-module", "mine", "--json")
    code, out, err = call(*command, *given)
    assert code == 1, err
    document = json.loads(out)
    result = document if name == "navigate" else document["results"][0]
    assert (result["success"], result["reason"]) == (False, "failed")
    assert result["time_s"] == pytest.approx(2 / 30, abs=1e-3)  # two samples after the first
    if name == "navigate":
        from mazeplan.data.runlog import read_log

        assert read_log(tmp_path / "run.mcap").header["behavior_modules"] == ["mine"]


RAISES = (
    IMPORT
    + """
class Raises(MazeLeaf):
    def step(self):
        return {}["nothing"] if self.context.now > 0.1 else Status.RUNNING
"""
)


@pytest.mark.parametrize("words", ["navigate", "evaluate --runs 2", "evaluate --runs 2 --workers 2"])
def test_a_leaf_that_raises_is_told_in_a_line_with_the_place_in_its_code(call, tmp_path, words):
    (tmp_path / "mine.py").write_text(RAISES)
    (tmp_path / "tree.xml").write_text(f"{HEAD}<Raises/>\n</BehaviorTree></root>", encoding="utf-8")
    code, out, err = call(*words.split(), "--rig", "ideal", "--behavior", "tree.xml", "--behavior-module", "mine")
    assert (code, out) == (2, "")
    assert "Traceback" not in err
    told = err.splitlines()[-1]
    assert told.startswith("mazeplan: KeyError: 'nothing', raised by the leaf at ")
    assert "tree.xml:2: Main/Raises (" in told
    assert told.endswith("(mine.py:5)")


@pytest.mark.parametrize("words", ["navigate", "evaluate --runs 2 --workers 2"])
def test_a_leaf_cannot_end_the_program_as_if_all_were_well(call, tmp_path, words):
    (tmp_path / "mine.py").write_text(RAISES.replace("return {}", "return __import__('sys').exit(0) if True else {}"))
    (tmp_path / "tree.xml").write_text(f"{HEAD}<Raises/>\n</BehaviorTree></root>", encoding="utf-8")
    code, out, err = call(*words.split(), "--rig", "ideal", "--behavior", "tree.xml", "--behavior-module", "mine")
    assert (code, out) == (2, "")
    told = err.splitlines()[-1]
    assert told.startswith("mazeplan: RuntimeError: sys.exit(0) in a leaf, which ends no run, raised by the leaf at ")
    assert told.endswith("(mine.py:5)")


def test_processes_of_a_campaign_find_it(tmp_path):
    (tmp_path / "mine.py").write_text(COUNT)
    (tmp_path / "tree.xml").write_text(f"{HEAD}<GiveUp/>\n</BehaviorTree></root>", encoding="utf-8")
    words = "evaluate --rig ideal --runs 2 --workers 2 --behavior tree.xml --behavior-module mine --json"
    done = subprocess.run(
        [sys.executable, "-m", "mazeplan", *words.split()], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1, done.stderr
    assert [result["reason"] for result in json.loads(done.stdout)["results"]] == ["failed", "failed"]


@pytest.mark.parametrize(
    ("source", "said"),
    [
        (None, "--behavior-module: module 'mine' cannot be imported: there is none of that name in"),
        ("import nothing_of_the_kind\n", "mine.py:1: ModuleNotFoundError: No module named 'nothing_of_the_kind'"),
        ("\n1 / 0\n", "mine.py:2: ZeroDivisionError: division by zero"),
        ("def broken(:\n", "mine.py:1: SyntaxError: invalid syntax"),
        ("import sys\nsys.exit('off')\n", "mine.py:2: SystemExit: off"),
        ("from mazeplan import NoLeaf\n", "mine.py:1: ImportError: cannot import name 'NoLeaf'"),
        (IMPORT, "there is no leaf in module 'mine'; expected a class derived from mazeplan.MazeLeaf that has a step"),
        (COUNT.replace("GiveUp", "Track"), "mine.Track: this name is taken; expected another"),
        (COUNT.replace("GiveUp", "Sequence"), "mine.Sequence: this name is taken"),
        (COUNT.replace("GiveUp", "SubTree"), "mine.SubTree: this name is taken"),
        (COUNT.replace("GiveUp", "Action"), "mine.Action: this name is taken"),
        (COUNT.replace('"ticks": Port(int', '"name": Port(int'), "mine.GiveUp: ports: got the name 'name', expected"),
        (COUNT.replace('"ticks": Port(int', '"_skipIf": Port(int'), "ports: got the name '_skipIf', expected"),
        (
            COUNT.replace("Port(int, 2,", "Port(dict, 2,"),
            "mine.GiveUp: ports['ticks']: got the type <class 'dict'>",
        ),
        (COUNT.replace("least=1", "direction='up'"), "ports['ticks']: got 'up', expected one of in, out, inout"),
        (COUNT.replace("Port(int, 2,", "Port(int, 'two',"), "ports['ticks']: default: got 'two', expected int >= 1"),
        (COUNT.replace("Port(int, 2,", "Port(int, '2',"), "ports['ticks']: default: got '2', expected int >= 1"),
        (COUNT.replace("Port(int, 2,", "Port(int, 0,"), "ports['ticks']: default: got 0, expected int >= 1"),
        (COUNT.replace("Port(int, 2,", "Port(bool, 1,").replace(", least=1", ""), "default: got 1, expected bool"),
        (COUNT.replace("Port(int, 2,", "Port(str, 2,"), "least: got 1, expected none for a port of type str"),
        (COUNT.replace("least=1", "least='1'"), "ports['ticks']: least: got '1', expected a number"),
        (COUNT.replace('Port(int, 2, "how many", least=1)', "3"), "ports['ticks']: got 3, expected a Port"),
        (COUNT.replace('{"ticks": Port(int, 2, "how many", least=1)}', "[3]"), "ports: got [3], expected"),
        (
            COUNT.replace("    ports", '    category = "Thing"\n    ports'),
            "category: got 'Thing', expected one",
        ),
    ],
)
def test_what_is_no_module_of_leaves_is_one_line_and_two(call, tmp_path, source, said):
    if source is not None:
        (tmp_path / "mine.py").write_text(source)
    code, out, err = call("behavior", "check", "tree.xml", "--behavior-module", "mine")
    assert (code, out) == (2, "")
    assert said in err
    assert len(err.strip().splitlines()) == 1


def test_a_leaf_that_leaves_its_base_unmade_is_told(call, tmp_path):
    own = "    def __init__(self, name, context, board, values):\n        self.mine = 3\n"
    (tmp_path / "mine.py").write_text(COUNT.replace("    def start", f"{own}\n    def start", 1))
    code, out, err = call("behavior", "check", "tree.xml", "--behavior-module", "mine")
    assert (code, out) == (2, "")
    said = "its __init__ does not call super().__init__(name, context, board, values)"
    assert f"tree.xml:2: Main/GiveUp: GiveUp could not be made: {said}" in err
    assert len(err.strip().splitlines()) == 1


@pytest.mark.parametrize("made", ["{}['rails']", "super().__init__(name)", "__import__('sys').exit(0)"])
def test_a_leaf_that_cannot_be_made_is_one_line_and_two(call, tmp_path, made):
    own = f"    def __init__(self, name, context, board, values):\n        {made}\n"
    (tmp_path / "mine.py").write_text(COUNT.replace("    def start", f"{own}\n    def start", 1))
    for words in (("behavior", "check", "tree.xml"), ("navigate", "--behavior", "tree.xml")):
        code, out, err = call(*words, "--behavior-module", "mine")
        assert (code, out) == (2, "")
        assert "tree.xml:2: Main/GiveUp: GiveUp could not be made: " in err
        assert f"{tmp_path / 'mine.py'}:9: " in err
        assert len(err.strip().splitlines()) == 1


def test_every_command_says_so(call):
    for words in (["navigate"], ["evaluate"], ["behavior", "show"], ["behavior", "list"], ["behavior", "palette"]):
        for name in ("nowhere", "../up", ""):
            code, out, err = call(*words, "--behavior-module", name)
            assert (code, out) == (2, "")
            assert err.startswith("mazeplan: --behavior-module: ")
            assert len(err.strip().splitlines()) == 1


def test_two_modules_may_be_given_but_not_one_name_twice(call, tmp_path):
    (tmp_path / "mine.py").write_text(COUNT)
    (tmp_path / "other.py").write_text(COUNT)
    (tmp_path / "third.py").write_text("from mine import GiveUp\n" + COUNT.replace("GiveUp", "GiveIn"))
    option = "--behavior-module"
    assert call("behavior", "check", "tree.xml", option, "mine", option, "third", option, "mine")[0] == 0
    code, _, err = call("behavior", "check", "tree.xml", option, "mine", option, "other")
    assert code == 2
    assert "other.GiveUp: this name is taken" in err
