"""Model folders: read, written, edited by a person, refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml
from stage_kinds import KINDS

from mazeplan.core.errors import ModelError
from mazeplan.learning.modelfile import RigModel, load_model, model_names, save_model
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effects.ball import dry_friction, rolling_inertia
from mazeplan.physics.registry import EFFECTS, make_term
from mazeplan.physics.rig.stage import StageAxis, StageModel

MAZE = load_map("cme")
MODEL = RigModel(
    StageModel(StageAxis(1.01, 24.0, 0.8, 0.02, 0.001, {"gain": 0.01}), StageAxis()),
    {1: BallModel((rolling_inertia(0.58), dry_friction(0.3)), {"rolling_inertia": {"factor": 0.01}}), 3: BallModel()},
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


ROUGH = StageAxis(
    1.0, 12.0, 1.0, 0.03, order=1, rate_limit=0.8, resolution=0.002, backlash=0.004, behind=True,
    stderr={"natural_frequency": 0.5},
)  # fmt: skip


@pytest.mark.parametrize("axis", [*KINDS.values(), ROUGH], ids=[*KINDS, "first order, limited, with steps"])
def test_every_kind_of_axis_survives_the_file(tmp_path, axis):
    """And a delay down to minus the dead time."""
    model = replace(MODEL, stage=StageModel(axis, ROUGH), camera_delay=-ROUGH.dead_time)
    path = save_model(model, tmp_path)
    again = load_model(tmp_path)
    assert again == model
    assert again.stage.gamma.stderr == ROUGH.stderr
    document = yaml.safe_load(path.read_text())["stage"]["beta"]
    assert ("damping" in document) == (axis.order == 2), "no number that the kind does not have"
    assert (document["natural_frequency"].keys() >= {"value"}) == (axis.order > 0)
    save_model(replace(model, camera_delay=-0.001 - model.stage.dead_time), tmp_path)
    with pytest.raises(ModelError, match="camera_delay_s"):
        load_model(tmp_path)


def test_an_axis_that_a_person_writes_as_one_that_follows_at_once(tmp_path):
    document = HAND.replace("gamma: {}", "gamma: {follows: at once, natural_frequency: {faster_than: 80}}")
    (tmp_path / "model.yaml").write_text(document)
    assert load_model(tmp_path).stage.gamma == StageAxis(1.0, 80.0, 1.0, order=0)


HAND = """\
format: 1
kind: pi
stage:
  beta: {gain: 1.0, damping: 0.9}
  gamma: {}
rings:
  1:
    rolling_inertia: {factor: 0.6}
    dry_friction: {coefficient: {value: 0.3, stderr: 0.1}}
"""


@pytest.mark.parametrize(
    ("old", "new", "where", "said"),
    [
        ("format: 1\n", "", "1: ", "format is missing"),
        ("kind: pi", "kind: magic", "2: kind: ", "got 'magic'"),
        ("gain: 1.0", "gain: {value: 1.0, unit: Hz}", "4: stage.beta.gain.unit: ", "got 'Hz'"),
        ("kind: pi", "rate_hz: 0.033", "2: rate_hz: ", "got 0.033"),
        ("kind: pi", "scores: [0.3]", "2: scores: ", "got a list"),
        ("kind: pi", "camera_delay_s: {stderr: 0.1}", "2: camera_delay_s: ", "value is missing"),
        ("gain: 1.0", "gain: 99", "4: stage.beta: ", "gain: got 99.0"),
        ("gamma: {}", "gamma: 3", "5: stage.gamma: ", "got 3"),
        ("  1:\n", "  1: {}\n  01:\n", "8: rings.01: ", "expected a ring number"),
        ("factor: 0.6", "factor: .nan", "8: rings.1.rolling_inertia.factor: ", "expected a finite number"),
        ("{factor: 0.6}", "0.6", "8: rings.1.rolling_inertia: ", "got 0.6"),
        (
            "stderr: 0.1",
            "stderr: much",
            "9: rings.1.dry_friction.coefficient.stderr: ",
            "got 'much'",
        ),
        (HAND, "format: !!python/object/apply:os.getcwd []\n", "1: ", "not allowed"),
    ],
)
def test_mistakes_of_a_person_name_file_line_and_key(tmp_path, old, new, where, said):
    path = tmp_path / "model.yaml"
    assert old in HAND
    path.write_text(HAND)
    load_model(tmp_path)
    path.write_text(HAND.replace(old, new, 1))
    with pytest.raises(ModelError) as error:
        load_model(tmp_path)
    assert str(error.value).startswith(f"{path}:{where}")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_every_effect_survives_the_file(tmp_path):
    rng, effects = np.random.default_rng(0), []
    for name, kind in EFFECTS.items():
        values = {key: float(f"{rng.uniform(p.low, p.high):.6g}") for key, p in kind.parameters.items()}
        effects.append(make_term(name, values))
    model = replace(MODEL, balls={2: BallModel(tuple(effects))})
    save_model(model, tmp_path)
    assert load_model(tmp_path) == model


def test_packaged_models_are_of_their_rigs():
    assert model_names() == ("ideal", "rough", "toy")
    toy, ideal = load_model("toy"), load_model("ideal")
    assert toy.kind == "sp"
    assert set(toy.processes) == {1, 2, 3, 4}
    assert all(len(process) == 1000 for process in toy.processes.values())
    assert toy.camera_delay == pytest.approx(2 / 30, abs=6e-3)
    assert ideal.camera_delay == pytest.approx(0.0, abs=2e-3)
    offset = toy.ball(1)
    assert offset.parameter("tilt_offset", "gamma", 0.0) == pytest.approx(0.3 * 3.14159 / 180, abs=1.5e-3)
    assert offset.parameter("tilt_offset", "beta", 0.0) == pytest.approx(0.15 * 3.14159 / 180, abs=1.5e-3)
    assert toy.data[0]["sha256"]


@pytest.mark.parametrize("name", model_names())
def test_packaged_models_are_whole(name):
    model = load_model(name)
    assert set(model.balls) == {ring.number for ring in MAZE.rings}
    for axis in (model.stage.beta, model.stage.gamma):
        assert set(axis.stderr) == {"gain", "natural_frequency", "damping", "dead_time", "offset"}
        assert axis.gain == pytest.approx(1.0, abs=0.02)
        assert axis.natural_frequency * axis.damping > 15.0  # 1/s: the servo settles within 0.2 s
    for ring in (1, 2, 3, 4):
        assert model.ball(ring).stderr["rolling_inertia"]["factor"] > 0.0
        assert 0.4 < model.ball(ring).parameter("rolling_inertia", "factor", 0.0) < 5 / 7
    assert all(len(entry["sha256"]) == 64 for entry in model.data)


def test_nominal_model_knows_every_ring():
    model = RigModel.nominal(MAZE)
    assert set(model.balls) == {1, 2, 3, 4, 5}
    assert [model.ball(ring).parameter("rolling_inertia", "factor", 0.0) for ring in (1, 4, 5)] == pytest.approx(
        [5 / 9, 5 / 9, 5 / 7]
    )
    assert model.kind == "p"
    assert model.camera_delay == 0.0
    for ring in model.balls:
        assert model.ball(ring).parameter("tilt_offset", "beta", 0.0) == 0.0
        assert model.ball(ring).parameter("viscous_friction", "coefficient", 0.0) > 0.0


def test_how_late_a_rig_is_by_its_model():
    prompt = replace(MODEL, stage=StageModel(StageAxis(dead_time=0.001), StageAxis(dead_time=0.003)))
    assert prompt.late_s == pytest.approx(0.066 + 0.003)
    assert replace(prompt, camera_delay=0.0).late_s == pytest.approx(0.003), "identified, and found to be prompt"
    assert RigModel.nominal(MAZE).late_s == math.inf, "nobody knows"
