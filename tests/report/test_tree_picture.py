"""Pictures of trees: repeated SubTrees folded, what a run did beside the nodes, the failed path marked."""

from __future__ import annotations

from contextlib import suppress

import pytest
from commands import call as run_command
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from mazeplan.apps.report import tree_picture
from mazeplan.apps.report.tree_picture import History, history, save_tree_picture
from mazeplan.apps.testing import run_tree
from mazeplan.behavior.own_nodes import registry_with
from mazeplan.behavior.trees import load_tree
from mazeplan.btree.outline import rows_of, tree_text
from mazeplan.core.errors import LogError
from mazeplan.core.logs.run_log import read_log
from mazeplan.core.palette import TINTS

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
        tree_picture, "_draw_nodes", lambda axes, rows, did: marked.append(did.path) or draw(axes, rows, did)
    )
    tree = tree_of(TWICE)
    changes = ((0.0, "-" * 11), (0.1, "RSFFS----R-"), (0.4, "RSFFSRRRR--"), (1.0, "-" * 11))
    save_tree_picture(
        tree, tmp_path / "t.svg", History((0.0, 1.0), changes, ((0.4, 8),), frozenset({0, 5, 6, 7, 8})), "title"
    )
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
    assert (did.path, did.marked, did.words) == ({0, 2, 3}, 3, "✖ ended the run")
    with pytest.raises(
        LogError, match=r"run.mcap: got the log of another tree, expected one of a run with the tree Main"
    ):
        history(tree_of(TWICE), read_log(log), log)
    code, _, err = run_command(monkeypatch, capsys, "behavior", "show", "--log", str(log))
    assert code == 2
    assert "--log: expected -o FILE, too" in err


BODY = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence><AlwaysSuccess/>{}</Sequence></BehaviorTree></root>'
RETRY = '<RetryUntilSuccessful num_attempts="2"><PassOpening opening="1-2@45" timeout_s="0.2"/></RetryUntilSuccessful>'
RAISING = "from mazeplan import MazeLeaf\nclass Breaks(MazeLeaf):\n    def step(self):\n        raise KeyError\n"


@pytest.mark.parametrize(
    ("body", "reason", "marked", "words"),
    [
        (RETRY, "missed_opening", 3, "✖ ended the run"),
        ("<Fallback><InRing ring='4'/><Sleep msec='9000'/></Fallback>", "out_of_time", 4, "▶ running at the limit"),
        ("<Fallback><InRing ring='4'/><AlwaysFailure/></Fallback>", "failed", 4, "✖ ended the run"),
        (f"<ForceSuccess>{RETRY}</ForceSuccess><AlwaysFailure/>", "missed_opening", 4, "✖ ended the run"),
        ("<Inverter><Breaks/></Inverter>", "leaf_failed", 3, "✖ ended the run"),
        (f"<ForceSuccess>{RETRY}</ForceSuccess>", "arrived", 1, "✔ last success"),
        ("<Sleep msec='200'/><ForceSuccess><InRing ring='4'/></ForceSuccess>", "arrived", 2, "✔ last success"),
    ],
)
def test_the_node_that_ended_a_run_ran_at_its_end_or_succeeded_last_is_found(
    tmp_path, monkeypatch, body, reason, marked, words
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "breaking_for_pictures.py").write_text(RAISING)
    (tmp_path / "tree.xml").write_text(BODY.format(body))
    modules = ("breaking_for_pictures",)
    with suppress(KeyError):
        run_tree("tree.xml", goal=1, time_limit=1.0, log="run.mcap", behavior_modules=modules)
    log = read_log(tmp_path / "run.mcap")
    did = history(load_tree("tree.xml", registry_with(modules), Context()), log)
    assert (log.result["reason"], did.marked, did.words) == (reason, marked, words)
    failed_on_the_way = {0, 2, 3, 4} if RETRY in body else set()
    assert max(did.path, default=0) == marked if reason != "arrived" else did.path == failed_on_the_way


def test_of_a_run_of_one_tick_each_status_is_seen_and_the_title_tells_the_outcome(tmp_path, monkeypatch, capsys):
    figures = []
    save = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *a, **k: figures.append(self) or save(self, *a, **k))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tree.xml").write_text(BODY.format("<Fallback><InRing ring='4'/><AlwaysFailure/></Fallback>"))
    run_tree("tree.xml", goal=1, log="run.mcap")
    code, _, err = run_command(monkeypatch, capsys, "behavior", "show", "tree.xml", "--log", "run.mcap", "-o", "t.png")
    assert code == 0, err
    over_time = figures[0].axes[1]
    bars = [path.get_extents() for part in over_time.collections for path in part.get_paths()]
    assert sorted(round(bar.y0 + bar.y1) / 2 for bar in bars) == [0, 1, 2, 3, 4]
    first, last = over_time.get_xlim()
    assert last - first == pytest.approx(1 / 30, abs=0.01)
    assert all(bar.width == pytest.approx(last - first) for bar in bars)
    assert over_time.get_title(loc="left").endswith("\nThe ball did not arrive: the tree failed after 0.00 s.")


def test_the_node_that_ended_a_run_is_marked_and_the_legend_stands_below_all(tmp_path, monkeypatch):
    figures = []
    save = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *a, **k: figures.append(self) or save(self, *a, **k))
    changes = ((0.0, "-" * 11), (0.1, "RSFFS----R-"), (0.4, "RSFFSRRRR--"), (1.0, "-" * 11))
    did = History((0.0, 1.0), changes, ((0.4, 8),), frozenset({0, 5, 6, 7, 8}), 8)
    save_tree_picture(tree_of(TWICE), tmp_path / "t.png", did)
    (figure,) = figures
    nodes, over_time = figure.axes
    marks = [text.get_position()[1] for text in nodes.texts if "ended the run" in text.get_text()]
    assert len(marks) == 1
    filled = [
        t.get_text()
        for t in nodes.texts
        if t.get_bbox_patch() and to_hex(t.get_bbox_patch().get_facecolor()) == TINTS["failure"].lower()
    ]
    assert filled == ["Dither"]
    figure.draw_without_rendering()
    (legend,) = figure.legends
    below = legend.get_window_extent()
    assert over_time.get_legend() is None
    assert below.y1 <= over_time.get_tightbbox().y0
    assert below.y0 >= 0.0
    assert {text.get_text() for text in legend.get_texts()} == {"running", "succeeded", "failed", "a leaf's failure"}
