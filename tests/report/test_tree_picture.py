"""Pictures of trees: repeated SubTrees folded, what a run did beside the nodes, the failed path marked."""

from __future__ import annotations

import pytest
from commands import call as run_command

from mazeplan.apps.report import tree_picture
from mazeplan.apps.report.tree_picture import History, history, save_tree_picture
from mazeplan.behavior.outline import rows_of, tree_text
from mazeplan.behavior.own_nodes import registry_with
from mazeplan.behavior.treefile import load_tree
from mazeplan.core.errors import LogError
from mazeplan.core.logs.run_log import read_log

TWICE = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main"><Sequence><SubTree ID="Rest"/><Repeat num_cycles="2"><SubTree ID="Rest" name="more"/></Repeat>
  <LevelPlate name="end"/></Sequence></BehaviorTree>
  <BehaviorTree ID="Rest"><Fallback><Dither/><LevelPlate/></Fallback></BehaviorTree></root>"""


class Context:
    def clock(self):
        return 0.0


def tree_of(text):
    return load_tree(text, registry_with(), Context())


def test_a_subtree_that_stands_in_the_tree_again_is_folded_unless_it_is_needed_or_all_are_asked_for():
    tree = tree_of(TWICE)
    kinds = [type(row.node).__name__ for row in rows_of(tree)]
    assert kinds == ["Sequence", "SubTree", "Fallback", "Dither", "LevelPlate", "Repeat", "SubTree", "LevelPlate"]
    assert [row.number for row in rows_of(tree)] == [0, 1, 2, 3, 4, 5, 6, 10]
    assert [row.folded for row in rows_of(tree)].index(True) == 6
    assert len(rows_of(tree, whole=True)) == len(rows_of(tree, needed=[9])) == 11
    assert len(rows_of(tree, needed=[6, 10])) == 8
    assert tree_text(tree).splitlines()[-2:] == [
        "│   └── SubTree 'more' ID=Rest (as above)", "└── LevelPlate 'end'"
    ]  # fmt: skip
    assert len(tree_text(tree, whole=True).splitlines()) == 11


def test_the_path_to_the_last_failure_is_marked_and_statuses_stand_beside_the_nodes(tmp_path, monkeypatch):
    drawn, marked = [], []
    monkeypatch.setattr(tree_picture, "draw_ending", lambda axes, *what: drawn.append(what))
    draw = tree_picture._draw_nodes
    monkeypatch.setattr(
        tree_picture, "_draw_nodes", lambda axes, rows, bad: marked.append(bad) or draw(axes, rows, bad)
    )
    tree = tree_of(TWICE)
    changes = ((0.0, "-" * 11), (0.1, "RSFFS----R-"), (0.4, "RSFFSRRRR--"), (1.0, "-" * 11))
    save_tree_picture(tree, tmp_path / "t.svg", History(1.0, changes, ((0.4, 8),), frozenset({0, 5, 6, 7, 8})), "title")
    assert marked == [{0, 5, 6, 7, 8}]
    assert ("running", 0, 0.1, 1.0) in drawn
    assert ("failure", 3, 0.1, 1.0) in drawn
    assert ("running", 8, 0.4, 1.0) in drawn, "the failed path is not folded"
    assert ("running", 9, 0.1, 0.4) in drawn
    assert (tmp_path / "t.svg").stat().st_size > 5000


def test_of_a_run_the_tree_and_its_failures_come_from_the_log(tmp_path, monkeypatch, capsys):
    log, picture = tmp_path / "run.mcap", tmp_path / "tree.png"
    (tmp_path / "tree.xml").write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence><AlwaysSuccess/>'
        '<RetryUntilSuccessful num_attempts="2"><PassOpening opening="1-2@45" timeout_s="0.2"/></RetryUntilSuccessful>'
        "</Sequence></BehaviorTree></root>"
    )
    navigate = ("navigate", "--rig", "ideal", "--start-angle", "200", "--behavior", str(tmp_path / "tree.xml"))
    assert run_command(monkeypatch, capsys, *navigate, "--log", str(log))[0] == 1
    code, _, err = run_command(monkeypatch, capsys, "behavior", "show", "--log", str(log), "-o", str(picture))
    assert (code, picture.read_bytes()[:4]) == (0, b"\x89PNG"), err
    did = history(load_tree(tmp_path / "tree.xml", registry_with(), Context()), read_log(log))
    assert [number for _, number in did.failures] == [3, 3]
    assert did.path == {0, 2, 3}
    with pytest.raises(
        LogError, match=r"run.mcap: got the log of another tree, expected one of a run with the tree Main"
    ):
        history(tree_of(TWICE), read_log(log), log)
    code, _, err = run_command(monkeypatch, capsys, "behavior", "show", "--log", str(log))
    assert code == 2
    assert "--log: expected -o FILE, too" in err
