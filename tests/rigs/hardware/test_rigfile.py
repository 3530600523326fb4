"""The rig's YAML file: errors with their line, calibrations that leave all else as it is, which file is meant."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mazeplan.errors import SettingsError
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.hardware.files import hardware_file, is_hardware
from mazeplan.rigs.hardware.settings import replaced
from mazeplan.rigs.registry import PACKAGED, make_rig, rig_file, rig_model_hint

MAZE = load_map("cme")
TEXT = """\
# mine
class: mazeplan.rigs.hardware:HardwareRig
port: /dev/ttyACM0   # the blue one

tilt:   # old
  beta_deg: {one: 1.0}
  # of last year

# what follows is the camera
camera:
  source: 0
"""


def test_a_section_is_replaced_and_every_other_line_stays():
    text = replaced(TEXT, "tilt", {"beta_deg": {"one": 2.0}})
    assert text == TEXT.replace(
        "tilt:   # old\n  beta_deg: {one: 1.0}\n  # of last year\n", "tilt:\n  beta_deg: {one: 2.0}\n"
    )
    assert replaced(TEXT, "latency", {"camera_ms": 5.0}) == TEXT + "latency: {camera_ms: 5.0}\n"
    assert replaced("a: 1\nlist:\n- 1\n- 2\nb: 2\n", "list", [3]) == "a: 1\nlist: [3]\nb: 2\n"


def test_hardware_is_the_file_in_this_folder_before_the_template(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert rig_file("hardware") == PACKAGED / "hardware.yaml"
    Path("hardware.yaml").write_text("class: mazeplan.rigs.hardware:HardwareRig\nmodel: rough\n")
    assert rig_file("hardware") == Path("hardware.yaml")
    assert rig_model_hint("hardware") == "rough"
    assert is_hardware("hardware")
    assert is_hardware("emulated")
    assert not is_hardware("toy")
    with pytest.raises(SettingsError, match="got rig 'toy', expected one on a table"):
        hardware_file("toy")


def test_what_is_measured_goes_beside_the_template_and_not_into_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = (PACKAGED / "hardware.yaml").read_text()
    section = {"command_ms": 10.0, "camera_ms": 50.0, "date": "2026-11-22"}
    assert hardware_file("hardware").write({"latency": section}) == Path("hardware.yaml")
    assert (PACKAGED / "hardware.yaml").read_text() == before
    assert Path("hardware.yaml").read_text().startswith(before)
    assert hardware_file("hardware").settings.latency.camera_ms == 50.0
    assert hardware_file("hardware").keeps
    assert not hardware_file("emulated").keeps


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("servo: {beta: {level_us: 1500, min_us: 1600}}", ":4: servo.beta: expected min_us < level_us < max_us"),
        ("servo: {beta: {us_per_deg: 0.5}}", ":4: servo.beta: us_per_deg: expected at least 1 us per degree"),
        ("servo: {delta: {}}", ":4: servo.delta: unknown key, expected one of beta, gamma, slew_us_per_s"),
        ("tilt: {beta_deg: {c: 1.0}}", ":4: tilt.centre_v: is missing"),
        (
            "latency: {command_ms: -1, camera_ms: 1}",
            ":4: latency.command_ms: got -1, expected greater than or equal to 0",
        ),
        ("speed: 3", ":4: speed: unknown key, expected one of model, port, rate_hz"),
        ("camera: {focal_px: [1, 2]}", ":4: camera."),
    ],
)
def test_mistakes_are_told_with_their_line(tmp_path, line, said):
    path = tmp_path / "rig.yaml"
    path.write_text(f"# mine\nclass: mazeplan.rigs.hardware:HardwareRig\nport: x\n{line}\n")
    with pytest.raises(SettingsError) as caught:
        make_rig(str(path), MAZE)
    assert str(caught.value).startswith(f"{path}{said}")


def test_the_template_says_what_is_to_be_calibrated_before_anything_is_opened(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rig = make_rig("hardware", MAZE)
    with pytest.raises(SettingsError) as caught:
        rig.reset(ring=1, theta=0.0, rng=np.random.default_rng(0))
    assert "first mazeplan calibrate tilt and mazeplan calibrate camera" in str(caught.value)
    assert "\n" not in str(caught.value)
    rig.close()


def test_a_file_that_cannot_be_read_is_not_written(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text("class: mazeplan.rigs.hardware:HardwareRig\n")
    file = hardware_file(str(path))
    path.write_text("a: [1\n")
    with pytest.raises(SettingsError, match="not valid YAML"):
        file.write({"latency": {"camera_ms": 1.0, "command_ms": 1.0}})
    assert path.read_text() == "a: [1\n"


@pytest.mark.parametrize("name", ["hardware", "emulated"])
def test_without_opencv_it_says_what_to_install(name, tmp_path):
    script = "import sys; sys.modules['cv2'] = None; sys.argv[0] = 'mazeplan'; import mazeplan.cli; mazeplan.cli.main()"
    command = [sys.executable, "-c", script, "navigate", "--rig", name]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 3
    assert done.stderr == "mazeplan: a rig on a table needs cv2: pip install 'mazeplan[hardware]'\n"
