"""Numbers in the wrong unit: the message names the unit and what was probably meant."""

from __future__ import annotations

import re
import shutil

import pytest

from mazeplan.core.field_checks import unit_of
from mazeplan.core.resources import share
from mazeplan.learning.modelfile import PACKAGED

CME = (share("maps") / "cme.yaml").read_text()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "tilt_limit_deg: 5",
            "tilt_limit_deg: 0.0873",
            "tilt_limit_deg: got 0.0873, .*unit is deg: did you mean 5.002",
        ),
        (
            "mass_g: 8.4",
            "mass_g: 0.0084",
            "mass_g: got 0.0084, expected .*for a ball of this radius.* did you mean 8.4",
        ),
        ("mass_g: 8.4", "mass_g: 8400", "mass_g: got 8400, .*did you mean 8.4"),
        ("radius_mm: 6.35", "radius_mm: 0.00635", "radius_mm: got 0.00635, .*unit is mm: did you mean 6.35"),
        ("outer_radius_mm: 96.89", "outer_radius_mm: 0.09689", "outer_radius_mm: got 0.09689, .*did you mean 96.89"),
        ("width_mm: 15.5", "width_mm: 0.0155", "width_mm: got 0.0155, .*did you mean 15.5"),
        ("wall_height_mm: 20", "wall_height_mm: 0.02", "wall_height_mm: got 0.02, .*did you mean 20"),
    ],
)
def test_a_map(refused, tmp_path, old, new, said):
    assert old in CME
    (tmp_path / "mine.yaml").write_text(CME.replace(old, new))
    assert re.search(rf"mine.yaml:\d+: .*{said}\?", refused("map", "check", tmp_path / "mine.yaml"))


def test_a_map_with_angles_in_radians(call, tmp_path):
    near = re.sub(r"angle_deg: (\d+)", lambda found: f"angle_deg: {int(found[1]) * 0.0174533:.4f}", CME)
    (tmp_path / "mine.yaml").write_text(near)
    assert "the unit is deg: are the angles in radians?" in call("map", "check", tmp_path / "mine.yaml")[2]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("servo_frequency_rad_s: 4.1", "the unit is rad/s: did you mean 25.76?"),
        ("servo_slew_deg_s: 2.1", "the unit is deg/s: did you mean 120.3?"),
        ("rolling_friction_m: 0.02", "the unit is m: did you mean 2e-05?"),
        ("magnet_depth_mm: 0.015", "the unit is mm: did you mean 15?"),
    ],
)
def test_a_rig(refused, tmp_path, line, said):
    (tmp_path / "rig.yaml").write_text(line + "\n")
    err = refused("navigate", "--rig", tmp_path / "rig.yaml")
    assert f"rig.yaml:1: {line.partition(':')[0]}: got" in err
    assert said in err


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("gate: {window_mm: 0.0134}", "got 0.0134, expected 0, or at least 0.05; the unit is mm: did you mean 13.4?"),
        ("travel: {deadline_ms: 0.015}", "the unit is ms: did you mean 15?"),
    ],
)  # fmt: skip
def test_settings(refused, tmp_path, line, said):
    (tmp_path / "own.yaml").write_text(line + "\n")
    assert said in refused("navigate", "--settings", tmp_path / "own.yaml")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (r"beta: \{value: 0.000268882", "beta: {value: 0.7", "did you mean 0.01222?"),
        (r"offset: \{value: 7.13204e-06", "offset: {value: 1.5", "the unit is rad: did you mean 0.02618?"),
        (r"camera_delay_s: \{value: 0.0,", "camera_delay_s: {value: 74,", "the unit is s: did you mean 0.074?"),
    ],
)
def test_a_model(refused, tmp_path, old, new, said):
    model = tmp_path / "model"
    shutil.copytree(PACKAGED / "ideal", model)
    text = (model / "model.yaml").read_text()
    assert re.search(old, text)
    (model / "model.yaml").write_text(re.sub(old, new, text, count=1))
    assert said in refused("model", "show", model)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("compare", "x.csv", "--radius", "68"),
            "--radius: got 68, expected 0.002 to 2 m; the unit is m: did you mean 0.068?",
        ),
        (
            ("compare", "x.csv", "--delay", "74"),
            "--delay: got 74, expected 0 to 0.5 s; the unit is s: did you mean 0.074?",
        ),
    ],
)
def test_an_option(refused, words, said):
    assert said in refused(*words)


@pytest.mark.parametrize(
    ("key", "unit"), [("servo_slew_deg_s", "deg/s"), ("drag_per_m", ""), ("push_m_s2", ""), ("speed_m_s", "m/s")]
)
def test_the_unit_of_a_key(key, unit):
    assert unit_of(key) == unit


def test_a_system_in_degrees(refused, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "swing.py").write_text(
        'class Swing:\n    position, unit = "theta", "deg"\n\n    def motion(s, p):\n        return 0.0\n'
    )
    (tmp_path / "x.csv").write_text("t,theta\n0,0\n")
    said = "unit: got 'deg', expected rad or m: convert the column theta first"
    assert said in refused("diagnose", "x.csv", "--system", "swing:Swing")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("navigate", "--start-angle", "1e300"), "--start-angle: got 1e300, expected -3600 to 3600 degrees"),
        (
            ("collect", "--rig", "ideal", "--highest-hz", "40", "-o", "a.mcap"),
            "expected at most 15 Hz: half the samples",
        ),
        (("navigate", "--view", "--port", "70000"), "--port"),
    ],
)
def test_a_number_that_is_far_too_large(refused, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    assert said in refused(*words)
    assert not list(tmp_path.iterdir())
