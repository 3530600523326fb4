"""Logs that cannot be replayed, and the command."""

from __future__ import annotations

import json
import textwrap

import pytest
from commands import call
from replayed import rewritten, tick

from mazeplan.core.errors import InputError, LogError
from mazeplan.run.execution import navigate
from mazeplan.run.replay import replay

# -- what cannot be replayed ---------------------------------------------------------------------------------------


def test_leaves_of_ones_own_and_trees_are_told_by_their_content(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "push_leaf.py").write_text(
        textwrap.dedent("""
        from mazeplan import MazeLeaf, Status
        from mazeplan.core.records import Command

        class Push(MazeLeaf):
            def step(self):
                if self.context.now > 0.4:
                    return Status.SUCCESS
                self.context.steer(self.name, Command(0.01, 0.0))
                return Status.RUNNING
        """)
    )
    tree = tmp_path / "tree.xml"
    tree.write_text(
        '<root BTCPP_format="4" main_tree_to_execute="M"><BehaviorTree ID="M"><Push/></BehaviorTree></root>'
    )
    options = {"behavior": "tree.xml", "behavior_modules": ["push_leaf"], "log": "run.mcap"}
    assert navigate(3, 3, rig="ideal", **options).success
    assert replay("run.mcap").identical
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert replay("../run.mcap").identical  # from anywhere
    moved = tree.rename(tmp_path / "moved.xml")
    with pytest.raises(InputError, match=r"tree\.xml"):
        replay("../run.mcap")
    tree.write_text(moved.read_text().replace("<Push/>", "<Push />"))
    with pytest.raises(LogError, match=r"the behaviour tree .*tree\.xml is not that of the run"):
        replay("../run.mcap")
    moved.rename(tree)
    with (tmp_path / "push_leaf.py").open("a") as file:
        file.write("# changed\n")
    with pytest.raises(LogError, match=r"the module .*push_leaf\.py is not that of the run"):
        replay("../run.mcap")


def old(header, messages):
    del header["replay"]


def newer(header, messages):
    header["replay"]["format"] = 2


def settings_of_others(header, messages):
    text = json.loads(header["replay"]["settings"])
    del text["leaves"]["cost"]["speed"]
    header["replay"]["settings"] = json.dumps(text)


def settings_out_of_range(header, messages):
    header["replay"]["settings"] = header["replay"]["settings"].replace('"deadline_ms": 0.5', '"deadline_ms": -1.0')


def no_rate(header, messages):
    del header["replay"]["rate_hz"]


def bad_map(header, messages):
    header["map"] = header["map"].replace("rings:", "rungs:")


def no_time(header, messages):
    del tick(messages, 3)["beta"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (old, "damaged"),
        (settings_out_of_range, "header.replay.settings: of another version: deadline_ms: got -1, expected"),
        (no_rate, "damaged"),
    ],
)
def test_logs_that_cannot_be_replayed_say_so_in_one_line(recorded, monkeypatch, capsys, change, said):
    code, out, err = call(monkeypatch, capsys, "log", "replay", rewritten(recorded[0], change))
    assert code == 2
    assert out == ""
    assert len(err.splitlines()) == 1
    assert said in err
    assert "other.mcap" in err


def test_files_that_are_no_whole_log_of_a_navigation(recorded, monkeypatch, capsys, tmp_path):
    whole = recorded[0].read_bytes()
    collected = tmp_path / "collected.mcap"
    assert call(monkeypatch, capsys, "collect", "--rig", "ideal", "--seconds", "1", "-o", collected)[0] == 0
    half = tmp_path / "half.mcap"
    half.write_bytes(whole[: len(whole) // 2])
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(whole[:5000] + b"\0" * 50 + whole[5050:])
    (tmp_path / "text.mcap").write_text("hello")
    for path, said in (
        (collected, "got a log of `collect`, expected one of `navigate --log`"),
        (half, "cut off"),
        (damaged, "damaged"),
        (tmp_path / "text.mcap", "expected a run log of mazeplan"),
        (tmp_path / "none.mcap", "no such file, expected a run log"),
    ):
        code, out, err = call(monkeypatch, capsys, "log", "replay", path)
        assert (code, out, len(err.splitlines())) == (2, "", 1)
        assert said in err
        assert path.name in err


# -- the command ---------------------------------------------------------------------------------------------------
