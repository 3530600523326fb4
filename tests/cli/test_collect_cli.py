"""`collect`, and `learn` from its log."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest

from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.core.logs.table import read_table
from mazeplan.maze.mapfile import load_map
from mazeplan.run.collect import EXCITE


@pytest.mark.slow
@pytest.mark.usefixtures("no_reference")
def test_a_model_learned_from_a_collected_log_navigates(call, tmp_path):
    log, model = tmp_path / "log.mcap", tmp_path / "model"
    code, _, err = call("collect", "--rig", "ideal", "--seconds", "30", "--seed", "4", "-o", log)
    assert code == 0
    assert "wrote 900 samples" in err
    code, out, _ = call("learn", log, "-o", model, "--kind", "pi", "--json")
    assert code == 0
    assert json.loads(out)["kind"] == "pi"
    assert json.loads(out)["stage"]["beta"]["gain"]["value"] == pytest.approx(1.0, abs=0.02)
    assert "stage:" in call("learn", log, "-o", model, "--kind", "p", "--force")[1]
    assert call("navigate", "--rig", "ideal", "--from", "ring4", "--model", model)[0] == 0


@pytest.mark.slow
def test_rings_drives_and_place_places(call, tmp_path):
    driven, placed = tmp_path / "driven.mcap", tmp_path / "placed.mcap"
    common = ("collect", "--rig", "ideal", "--map", "lopsided", "--rings", "--seed", "2")
    code, out, err = call(*common, "--ring", "ring2", "--seconds", "6", "-o", driven)
    assert (code, out) == (0, "")
    for words in ("ring 1 ", "drives ", "wrote 180 samples"):
        assert words in err
    log = read_log(driven)
    assert log.header["model"] == "pi"  # the rig's own model drives
    assert log.header["rings"] == [2, 1, 3]
    assert EXCITE in log.ticks["leaf"]
    code, _, err = call(*common, "--place", "--seconds", "22", "-o", placed)
    assert (code, err) == (0, f"wrote 660 samples to {placed}\n")
    table = read_table(placed)
    assert list(np.unique(table.segment)) == [0, 1]
    assert load_map("lopsided").ring_at(float(table["r"][600])) == 2


def test_ctrl_c_keeps_the_samples_so_far(call, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "pressed_rig.py").write_text(
        "from mazeplan.rigs.sim.simulated import SimulatedRig\n\n\nclass Pressed(SimulatedRig):\n"
        "    def observe(self):\n        sample = super().observe()\n"
        "        if sample.t > 1.0:\n            raise KeyboardInterrupt\n        return sample\n"
    )
    code, _, err = call("collect", "--rig", "pressed_rig:Pressed", "-o", "c.mcap")
    assert code == 130
    assert err.splitlines()[-2:] == ["the samples so far are in c.mcap", "mazeplan: interrupted"]
    assert 25 < len(read_table(tmp_path / "c.mcap")) < 35


@pytest.mark.parametrize("command", [("collect", "-o"), ("collect", "--rings", "-o"), ("navigate", "--log")])
def test_a_rig_without_calibration_leaves_the_log_alone(call, monkeypatch, tmp_path, command):
    monkeypatch.chdir(tmp_path)
    log = tmp_path / "c.mcap"
    for before in (None, "of yesterday"):
        if before:
            log.write_text(before)
        code, _, err = call(*command, log, "--rig", "hardware", "--force")
        assert code == 2
        assert "not calibrated yet: first mazeplan calibrate tilt and mazeplan calibrate camera" in err.splitlines()[-1]
        assert (log.read_text() if log.exists() else None) == before
