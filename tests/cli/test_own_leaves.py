"""Your own leaves, in a module of the working folder."""

from __future__ import annotations

import json
import sys

import pytest

from mazeplan.core.logs.run_log_reader import read_log

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
MODULE = ("--behavior-module", "mine")
OWN = ("--rig", "ideal", "--behavior", "tree.xml", *MODULE)


def tree(folder, leaf):
    (folder / "tree.xml").write_text(f"{HEAD}{leaf}\n</BehaviorTree></root>", encoding="utf-8")


@pytest.fixture(autouse=True)
def place(monkeypatch, tmp_path):
    """A working folder with a tree; modules of other tests' folders, which have the same names, are forgotten."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(COUNT)
    tree(tmp_path, '<GiveUp ticks="3"/>')
    others = str(tmp_path.parents[1])
    monkeypatch.setattr(sys, "path", [folder for folder in sys.path if others not in folder])

    def forget():
        for name, module in list(sys.modules.items()):
            if others in str(getattr(module, "__file__", None)):
                del sys.modules[name]

    forget()
    yield tmp_path
    forget()


def test_your_own_leaf_is_checked_shown_listed_and_in_the_palette(call, refused):
    assert call("behavior", "check", "tree.xml", *MODULE)[1] == "tree.xml: ok, 1 nodes\n"
    assert call("behavior", "show", "tree.xml", *MODULE)[1] == "GiveUp ticks=3\n"
    listed = call("behavior", "list", *MODULE)[1]
    assert "GiveUp: Fail after some ticks.\n    ticks (int, default 2): how many\n" in listed
    assert "_Hidden" not in listed
    assert "Base:" not in listed
    assert '<Action ID="GiveUp">' in call("behavior", "palette", *MODULE)[1]
    assert (
        "tree.xml:2: Main/GiveUp: unknown node 'GiveUp', which --behavior-module may add; expected one of "
        in refused("behavior", "check", "tree.xml")
    )


@pytest.mark.slow
@pytest.mark.parametrize("words", ["navigate --log run.mcap", "evaluate --runs 1", "evaluate --runs 2 --workers 2"])
def test_a_run_uses_it(call, place, words):
    code, out, err = call(*words.split(), *OWN, "--json")
    assert code == 1, err
    document = json.loads(out)
    for result in document.get("results", [document]):
        assert (result["success"], result["reason"]) == (False, "failed")
        assert result["time_s"] == pytest.approx(2 / 30, abs=1e-3)  # two samples after the first
    if "--log" in words:
        assert read_log(place / "run.mcap").header["behavior_modules"] == ["mine"]
