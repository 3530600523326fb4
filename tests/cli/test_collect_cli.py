"""`collect` and `learn` from the command line."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest
from commands import call

from mazeplan.collect import EXCITE
from mazeplan.data.runlog import read_log
from mazeplan.data.table import read_table
from mazeplan.maze.mapfile import load_map


def test_collect_and_learn_from_the_command_line(monkeypatch, capsys, tmp_path):
    log, model = tmp_path / "log.mcap", tmp_path / "model"
    code, _, err = call(
        monkeypatch, capsys, "collect", "--rig", "ideal", "--seconds", "60", "--seed", "4", "-o", str(log)
    )
    assert code == 0
    assert "wrote 1800 samples" in err
    code, out, _ = call(monkeypatch, capsys, "learn", str(log), "-o", str(model), "--kind", "pi", "--json")
    assert code == 0
    document = json.loads(out)
    assert document["kind"] == "pi"
    assert document["stage"]["beta"]["gain"]["value"] == pytest.approx(1.0, abs=0.02)
    code, out, _ = call(monkeypatch, capsys, "learn", str(log), "-o", str(model), "--kind", "p")
    assert "stage beta" in out
    code, _, _ = call(monkeypatch, capsys, "navigate", "--rig", "ideal", "--from", "ring4", "--model", str(model))
    assert code == 0


def test_rings_drives_and_place_places(monkeypatch, capsys, tmp_path):
    driven, placed = tmp_path / "driven.mcap", tmp_path / "placed.mcap"
    common = ("--rig", "ideal", "--map", "lopsided", "--rings", "--seed", "2")
    code, out, err = call(
        monkeypatch, capsys, "collect", *common, "--ring", "ring2", "--seconds", "6", "-o", str(driven)
    )
    assert (code, out) == (0, "")
    assert "ring 1 " in err
    assert "drives " in err
    assert "wrote 180 samples" in err
    log = read_log(driven)
    assert log.header["model"] == "pi"  # the rig's own model drives
    assert log.header["rings"] == [2, 1, 3]
    assert EXCITE in log.ticks["leaf"]
    code, _, err = call(monkeypatch, capsys, "collect", *common, "--place", "--seconds", "22", "-o", str(placed))
    assert code == 0
    assert err == f"wrote 660 samples to {placed}\n"
    table = read_table(placed)
    assert list(np.unique(table.segment)) == [0, 1]
    assert load_map("lopsided").ring_at(float(table["r"][600])) == 2


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["learn", "none.mcap", "-o", "m"], "no such file"),
        (["learn", "none.mcap", "-o", "m", "--kind", "sp"], "no such file"),
        (["learn", "none.mcap", "-o", "m", "--kind", "magic"], "expected one of p, pi"),
        (["collect", "-o", "x.mcap", "--seconds", "-1"], "--seconds"),
        (["collect", "-o", "x.mcap", "--ring", "ring7"], "ring1 to ring5"),
        (["collect", "-o", "x.mcap", "--place"], "--place: needs --rings"),
        (["collect", "-o", "x.mcap", "--model", "toy"], "--model: needs --rings"),
        (["collect", "-o", "x.mcap", "--rings", "--place", "--model", "toy"], "--model: needs --rings"),
        (["collect", "-o", "x.mcap", "--rings", "--model", "none"], "none"),
    ],
)
def test_bad_input_is_one_line_and_two(monkeypatch, capsys, tmp_path, arguments, said):
    monkeypatch.chdir(tmp_path)
    code, out, err = call(monkeypatch, capsys, *arguments)
    assert code == 2
    assert out == ""
    assert said in err
    assert len(err.strip().splitlines()) == 1


def test_whoever_interrupts_is_told_what_is_kept(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "pressed_rig.py").write_text(
        "from mazeplan.rigs.simulated import SimulatedRig\n\n\nclass Pressed(SimulatedRig):\n"
        "    def observe(self):\n        sample = super().observe()\n"
        "        if sample.t > 1.0:\n            raise KeyboardInterrupt\n        return sample\n"
    )
    code, _, err = call(monkeypatch, capsys, "collect", "--rig", "pressed_rig:Pressed", "-o", "c.mcap")
    assert code == 130
    assert err.splitlines()[-2:] == ["what was recorded until then is in c.mcap", "mazeplan: interrupted"]
    assert 25 < len(read_table(tmp_path / "c.mcap")) < 35


@pytest.mark.parametrize("more", [(), ("--rings",)])
def test_a_rig_that_cannot_be_driven_yet_leaves_the_log_alone(monkeypatch, capsys, tmp_path, more):
    monkeypatch.chdir(tmp_path)
    log = tmp_path / "c.mcap"
    for command in (("collect", "-o", str(log), *more), ("navigate", "--log", str(log))):
        code, _, err = call(monkeypatch, capsys, *command, "--rig", "hardware")
        assert code == 2
        assert "not calibrated yet: first mazeplan calibrate tilt and mazeplan calibrate camera" in err.splitlines()[-1]
        assert not log.exists()
    log.write_text("of yesterday")
    assert call(monkeypatch, capsys, "collect", "-o", str(log), *more, "--rig", "hardware")[0] == 2
    assert log.read_text() == "of yesterday"
