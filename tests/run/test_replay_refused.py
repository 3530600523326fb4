"""Logs that cannot be replayed, and the command."""

from __future__ import annotations

import json
import re
import textwrap

import pytest
from commands import call, plain
from replayed import other_end, rewritten, tick

from mazeplan.core.errors import InputError, LogError, SettingsError
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.mapfile import load_map
from mazeplan.run.navigate import navigate
from mazeplan.run.replay import replay
from mazeplan.run.settings import Settings, load_settings, settings_from_text

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
    assert replay("../run.mcap", behavior=str(moved)).identical
    moved.write_text(moved.read_text().replace("<Push/>", "<Push />"))
    with pytest.raises(LogError, match=r"the behaviour tree .*moved\.xml is not that of the run"):
        replay("../run.mcap", behavior=str(moved))
    moved.write_text(moved.read_text().replace("<Push />", "<Push/>"))
    with (tmp_path / "push_leaf.py").open("a") as file:
        file.write("# changed\n")
    with pytest.raises(LogError, match=r"the module push_leaf \(.*push_leaf\.py\) is not that of the run"):
        replay("../run.mcap", behavior=str(moved))


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


def bad_memory(header, messages):
    header["replay"]["memory"] = {"fading_s": 1.0, "openings": [1]}


def no_time(header, messages):
    del tick(messages, 3)["beta"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (old, "was written before runs could be replayed"),
        (newer, "header.replay.format: got 2, expected 1, which mazeplan"),
        (settings_of_others, "header.replay.settings: of another version: expected"),
        (settings_out_of_range, "header.replay.settings: of another version: deadline_ms: got -1, expected"),
        (no_rate, "damaged: a field is missing or of the wrong kind ('rate_hz'"),
        (bad_map, "header.map"),
        (bad_memory, "damaged"),
        (no_time, "damaged: a field is missing or of the wrong kind ('beta')"),
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


@pytest.mark.slow
def test_the_command_tells_the_first_difference_with_both_sides(recorded, monkeypatch, capsys):
    def change(header, messages):
        tick(messages, 20).update(status="SUCCESS", leaf="Nobody", u_beta=0.1)
        tick(messages, 25)["leaf"] = "Later"

    other = rewritten(recorded[0], change)
    code, out, err = call(monkeypatch, capsys, "log", "replay", other)
    lines = out.splitlines()
    assert code == 1
    assert err == ""
    assert lines[0].endswith("different at t = 0.667 s, tick 20, tick: status, leaf, u_beta")
    assert "Later" not in out
    code, out, _ = call(monkeypatch, capsys, "log", "replay", other, "--json")
    document = json.loads(out)
    assert code == 1
    assert not document["identical"]
    assert document["difference"]["tick"] == 20
    assert document["difference"]["recorded"]["leaf"] == "Nobody"
    assert document["difference"]["replayed"]["status"] == "RUNNING"
    code, out, _ = call(monkeypatch, capsys, "log", "replay", rewritten(recorded[0], other_end), "--json")
    assert code == 1
    assert '"reason": "stuck"' in out
    assert '"reason": "arrived"' in out


@pytest.mark.slow
def test_the_command_says_identical(recorded, monkeypatch, capsys):
    code, out, err = call(monkeypatch, capsys, "log", "replay", recorded[0])
    assert err == ""
    assert code == 0
    assert out.splitlines()[0].startswith(f"{recorded[0]}: identical: ")
    assert "searches ended by the deadline" in out
    code, out, err = call(monkeypatch, capsys, "log", "replay", recorded[0], "--json", terminal=True)
    assert re.search(r"replaying .*100%", plain(err))
    document = json.loads(out)
    assert code == 0
    assert document["identical"]
    assert document["difference"] is None
    code, out, _ = call(monkeypatch, capsys, "log", "info", recorded[0], "--json")
    assert "replay" not in json.loads(out)["header"]  # long, and for the program only


def test_another_version_is_named_beside_a_difference(recorded, monkeypatch, capsys):
    def change(header, messages):
        header["version"] = "0.0.1"
        other_end(header, messages)

    code, out, _ = call(monkeypatch, capsys, "log", "replay", rewritten(recorded[0], change))
    assert code == 1
    assert "recorded by another version of mazeplan, 0.0.1" in out


def test_settings_are_told_to_the_last_bit():
    settings = load_settings().with_values({"travel": {"lean_deg": 0.1 + 0.2, "deadline_ms": 1e6}})
    assert settings_from_text(settings.text()) == settings
    assert settings_from_text(settings.text()) != load_settings()
    older = settings.text().replace('"horizon": 30, ', "")  # of a log of 0.1.0, when plans had 40 ticks
    assert older != settings.text()
    assert settings_from_text(older) == settings.with_values({"travel": {"horizon": 40}})
    older = settings.text().replace('"substeps": 5, ', "")
    assert settings_from_text(older) == settings.with_values({"rollout": {"substeps": 10}})
    broken = settings.text().replace('"deadline_ms": 1000000.0', '"deadline_ms": -1.0')
    with pytest.raises(SettingsError, match="deadline_ms"):
        settings_from_text(broken)
    for text in ("[]", "{}", '{"leaves": 1, "estimator": 2}', "x"):
        with pytest.raises(ValueError):
            settings_from_text(text)
    assert isinstance(settings_from_text(Settings().text()), Settings)


def test_nominal_physics_are_those_of_the_map(tmp_path):
    lopsided = load_map("lopsided")
    path = tmp_path / "run.mcap"
    navigate(2, 3, map=lopsided, rig="ideal", model=RigModel.nominal(lopsided), log=path)
    assert replay(path).identical
