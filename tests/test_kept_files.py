"""Files that earlier versions wrote stay readable: tests/kept_files/VERSION, written by tools/keep_files.py."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import call

from mazeplan.apps.environment.record import load_episodes
from mazeplan.apps.report.inputs import read_input
from mazeplan.control.estimation.rigid_body_parameters import value_of
from mazeplan.core.logs.run_log import read_log
from mazeplan.core.logs.run_log_reader import read_attachment
from mazeplan.core.logs.table import read_table
from mazeplan.core.maths.fingerprint import fingerprint
from mazeplan.core.records import NavigationResult
from mazeplan.diagnosis.rig.reference_file import load_reference
from mazeplan.learning.modelfile import ATTACHED, KINDS, load_model, unpacked_model
from mazeplan.learning.online_folder import open_learner
from mazeplan.maze.graph import RouteGraph
from mazeplan.maze.mapfile import check_text, load_map
from mazeplan.maze.memory import KEPT, load_memory
from mazeplan.rigs.faults.schedule import load_schedule
from mazeplan.rigs.hardware.files import hardware_file
from mazeplan.rigs.registry import make_rig, rig_model_hint
from mazeplan.run.campaign.one_run import Campaign
from mazeplan.run.campaign.store import open_store
from mazeplan.run.settings import load_settings

FOLDERS = sorted((Path(__file__).parent / "kept_files").iterdir())
MOST = 600_000  # bytes of a folder
MAZE = load_map("cme")


@pytest.fixture(params=FOLDERS, ids=lambda path: path.name)
def kept(request):
    return request.param


def test_a_folder_of_today_is_kept_and_small():
    assert "0.1.0" in [folder.name for folder in FOLDERS]
    for folder in FOLDERS:
        assert 10_000 < sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) < MOST


def test_a_kept_map_is_the_maze_that_it_was(kept):
    maze = load_map(kept / "map.yaml")
    assert (len(maze.rings), len(maze.openings), len(maze.radial_walls)) == (4, 6, 6)
    assert math.degrees(maze.tilt_limit) == pytest.approx(5.0)
    assert 1000 * maze.ball.radius == pytest.approx(6.35)
    assert len(RouteGraph(maze).route(1, 4, math.radians(120)).openings) >= 3


@pytest.mark.parametrize("kind", KINDS)
def test_a_kept_model_knows_stage_and_ball(kept, kind):
    model = load_model(kept / "models" / kind)
    assert model.kind == kind
    assert 0.95 < model.stage.beta.gain < 1.05
    assert 0.05 < model.camera_delay < 0.07, "s; two frames"
    assert 0.5 < model.declared(1)["rolling_inertia"]["factor"] < 0.8
    if kind in ("np", "sp"):
        process = model.processes[1]
        assert len(process) == 300
        assert np.std(process.mean(process.inputs)) > 0.5, "rad/s^2 that it learned"


def test_a_kept_model_that_goes_on_learning_has_its_rows(kept, tmp_path):
    folder = shutil.copytree(kept / "online", tmp_path / "online")
    online = open_learner(folder, MAZE, "ideal")
    assert online.now == 1
    assert len(online.rings[1].y) == 300
    assert fingerprint(online.start) == fingerprint(load_model(kept / "models" / "sp"))


def test_the_kept_reference_of_a_rig_belongs_to_its_model(kept):
    was = load_reference(kept / "models/sp", load_model(kept / "models/sp"))
    assert was is not None
    assert value_of(was.body.model, "rolling") == pytest.approx(0.06)
    assert was.body.stderr["rolling"] == pytest.approx(0.002)
    assert was.errors == {1: 0.01}


def test_a_kept_log_tells_how_the_run_went(kept):
    log = read_log(kept / "run.mcap")
    assert log.complete
    assert log.header["rig"] == "ideal"
    assert check_text(log.header["map"]).maze == MAZE
    assert log.result is not None
    result = NavigationResult.from_json(log.result)
    assert result.success
    assert [passage.ring for passage in result.rings] == [4, 5]
    assert min(len(log.plans), len(log.events), len(log.trees)) > 0
    assert np.all(np.diff(log.ticks["t"]) > 0)


def test_a_kept_log_holds_the_model_of_its_run(kept):
    packed = read_attachment(kept / "run.mcap", ATTACHED)
    assert packed is not None
    assert fingerprint(unpacked_model(packed)) == fingerprint(load_model(kept / "models/sp"))


def test_a_kept_table_is_that_of_its_log(kept):
    table, log = read_table(kept / "table.csv"), read_table(kept / "run.mcap")
    assert len(table) == len(log) > 10
    for name in ("t", "x", "beta", "u_gamma"):
        np.testing.assert_allclose(table[name], log[name], atol=1e-5)


def test_a_kept_record_of_a_rig_is_a_table(kept):
    table = read_table(kept / "collected.mcap")
    assert len(table) == 60
    assert np.std(table["u_beta"]) > 0.01
    assert np.nanmin(table["r"]) > 0.08, "m: the outer ring"


def test_kept_runs_of_a_campaign_can_be_read_and_stay_beside_new_ones(kept, tmp_path):
    folder = shutil.copytree(kept / "store", tmp_path / "store")
    runs = pd.read_parquet(folder)
    results = [NavigationResult.from_json(json.loads(text)) for text in runs["result"]]
    document = json.loads((kept / "evaluation.json").read_text())
    assert [result.time_s for result in results] == [run["time_s"] for run in document["results"]]
    assert list(runs["seed"]) == [3, 4]
    with open_store(folder, Campaign(1, "ideal", start=4)) as store:
        assert store.documents == {}
        (other,) = store.others()
    assert other.startswith(runs["campaign"][0])
    assert "seed" in other, "the difference is told, so the setup was read"


def test_kept_documents_are_reports(kept):
    (evaluation,) = read_input(kept / "evaluation.json")
    assert [run.success for run in evaluation.document.results] == [True, True]
    (comparison,) = read_input(kept / "comparison.json")
    assert comparison.kind == "comparison"
    assert comparison.document[1].nrmse_test["sp"] < comparison.document[1].nrmse_test["p"]
    (diagnosis,) = read_input(kept / "diagnosis")
    assert diagnosis.kind == "diagnosis"
    assert diagnosis.document.verdict == "effect_found"
    assert [effect.name for effect in diagnosis.document.effects] == ["rolling_inertia"]
    assert diagnosis.evidence is not None
    assert load_model(kept / "diagnosis/model").declared(1)["rolling_inertia"]["factor"] < 0.7


def test_the_kept_document_of_an_improvement_names_what_the_model_lacked(kept):
    (found,) = read_input(kept / "improvement.json")
    assert found.kind == "diagnosis"
    assert [effect.name for effect in found.document.effects] == ["tilt_offset"]
    assert found.document.navigation.after.runs == 1


@pytest.mark.slow
def test_a_report_of_all_kept_files_can_be_drawn(kept, tmp_path, monkeypatch, capsys):
    for name in ("run.mcap", "evaluation.json", "comparison.json", "improvement.json", "diagnosis", "models/sp"):
        page = tmp_path / f"{name.replace('/', '-')}.html"
        code, _, err = call(monkeypatch, capsys, "report", kept / name, "-o", page)
        assert (code, page.exists()) == (0, True), err
        assert "</table>" in page.read_text()


def test_kept_settings_say_what_differs(kept):
    settings, packaged = load_settings(kept / "settings.yaml"), load_settings()
    assert settings.leaves.travel.lean_deg == 4.5
    assert settings.leaves.travel.planned_choices == 2
    assert settings.estimator.lost_after == 0.4
    assert settings.leaves.cost == packaged.leaves.cost


def test_kept_rig_files_make_rigs(kept):
    rig = make_rig(str(kept / "rig.yaml"), MAZE)
    rig.reset(ring=1, theta=0.3, rng=np.random.default_rng(0))
    seen = [rig.observe() for _ in range(4)][-1]
    rig.close()
    assert seen.x is not None
    assert math.atan2(seen.y or 0.0, seen.x) == pytest.approx(0.3, abs=0.05)
    assert rig_model_hint(str(kept / "rig.yaml")) == str((kept / "models/sp").absolute())


def test_kept_files_of_a_rig_on_a_table_keep_their_calibration(kept):
    assert hardware_file(str(kept / "hardware.yaml")).settings.servo.beta.us_per_deg == 40.0
    calibrated = hardware_file(str(kept / "emulated.yaml")).settings
    assert calibrated.tilt is not None
    assert calibrated.camera is not None
    assert calibrated.camera["focal_px"] == (1132.364, 1131.879)


def test_kept_faults_are_two_trials(kept):
    lost, tired = load_schedule(kept / "faults.yaml")
    assert (lost.name, tired.name) == ("frames_lost", "tired servo")
    assert tired.draw(1)[0].size == 10.0


def test_a_kept_tree_is_still_one(kept, monkeypatch, capsys):
    code, out, err = call(monkeypatch, capsys, "behavior", "check", kept / "tree.xml")
    assert code == 0, err
    code, out, _ = call(monkeypatch, capsys, "behavior", "show", kept / "tree.xml")
    assert code == 0
    assert "BallSeen" in out


def test_kept_experience_counts_less_in_the_next_run(kept):
    memory = load_memory(kept / "memory.yaml", [opening.name for opening in MAZE.openings])
    assert memory.tries("4-5@180", 0.0) == (pytest.approx(KEPT * 0.9967), 0.0)


def test_kept_episodes_are_those_of_the_planner(kept):
    header, (episode,) = load_episodes(kept / "episodes.parquet")
    assert header["environment"].startswith("mazeplan/")
    assert episode.success
    assert len(episode.actions) == len(episode.observations) - 1 == 33
