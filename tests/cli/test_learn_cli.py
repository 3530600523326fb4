"""`learn`: all kinds of models, from a short log of the planar rig."""

from __future__ import annotations

import json
import re
from functools import partial

import numpy as np
import pytest
from commands import plain
from planar_rig import PlanarRig

from mazeplan.control.estimation.rigid_body_fit import body_of
from mazeplan.diagnosis.rig.reference import load_reference
from mazeplan.learning import gp_training
from mazeplan.learning.features import inputs
from mazeplan.learning.modelfile import RigModel, load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.ball_model import RingKinematics
from mazeplan.run.collect import Collection, run_collection

MAZE, COMMANDS = load_map("cme"), ("u_beta", "u_gamma")


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """One thread, and short training."""
    pytest.importorskip("torch").set_num_threads(1)
    monkeypatch.setattr(gp_training, "TrainingOptions", partial(gp_training.TrainingOptions, iterations=10))


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """60 s of the planar rig, excited in ring 2."""
    path = tmp_path_factory.mktemp("logs") / "log.mcap"
    run_collection(PlanarRig(MAZE), MAZE, Collection(60.0, (2,), seed=2), path)
    return path


@pytest.fixture
def learn(call, tmp_path):
    return partial(call, "learn", "-o", tmp_path / "model")


STATES = RingKinematics(
    MAZE.track_radius(2),
    *np.random.default_rng(0).uniform(-1.0, 1.0, (8, 50)) * np.array([[3, 2, 0.08, 0.3, 1, 0.08, 0.3, 1]]).T,
)


@pytest.mark.slow
@pytest.mark.usefixtures("no_reference")
@pytest.mark.parametrize("kind", ["p", "pi"])
def test_models_of_effects_are_written(learn, log, tmp_path, kind):
    code, out, _ = learn(log, "--kind", kind)
    assert code == 0
    for begin in ("stage:", "camera_delay_s: ", "rings: ", "  rolling_inertia.factor ", "rigid ball: ", "wrote "):
        assert any(line.startswith(begin) for line in out.splitlines())
    assert "learned part" not in out
    model = load_model(tmp_path / "model")
    assert (model.kind, dict(model.processes)) == (kind, {})
    nominal = RigModel.nominal(MAZE).ball(2).parameter("rolling_inertia", "factor", 1.0)
    fitted = model.ball(2).parameter("rolling_inertia", "factor", 1.0)
    assert (abs(fitted - nominal) < 1e-5) == (kind == "p")  # the file rounds
    assert fitted == pytest.approx(nominal, abs=0.15)


@pytest.mark.slow
@pytest.mark.usefixtures("no_reference")
@pytest.mark.parametrize("kind", ["np", "sp"])
def test_models_with_gaussian_processes_are_written(learn, log, tmp_path, kind):
    code, out, err = learn(log, "--kind", kind, "--most", "300", "--seed", "1")
    assert (code, err) == (0, "")  # progress is for terminals
    model = load_model(tmp_path / "model")
    assert model.kind == kind
    for ring, process in model.processes.items():
        assert f"learned part of ring {ring}: {len(process)} rows" in out
        assert len(process) <= 300
    scores = model.scores
    with_it, before = scores[f"nrmse_test_{kind}"], scores["nrmse_test_effects"]
    useful = {ring for ring in with_it if kind == "np" or with_it[ring] <= before[ring]}  # np has nothing else
    assert {f"ring{ring}" for ring in model.processes} == useful
    assert scores["smoothing"]["method"] == "rts"
    # of 300 rows, with a ball that also hits walls, a Gaussian process cannot make much
    assert 0.0 < with_it["ring2"] < 0.95
    assert before["ring2"] < 0.7
    assert f"wrote {tmp_path / 'model' / 'model.yaml'}" in out


@pytest.mark.slow
def test_sp_is_the_default_and_json_is_the_model(learn, log, tmp_path, monkeypatch):
    monkeypatch.setattr("mazeplan.diagnosis.rig.words.REMAINS", 2.0)  # the planar rig's ball is no rigid ball
    code, out, err = learn(log, "--most", "300", "--json", terminal=True)
    assert code == 0
    document = json.loads(out)
    assert document["kind"] == "sp"
    assert document["scores"]["smoothing"] == {"method": "rts", "model": "snap"}  # the default
    assert document["model"] == str(tmp_path / "model" / "model.yaml")
    assert document["reference"] == str(tmp_path / "model" / "reference.yaml")
    model = load_model(tmp_path / "model")
    reference, body = load_reference(tmp_path / "model", model), body_of(model)
    assert reference is not None
    assert body is not None
    assert body.ball == reference.body.model.ball
    assert document["stage"]["beta"]["gain"]["value"] == pytest.approx(1.0, abs=0.02)
    assert "ring2" in document["scores"]["nrmse_test_sp"]
    for words in (r"stage", r"ring 2", r"[1-9]\d?%"):
        assert re.search(rf"learning .*{words}", plain(err)), words
    # the written model predicts, and not the same everywhere
    assert all(np.ptp(process.mean(inputs(STATES))) > 0.01 for process in model.processes.values())
    assert model.processes
