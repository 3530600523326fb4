"""Model folders: read, written, edited by a person, refused."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mazeplan.errors import ModelError
from mazeplan.maze.mapfile import load_map
from mazeplan.models.ball import BallModel
from mazeplan.models.effects import DryFriction, RollingInertia
from mazeplan.models.modelfile import RigModel, load_model, model_names, save_model
from mazeplan.models.stage import StageAxis, StageModel

MAZE = load_map("cme")
MODEL = RigModel(
    StageModel(StageAxis(1.01, 24.0, 0.8, 0.02, 0.001, {"gain": 0.01}), StageAxis()),
    {1: BallModel((RollingInertia(0.58), DryFriction(0.3)), {"rolling_inertia": {"factor": 0.01}}), 3: BallModel()},
    camera_delay=0.066,
    camera_delay_stderr=0.002,
    kind="pi",
    data=({"file": "a.mcap", "sha256": "00"},),
    scores={"ring1": 0.3},
)


def test_round_trip(tmp_path):
    save_model(MODEL, tmp_path / "m")
    again = load_model(tmp_path / "m")
    assert again == MODEL
    assert again.stage.beta.stderr == {"gain": 0.01}
    assert again.balls[1].stderr["rolling_inertia"] == {"factor": 0.01}
    assert load_model(tmp_path / "m" / "model.yaml") == MODEL


def test_a_person_may_write_plain_numbers(tmp_path):
    (tmp_path / "model.yaml").write_text(
        "format: 1\nstage:\n  beta: {natural_frequency: 20}\n  gamma: {}\n"
        "rings:\n  1:\n    rolling_inertia: {factor: 0.6}\n"
    )
    model = load_model(tmp_path)
    assert model.stage.beta.natural_frequency == 20.0
    assert model.ball(4).parameter("rolling_inertia", "factor", 1.0) == 0.6  # the nearest ring that has a model
    assert model.camera_delay == 0.0


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("format: 1", "format: 2", "format: got 2, expected 1; it was written by a newer version"),
        ("format: 1", "format: one", "format: got 'one', expected 1"),
        ("kind: pi", "kin: pi", "kin: unknown key"),
        (
            "rolling_inertia:",
            "rolling_inertai:",
            "rings.1.rolling_inertai: got effect 'rolling_inertai', expected one of",
        ),
        ("factor:", "facto:", "expected one of factor"),
        ("value: 0.58", "value: .nan", "rings.1.rolling_inertia.factor"),
        ("value: 0.58", "value: 99", "factor: got 99"),
        ("value: 24.0", "value: fast", "stage.beta.natural_frequency: got 'fast', expected a finite number"),
        ("value: 0.8,", "value: -1,", "stage.beta: damping: got -1"),
        ("value: 0.066", "value: 7", "camera_delay_s: got 7"),
        ("  1:\n", "  one:\n", "expected a ring number"),
        ("stage:", "stge:", "stge: unknown key"),
    ],
)
def test_mistakes_are_one_line_with_place(tmp_path, old, new, said):
    path = save_model(MODEL, tmp_path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ModelError) as error:
        load_model(tmp_path)
    assert said in str(error.value)
    assert str(error.value).startswith(f"{path}:")
    assert "\n" not in str(error.value)


def test_what_is_not_there(tmp_path):
    with pytest.raises(ModelError, match="ideal, toy"):
        load_model(tmp_path / "nowhere")
    (tmp_path / "model.yaml").write_text("format: 1\nstage: {beta: {}, gamma: {}}\nrings: {}\n")
    with pytest.raises(ModelError, match="at least one ring"):
        load_model(tmp_path)
    (tmp_path / "model.yaml").write_text("format: 1\nrings: {}\n")
    with pytest.raises(ModelError, match="stage is missing"):
        load_model(tmp_path)
    with pytest.raises(ModelError, match="cannot be written"):
        save_model(MODEL, tmp_path / "model.yaml" / "inside")


def test_packaged_models_are_of_their_rigs():
    assert model_names() == ("ideal", "toy")
    toy, ideal = load_model("toy"), load_model("ideal")
    assert toy.kind == "pi"
    assert toy.camera_delay == pytest.approx(2 / 30, abs=6e-3)
    assert ideal.camera_delay == pytest.approx(0.0, abs=2e-3)
    offset = toy.ball(1)
    assert offset.parameter("tilt_offset", "gamma", 0.0) == pytest.approx(0.3 * 3.14159 / 180, abs=1.5e-3)
    assert offset.parameter("tilt_offset", "beta", 0.0) == pytest.approx(0.15 * 3.14159 / 180, abs=1.5e-3)
    assert toy.data[0]["sha256"]


def test_nominal_model_knows_every_ring():
    model = RigModel.nominal(MAZE)
    assert set(model.balls) == {1, 2, 3, 4, 5}
    assert model.ball(5).parameter("rolling_inertia", "factor", 0.0) == pytest.approx(5 / 7)
    assert replace(model, camera_delay=0.1).camera_delay == 0.1
