"""The rig's YAML file: errors with their line, calibrations that leave all else as it is, which file is meant."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mazeplan.core.errors import SettingsError
from mazeplan.core.resources import to_install
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.hardware.files import hardware_file, is_hardware
from mazeplan.rigs.link.messages import HARD_SLEW, HARD_US
from mazeplan.rigs.registry import PACKAGED, make_rig, rig_file, rig_model_hint

MAZE = load_map("cme")
EMULATED = Path(__file__).resolve().parents[3] / "tools" / "emulated.yaml"
CLASS = "class: mazeplan.rigs.hardware:HardwareRig\n"


def test_hardware_is_the_file_in_this_folder_before_the_template(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert rig_file("hardware") == PACKAGED / "hardware.yaml"
    Path("hardware.yaml").write_text("class: mazeplan.rigs.hardware:HardwareRig\nmodel: rough\n")
    assert rig_file("hardware") == Path("hardware.yaml")
    assert rig_model_hint("hardware") == "rough"
    assert is_hardware("hardware")
    assert is_hardware(str(EMULATED))
    assert not is_hardware("toy")
    with pytest.raises(SettingsError, match="got rig 'toy'"):
        hardware_file("toy")


def test_calibrations_do_not_change_the_template(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = (PACKAGED / "hardware.yaml").read_text()
    section = {"command_ms": 10.0, "camera_ms": 50.0, "date": "2026-11-22"}
    assert hardware_file("hardware").write({"latency": section}) == Path("hardware.yaml")
    assert (PACKAGED / "hardware.yaml").read_text() == before
    assert Path("hardware.yaml").read_text().startswith(before)
    assert hardware_file("hardware").settings.latency.camera_ms == 50.0


def test_a_rigs_file_keeps_its_rights_and_its_link(tmp_path):
    mine, link = tmp_path / "mine.yaml", tmp_path / "link.yaml"
    mine.write_text(CLASS)
    mine.chmod(0o640)
    link.symlink_to(mine.name)
    hardware_file(str(link)).write({"latency": {"command_ms": 10.0, "camera_ms": 50.0, "date": "2026-11-22"}})
    assert link.is_symlink()
    assert mine.stat().st_mode & 0o777 == 0o640
    assert "camera_ms: 50.0" in mine.read_text()
    mine.chmod(0o444)
    with pytest.raises(SettingsError, match=r"link\.yaml: cannot be written: the file is read-only"):
        hardware_file(str(link)).write({"latency": {"command_ms": 10.0, "camera_ms": 40.0, "date": "2026-11-22"}})
    assert "camera_ms: 50.0" in mine.read_text()


TILT = "centre_v: [2.0, 2.0], beta_deg: {a: 1.0}"


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (
            "servo: {beta: {level_us: 1500, min_us: 1600}}",
            ":4: servo.beta: got min_us 1600, level_us 1500, max_us 1800",
        ),
        ("servo: {beta: {min_us: 700}}", ":4: servo.beta.min_us: got 700 us"),
        ("servo: {slew_us_per_s: 60000}", ":4: servo.slew_us_per_s: got 60000 us/s"),
        ("tilt: {centre_v: [1, 2, 3]}", ":4: tilt.centre_v: got 3 entries"),
        (f"tilt: {{{TILT}, scale_v: [1, 0]}}", ":4: tilt.scale_v: got [1.0, 0.0]"),
        (
            f"tilt: {{{TILT}, scale_v: [1.0, 1.0], gamma_deg: {{z: 1.0}}}}",
            ":4: tilt.gamma_deg: got 'z'",
        ),
        ("camera: {ball_hue_deg: [4, 400]}", ":4: camera.ball_hue_deg[1]: got 400"),
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


def test_the_limits_are_the_firmwares():
    header = (Path(__file__).parents[3] / "tools" / "firmware" / "control.h").read_text()
    told = {name: float(value) for name, value in re.findall(r"#define (HARD_\w+) (\d+)", header)}
    assert (told["HARD_MIN"] / 10.0, told["HARD_MAX"] / 10.0) == HARD_US
    assert told["HARD_SLEW"] == HARD_SLEW


@pytest.mark.parametrize(
    ("servo", "missing"),
    [
        ("", "servo.beta.min_us"),
        ("servo: {slew_us_per_s: 5000.0}\n", "servo.beta.min_us"),
        ("servo:\n  beta: {min_us: 1200.0, max_us: 1700.0}\n  gamma: {max_us: 1700.0}\n", "servo.gamma.min_us"),
    ],
)
def test_no_servo_moves_where_the_file_has_no_limits(tmp_path, monkeypatch, servo, missing):
    monkeypatch.setattr("mazeplan.rigs.hardware.rig.open_board", lambda settings: pytest.fail("it was opened"))
    path = tmp_path / "rig.yaml"
    path.write_text(f"{CLASS}port: /dev/ttyACM0\n{servo}")
    rig = make_rig(str(path), MAZE)
    for reach in (lambda: rig.board, rig.ready, rig.observe):  # pyright: ignore[reportAttributeAccessIssue]
        with pytest.raises(SettingsError, match=f"rig.yaml:[1345]: {missing}: is missing: no servo moves without"):
            reach()


def test_a_missing_class_is_named(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text("port: /dev/ttyACM0\nservo: {}\n")
    with pytest.raises(SettingsError) as caught:
        make_rig(str(path), MAZE)
    assert str(caught.value).startswith(
        f"{path}:1: class: is missing; the file of a rig on a table begins with `class: "
    )
    with pytest.raises(SettingsError, match=r"rig.yaml: got rig .*"):
        hardware_file(str(path))


def test_a_missing_background_is_named_with_its_line(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text(EMULATED.read_text())
    rig = make_rig(str(path), MAZE)
    line = next(i for i, row in enumerate(path.read_text().splitlines(), start=1) if "background" in row)
    with pytest.raises(SettingsError) as caught:
        rig.observe()
    said = f"{path}:{line}: camera.background: {tmp_path}/emulated.png: background cannot be read: No such file"
    assert str(caught.value).startswith(said)


def test_the_template_names_the_missing_calibrations(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rig = make_rig("hardware", MAZE)
    with pytest.raises(SettingsError) as caught:
        rig.reset(ring=1, theta=0.0, rng=np.random.default_rng(0))
    assert "first mazeplan calibrate tilt and mazeplan calibrate camera" in str(caught.value)
    assert "\n" not in str(caught.value)
    rig.close()


@pytest.mark.slow
def test_without_opencv_it_says_what_to_install(tmp_path):
    script = "import sys; sys.modules['cv2'] = None; sys.argv[0] = 'mazeplan'; "
    script += "import mazeplan.apps.cli; mazeplan.apps.cli.main()"
    command = [sys.executable, "-c", script, "navigate", "--rig", "hardware"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 3
    assert done.stderr == f"mazeplan: a rig on a table needs cv2: {to_install('hardware')}\n"
