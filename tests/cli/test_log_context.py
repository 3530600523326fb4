"""The rig and map of a record: those given, else those of its log."""

from __future__ import annotations

import pytest

from mazeplan.core.errors import InputError
from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.maze.mapfile import dump_map, load_map
from mazeplan.run.commands.log_context import logged_map

CME, SEVEN = dump_map(load_map("cme")), dump_map(load_map("seven"))


def log(folder, **header):
    path = folder / "log.mcap"
    with RunLogWriter(path, {"program": "mazeplan", **header}):
        pass
    return path


@pytest.mark.parametrize(
    ("name", "header", "expected", "known"),
    [(None, {"map": SEVEN}, "seven", True), ("lopsided", {"map": SEVEN}, "lopsided", True), (None, {}, "cme", False)],
)
@pytest.mark.filterwarnings("ignore:.*used with --map")
def test_the_map_is_the_given_one_else_that_of_the_log_else_cme(tmp_path, name, header, expected, known):
    found = logged_map(name, tmp_path / "table.csv", log(tmp_path, **header))
    assert (found.maze, found.known) == (load_map(expected), known)


def test_logs_of_two_maps_are_no_record_of_one_rig(tmp_path):
    both = [log(tmp_path, map=SEVEN).rename(tmp_path / "a.mcap"), log(tmp_path, map=CME)]
    with pytest.raises(
        InputError, match=r"log\.mcap: recorded on the map .*, but .*a\.mcap on .*; expected logs of one"
    ):
        logged_map(None, *both)
    assert logged_map(None, both[0], both[0]).maze == load_map("seven")
