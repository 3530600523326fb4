"""A camera and a tilt sensor that are off: in the file, and put right on the way to the estimator."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from mazeplan.control.estimation.estimator import Estimator
from mazeplan.core.errors import ModelError
from mazeplan.core.records import Observation
from mazeplan.learning.modelfile import load_model, save_model
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.rig.sensors import Camera, TiltSensor
from mazeplan.physics.rig.stage import StageAxis, StageModel

MAZE = load_map("cme")
OFF = replace(
    load_model("ideal"), camera=Camera(0.001, -0.002, 0.03, stderr={"angle": 0.001}), tilt_sensor=TiltSensor(1.1, 0.9),
    stage=StageModel(StageAxis(1.1, backlash=0.01), StageAxis(0.9, offset=0.009)),
)  # fmt: skip


def test_round_trip_and_nothing_in_the_file_where_nothing_is_off(tmp_path):
    save_model(OFF, tmp_path / "off")
    again = load_model(tmp_path / "off")
    assert again == OFF
    assert again.camera.stderr == {"angle": 0.001}
    text = save_model(load_model("ideal"), tmp_path / "ideal").read_text()
    assert not {"camera:", "tilt_sensor:", "backlash:"} & set(text.split())


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("offset_x: {value: 0.001", "offset_x: {value: 1.0", "camera: offset_x: got 1.0, expected -0.05 to 0.05 m"),
        ("offset_x:", "ofset_x:", "camera.ofset_x: unknown key, expected one of offset_x, offset_y, angle"),
        ("gain_beta: {value: 1.1", "gain_beta: {value: 0.0", "tilt_sensor: gain_beta: got 0.0, expected 0.3 to 3.0"),
        ("backlash: {value: 0.01", "backlash: {value: -1", "stage.beta: backlash: got -1.0, expected 0.0 to 0.2"),
    ],
)
def test_mistakes_are_one_line_with_place(tmp_path, old, new, said):
    path = save_model(OFF, tmp_path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(ModelError) as problem:
        load_model(tmp_path)
    assert said in str(problem.value)


def test_the_estimator_sees_ball_and_plate_where_they_are():
    x, y = 0.08, 0.03
    c, s = math.cos(0.03), math.sin(0.03)
    seen = Observation(0.0, c * x - s * y + 0.001, s * x + c * y - 0.002, 0.022, 0.018)
    state = Estimator(MAZE, OFF).update(seen)
    assert (state.x, state.y) == pytest.approx((x, y), abs=1e-9)
    estimator = Estimator(MAZE, OFF)
    for k in range(60):
        state = estimator.update(replace(seen, t=k / 30.0))
    assert state.beta == pytest.approx(0.02, abs=0.01)
    assert state.beta / state.gamma == pytest.approx(1.0, abs=0.1), "1.1 and 0.9 times as large as measured"


def test_the_stage_is_planned_with_in_tilts_as_they_are():
    stage = OFF.planar(MAZE).stage
    assert stage[:, 0] == pytest.approx([1.0, 1.0])
    assert stage[1, 3] == pytest.approx(0.01)
