"""The map that a command takes: the one named, else that of the log, else cme."""

from __future__ import annotations

from importlib.metadata import version

from commands import call

from mazeplan.cli.arguments import logged_map
from mazeplan.data.runlog import RunLogWriter
from mazeplan.maze.mapfile import dump_map, load_map

SEVEN = load_map("seven")


def test_the_map_is_that_of_the_log_unless_one_is_named(tmp_path):
    log = tmp_path / "a.mcap"
    with RunLogWriter(log, {"map": dump_map(SEVEN)}):
        pass
    assert logged_map(None, log) == (SEVEN, True)
    assert logged_map("lopsided", log) == (load_map("lopsided"), True)


def test_a_table_tells_none(tmp_path):
    assert logged_map(None, tmp_path / "a.csv") == (load_map("cme"), False)
    with RunLogWriter(tmp_path / "b.mcap", {}):
        pass
    assert logged_map(None, tmp_path / "b.mcap") == (load_map("cme"), False)


def test_the_version_is_that_of_the_package(monkeypatch, capsys):
    assert call(monkeypatch, capsys, "--version") == (0, f"mazeplan {version('mazeplan')}\n", "")
