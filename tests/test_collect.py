"""Collecting and learning: segments, safety, and the two commands."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest
from planar_rig import PlanarRig

from mazeplan.cli import main
from mazeplan.collect import STRETCH_S, Collection, run_collection
from mazeplan.data.table import read_table
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")


def test_each_placing_is_a_segment_and_time_goes_on(tmp_path):
    rig, log = PlanarRig(MAZE), tmp_path / "log.mcap"
    rows = run_collection(rig, MAZE, Collection(50.0, (1, 3), seed=2), log)
    table = read_table(log)
    assert rows == len(table) == 1500
    assert list(np.unique(table.segment)) == [0, 1, 2]
    assert np.all(np.diff(table["t"]) > 0.0)
    starts = np.flatnonzero(np.diff(table.segment, prepend=-1.0))
    assert [MAZE.ring_at(r) for r in table["r"][starts]] == [1, 3, 1]
    assert table["t"][starts[1]] == pytest.approx(STRETCH_S)
    assert rig.levelled
    assert rig.closed
    assert np.allclose(table["u_beta"], np.array(rig.commands)[:, 0])


def test_an_interrupted_collection_levels_closes_and_keeps_what_it_has(tmp_path):
    def fail(rig):
        if rig.t > 1.0:
            raise KeyboardInterrupt

    rig, log = PlanarRig(MAZE, mishap=fail), tmp_path / "log.mcap"
    with pytest.raises(KeyboardInterrupt):
        run_collection(rig, MAZE, Collection(50.0, (1,)), log)
    assert rig.levelled
    assert rig.closed
    assert 25 < len(read_table(log)) < 40


def call(monkeypatch, capsys, *arguments):
    monkeypatch.setattr(sys, "argv", ["mazeplan", *arguments])
    try:
        main()
        code = 0
    except SystemExit as stop:
        code = stop.code or 0
    got = capsys.readouterr()
    return code, got.out, got.err


def test_collect_and_learn_from_the_command_line(monkeypatch, capsys, tmp_path):
    log, model = tmp_path / "log.mcap", tmp_path / "model"
    code, _, err = call(
        monkeypatch, capsys, "collect", "--rig", "ideal", "--seconds", "90", "--seed", "4", "-o", str(log)
    )
    assert code == 0
    assert "wrote 2700 samples" in err
    code, out, _ = call(monkeypatch, capsys, "learn", str(log), "-o", str(model), "--json")
    assert code == 0
    document = json.loads(out)
    assert document["kind"] == "pi"
    assert document["stage"]["beta"]["gain"]["value"] == pytest.approx(1.0, abs=0.02)
    code, out, _ = call(monkeypatch, capsys, "learn", str(log), "-o", str(model), "--kind", "p")
    assert "stage beta" in out
    code, _, _ = call(monkeypatch, capsys, "navigate", "--rig", "ideal", "--from", "ring4", "--model", str(model))
    assert code == 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["learn", "none.mcap", "-o", "m"], "no such file"),
        (["learn", "none.mcap", "-o", "m", "--kind", "sp"], "not available"),
        (["learn", "none.mcap", "-o", "m", "--kind", "magic"], "expected one of p, pi"),
        (["collect", "-o", "x.mcap", "--seconds", "-1"], "--seconds"),
        (["collect", "-o", "x.mcap", "--ring", "ring7"], "ring1 to ring5"),
    ],
)
def test_bad_input_is_one_line_and_two(monkeypatch, capsys, tmp_path, arguments, said):
    monkeypatch.chdir(tmp_path)
    code, out, err = call(monkeypatch, capsys, *arguments)
    assert code == 2
    assert out == ""
    assert said in err
    assert len(err.strip().splitlines()) == 1
