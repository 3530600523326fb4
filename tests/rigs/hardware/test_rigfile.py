"""The rig's YAML file: errors with their line, calibrations that leave all else as it is, which file is meant."""

from __future__ import annotations

from pathlib import Path

import pytest

from mazeplan.core.errors import InputError, SettingsError
from mazeplan.maze.mapfile import load_map
from mazeplan.maze.yamltree import parse_yaml
from mazeplan.rigs.hardware.settings import hardware_file, is_hardware, merged
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
    with pytest.raises(InputError, match=r"link\.yaml: cannot be written: the file is read-only"):
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
        ("tilt: {centre_v: [1, 2, 3]}", ":4: tilt.centre_v: got 3 entries"),
        ("camera: {focal_px: [400, 0]}", ":4: camera.focal_px[1]: got 0"),
    ],
)
def test_mistakes_are_told_with_their_line(tmp_path, line, said):
    path = tmp_path / "rig.yaml"
    path.write_text(f"# mine\nclass: mazeplan.rigs.hardware:HardwareRig\nport: x\n{line}\n")
    with pytest.raises(SettingsError) as caught:
        make_rig(str(path), MAZE)
    assert str(caught.value).startswith(f"{path}{said}")


@pytest.mark.parametrize(
    ("servo", "missing"),
    [
        ("", "servo.beta.min_us"),
        ("servo: {slew_us_per_s: 5000.0}\n", "servo.beta.min_us"),
        ("servo:\n  beta: {min_us: 1200.0, max_us: 1700.0}\n  gamma: {max_us: 1700.0}\n", "servo.gamma.min_us"),
    ],
)
def test_no_servo_moves_where_the_file_has_no_limits(tmp_path, monkeypatch, servo, missing):
    monkeypatch.setattr("mazeplan.rigs.hardware.rig.open_board", lambda port, limits: pytest.fail("it was opened"))
    path = tmp_path / "rig.yaml"
    path.write_text(f"{CLASS}port: /dev/ttyACM0\n{servo}")
    rig = make_rig(str(path), MAZE)
    for reach in (lambda: rig.board, rig.ready, rig.observe):  # pyright: ignore[reportAttributeAccessIssue]
        with pytest.raises(SettingsError, match=f"rig.yaml:[1345]: {missing}: is missing: no servo moves without"):
            reach()


TEXT = """\
# mine
class: mazeplan.rigs.hardware:HardwareRig
port: /dev/ttyACM0   # the blue one

tilt:   # old
  # in V
  centre_v: [2.5, 2.5]   # of the middle
  beta_deg: {one: 1.0,   # at level
    a: 3.0}
  note: 'a # that is none'
  # of last year

# what follows is the camera
camera:
  source: 0
"""


def put(text, key, value):
    return merged(text, key, value, file="f.yaml")


def test_values_come_over_values_and_other_lines_stay():
    text = put(TEXT, "tilt", {"centre_v": [2.4, 2.6], "beta_deg": {"one": 2.0}, "note": "new", "date": "today"})
    assert "  centre_v: [2.4, 2.6]   # of the middle\n" in text
    assert "port: /dev/ttyACM0   # the blue one\n" in text
    assert parse_yaml(text, file="f").data["tilt"] == {
        "centre_v": [2.4, 2.6], "beta_deg": {"one": 2.0}, "note": "new", "date": "today",
    }  # fmt: skip
    for comment in ("# old", "# in V", "# of last year", "# what follows is the camera"):
        assert text.count(comment) == 1
    assert put(TEXT, "latency", {"camera_ms": 5.0}).endswith("latency: {camera_ms: 5.0}\n")
