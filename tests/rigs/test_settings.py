"""Settings files of simulated rigs, and what `--rig` stands for."""

from __future__ import annotations

import math
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from mazeplan.core.errors import SettingsError
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig, rig_label, rig_model_hint, rig_names
from mazeplan.rigs.sim.simulated import SimulatedRig

MAZE = load_map("cme")
MAPS = Path(__file__).resolve().parents[2] / "maps"


def test_packaged_rigs_are_as_documented():
    assert rig_names() == ("hardware", "ideal", "rough", "toy")
    ideal, rough, toy = (make_rig(name, MAZE).settings for name in rig_names()[1:])  # pyright: ignore
    for name in ("camera_noise_mm", "camera_delay_frames", "tilt_noise_deg", "table_x_deg", "ball_lost_probability"):
        assert getattr(ideal, name) == 0
    assert (toy.camera_noise_mm, toy.camera_delay_frames, toy.tilt_noise_deg) == (0.5, 2, 0.05)
    assert (toy.table_x_deg, toy.table_y_deg, toy.rolling_friction_m, toy.wall_grip) == (0.3, 0.15, 5e-5, 0.3)
    assert (toy.ball_lost_probability, toy.ball_lost_frames) == (0.005, 3)
    assert toy.wall_segments >= 192
    assert (rough.camera_noise_mm, rough.camera_delay_frames, rough.rolling_friction_m) == (1.0, 3, 1e-4)
    assert np.hypot(rough.table_x_deg, rough.table_y_deg) == pytest.approx(0.5)
    assert rough.servo_frequency_rad_s == pytest.approx(0.7 * toy.servo_frequency_rad_s, rel=0.02)


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("camera_noise_mm: 0.5\ncamera_nois_mm: 1\n", 2, "camera_nois_mm: unknown key"),
        ("rate_hz: .nan\n", 1, "rate_hz"),
    ],
)
def test_mistakes_are_one_line_with_place(tmp_path, text, line, said):
    path = tmp_path / "rig.yaml"
    path.write_text(text)
    with pytest.raises(SettingsError) as error:
        make_rig(str(path), MAZE)
    assert str(error.value).startswith(f"{path}:{'' if line is None else line}")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_labels_and_model_hints(tmp_path):
    rig, model = tmp_path / "mine.yaml", tmp_path / "model"
    model.mkdir()
    rig.write_text("model: model\ncamera_noise_mm: 1\n")
    assert rig_label(str(rig)) == "mine"
    assert rig_model_hint(str(rig)) == str(model)
    rig.write_text("model: toy\n")
    assert rig_model_hint(str(rig)) == "toy"
    assert rig_model_hint("ideal") == "ideal"
    rig.write_text("camera_noise_mm: 1\n")
    assert rig_model_hint(str(rig)) is None
    assert rig_model_hint("module:Class") is None
    rig.write_text("model: [toy]\n")
    with pytest.raises(SettingsError, match=r"mine.yaml:1: model"):
        rig_model_hint(str(rig))
    assert isinstance(make_rig("toy", MAZE), SimulatedRig)
    assert rig_label("a.b:C") == "a.b:C"


def test_a_class_beside_the_file_gets_the_other_keys(tmp_path, monkeypatch):
    (tmp_path / "own_rig_module.py").write_text(
        textwrap.dedent("""
        class Own:
            rate_hz = 30.0
            def __init__(self, maze, settings): self.maze, self.settings = maze, settings
            def reset(self, *, ring, theta, rng): ...
            def observe(self): ...
            def command(self, u_beta, u_gamma): ...
            def level(self): ...
            def close(self): ...
        """)
    )
    (tmp_path / "own.yaml").write_text("class: own_rig_module:Own\nport: /dev/ttyACM0\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    rig = make_rig("own.yaml", MAZE)
    assert rig.settings == {"port": "/dev/ttyACM0"}  # pyright: ignore
    assert make_rig("own_rig_module:Own", MAZE).settings == {}  # pyright: ignore


def test_a_rig_may_have_a_map_of_its_own(tmp_path):
    """The machine is what it is, whatever the planner believes: its walls are those of its own map."""
    (tmp_path / "table.yaml").write_text((MAPS / "lopsided.yaml").read_text())
    (tmp_path / "rig.yaml").write_text("map: table.yaml\n")
    rig, lopsided = make_rig(str(tmp_path / "rig.yaml"), MAZE), load_map("lopsided")
    assert lopsided.ring(1).track_radius != pytest.approx(MAZE.ring(1).track_radius, abs=1e-3)
    rig.reset(ring=1, theta=0.0, rng=np.random.default_rng(0))
    seen = rig.observe()
    assert math.hypot(seen.x, seen.y) == pytest.approx(lopsided.ring(1).track_radius, abs=2e-3)
    rig.close()
