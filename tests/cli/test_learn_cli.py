"""`learn` from the command line: all kinds on a short log of the planar rig."""

from __future__ import annotations

import json
import re
import sys
from functools import partial

import numpy as np
import pytest
from commands import call, plain
from planar_rig import PlanarRig

from mazeplan.collect import Collection, run_collection
from mazeplan.data.table import read_table
from mazeplan.maze.mapfile import load_map
from mazeplan.models import gp_training
from mazeplan.models.features import inputs
from mazeplan.models.modelfile import RigModel, load_model
from mazeplan.physics.arrays import RingKinematics
from mazeplan.resources import to_install

MAZE = load_map("cme")


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


STATES = RingKinematics(
    MAZE.track_radius(2),
    *np.random.default_rng(0).uniform(-1.0, 1.0, (8, 50)) * np.array([[3, 2, 0.08, 0.3, 1, 0.08, 0.3, 1]]).T,
)


@pytest.mark.parametrize("kind", ["p", "pi"])
def test_models_of_effects_are_written(monkeypatch, capsys, log, tmp_path, kind):
    code, out, _ = call(monkeypatch, capsys, "learn", log, "-o", tmp_path / "model", "--kind", kind)
    assert code == 0
    lines = out.splitlines()
    for start in ("stage beta", "stage gamma", "camera", "ring 1", "ring 5", "wrote "):
        assert any(line.startswith(start) for line in lines)
    assert "process" not in out
    model = load_model(tmp_path / "model")
    assert model.kind == kind
    assert not model.processes
    nominal = RigModel.nominal(MAZE).ball(2).parameter("rolling_inertia", "factor", 1.0)
    fitted = model.ball(2).parameter("rolling_inertia", "factor", 1.0)
    assert (abs(fitted - nominal) < 1e-5) == (kind == "p")  # the file rounds
    assert fitted == pytest.approx(nominal, abs=0.15)


@pytest.mark.parametrize("kind", ["np", "sp"])
def test_models_with_processes_are_written(monkeypatch, capsys, log, tmp_path, kind):
    arguments = ("learn", log, "-o", tmp_path / "model", "--kind", kind, "--most", "300", "--smoothing", "savgol")
    code, out, err = call(monkeypatch, capsys, *arguments, "--seed", "1")
    assert code == 0
    assert err == ""  # what is being done is for terminals
    model = load_model(tmp_path / "model")
    assert model.kind == kind
    assert 2 in model.processes
    assert len(model.processes[2]) <= 300
    for ring, process in model.processes.items():
        [line] = [line for line in out.splitlines() if line.startswith(f"ring {ring} process: ")]
        assert f"{len(process)} rows, nRMSE of theta_dd on test blocks" in line
    scores = model.scores
    assert scores["smoothing"]["method"] == "savgol"
    # of 300 rows, with a ball that also hits walls, a process alone cannot make much
    assert 0.0 < scores[f"nrmse_test_{kind}"]["ring2"] < (0.7 if kind == "sp" else 0.95)
    assert scores["nrmse_test_effects"]["ring2"] < 0.7
    assert f"wrote {tmp_path / 'model' / 'model.yaml'}" in out


def test_sp_is_the_default_and_json_is_the_model(monkeypatch, capsys, log, tmp_path):
    code, out, err = call(
        monkeypatch, capsys, "learn", log, "-o", tmp_path / "model", "--most", "300", "--json", terminal=True
    )
    assert code == 0
    document = json.loads(out)
    assert document["kind"] == "sp"
    assert document["scores"]["smoothing"] == {"method": "rts", "model": "snap"}  # the default
    assert document["model"] == str(tmp_path / "model" / "model.yaml")
    assert document["stage"]["beta"]["gain"]["value"] == pytest.approx(1.0, abs=0.02)
    assert "ring2" in document["scores"]["nrmse_test_sp"]
    shown = plain(err)
    for words in (r"stage", r"ring 2: rbf, start 1 of 2", r"ring 2: rbf, refinement", r"[1-9]\d? %  left 0:00:\d\d"):
        assert re.search(rf"learning .*{words}", shown), words
    # what was written predicts, and not the same everywhere
    assert np.ptp(load_model(tmp_path / "model").processes[2].mean(inputs(STATES))) > 0.01


def test_several_logs_are_learned_from_together(monkeypatch, capsys, log, tmp_path):
    other = tmp_path / "other.mcap"
    run_collection(PlanarRig(MAZE), MAZE, Collection(30.0, (3,), seed=5), other)
    code, out, _ = call(monkeypatch, capsys, "learn", log, other, "-o", tmp_path / "model", "--kind", "pi", "--json")
    assert code == 0
    document = json.loads(out)
    assert [source["file"] for source in document["data"]] == ["log.mcap", "other.mcap"]
    assert (len(read_table(log)), len(read_table(other))) == (1800, 900)
    assert {"2", "3"} <= {str(ring) for ring in document["windows"]}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["log.mcap", "--kind", "magic"], "--kind: got 'magic', expected one of p, pi, np, sp"),
        (["log.mcap", "--smoothing", "none"], "--smoothing: got 'none', expected rts or savgol"),
        (["log.mcap", "--device", "tpu"], "got 'tpu', expected cpu or cuda"),
        (["log.mcap", "--most", "10"], "--most"),
        (["log.mcap", "--seed=-1"], "--seed"),
        (["log.mcap", "--map", "none.yaml"], "none.yaml"),
        (["none.mcap"], "none.mcap: no such file"),
        (["none.mcap", "--kind", "p"], "none.mcap: no such file"),
        (["bare.csv", "--kind", "np"], "bare.csv: column u_beta is needed to fit a whole rig"),
        ([], "'logs'"),
    ],
)
def test_bad_input_is_one_line_and_two(monkeypatch, capsys, log, arguments, said):
    monkeypatch.chdir(log.parent)
    (log.parent / "bare.csv").write_text("t,x,y,beta,gamma\n0,.07,0,0,0\n.033,.07,0,0,0\n.067,.07,0,0,0\n")
    code, out, err = call(monkeypatch, capsys, "learn", *arguments, "-o", "model")
    assert (code, out) == (2, "")
    assert len(err.strip().splitlines()) == 1
    assert said in err
    assert not (log.parent / "model").exists()


def test_cuda_is_refused_where_there_is_none(monkeypatch, capsys, log, tmp_path):
    import torch

    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    arguments = ("learn", log, "-o", tmp_path / "model", "--device", "cuda", "--kind", "np")
    code, _, err = call(monkeypatch, capsys, *arguments)
    assert code == 2
    assert "--device: got cuda, but torch sees no such device; expected cpu" in err.splitlines()[-1]
    assert not (tmp_path / "model").exists()


@pytest.mark.parametrize("missing", ["torch", "gpytorch"])
def test_without_torch_it_says_what_to_install(monkeypatch, capsys, log, tmp_path, missing):
    monkeypatch.setitem(sys.modules, missing, None)
    for kind in ("np", "sp"):
        code, out, err = call(monkeypatch, capsys, "learn", log, "-o", tmp_path / "model", "--kind", kind)
        assert (code, out) == (2, "")
        assert f"need torch and gpytorch: {to_install('learn')}" in err
        assert len(err.strip().splitlines()) == 1
    assert not (tmp_path / "model").exists()
    with pytest.raises(Exception, match=r"\[learn\]"):
        gp_training.require_torch()
    # kinds without a process do without it (scipy looks at what is loaded, and takes a None for torch)
    monkeypatch.delitem(sys.modules, missing)
    code, _, _ = call(monkeypatch, capsys, "learn", log, "-o", tmp_path / "model", "--kind", "pi")
    assert code == 0
