"""`diagnose` of a ball in one ring."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from commands import plain
from plant import play
from ring_record import write_csv
from standalone_page import alone

from mazeplan.apps.report.words import measured
from mazeplan.core.logs.table import Table
from mazeplan.learning.modelfile import RigModel, load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.rig.sensors import Camera
from mazeplan.run.commands import diagnose_ring
from mazeplan.run.commands.diagnosis_request import DiagnosisRequest

KNOWN = ("--radius", "0.0925", "--declare", "rolling_inertia.factor=0.7142857", "--declare",
         "viscous_friction.coefficient=0.35")  # fmt: skip


MAZE = load_map("cme")
NOMINAL = RigModel.nominal(MAZE)


@pytest.fixture
def asked_of_ring(monkeypatch):
    """What the diagnosis of one ring is asked for a log and a model."""

    def ask(
        log: Path, model: RigModel | None, declare: tuple[str, ...] = (), test: Path | None = None,
        radius: float | None = 0.0925,
    ) -> dict[str, Any]:  # fmt: skip
        asked = dict[str, Any]()

        def diagnosis(*given: Any, **more: Any) -> Any:
            asked.update(more, record=given[0], declared=given[2])
            return SimpleNamespace(document=lambda: {"notes": []})

        monkeypatch.setattr(diagnose_ring.ring_diagnosis, "diagnose", diagnosis)
        request = DiagnosisRequest([log], None, radius, list(declare), None, test, None, None, None, [])
        diagnose_ring._diagnose(log, MAZE, model, request)
        return asked

    return ask


@pytest.fixture
def diagnose(call):
    return partial(call, "diagnose")


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("logs") / "dry.csv"
    write_csv(Table(play(seed=3, seconds=90.0, dry=0.4)), path)
    return path


def test_the_known_offset_of_the_camera_is_told_to_the_search(asked_of_ring, log, tmp_path):
    model = replace(NOMINAL, camera=Camera(offset_x=0.002))
    asked = asked_of_ring(log, model)
    assert asked["corrected"] == model.camera
    assert "camera_offset" not in asked["declared"]
    columns = play(seed=3, seconds=20.0)
    write_csv(Table({name: column for name, column in columns.items() if name != "r"}), tmp_path / "angles.csv")
    asked = asked_of_ring(tmp_path / "angles.csv", model)
    assert asked["declared"]["camera_offset"] == {"x": 0.002, "y": 0.0}, "angles alone are not corrected"


def test_a_declared_offset_of_the_camera_corrects_positions_or_angles_but_not_both(asked_of_ring, tmp_path):
    columns = play(seed=3, seconds=20.0, radius=0.0892, camera_offset=(0.002, 0.001))
    write_csv(Table(columns), tmp_path / "positions.csv")
    write_csv(Table({name: c for name, c in columns.items() if name != "r"}), tmp_path / "angles.csv")
    model, declare = replace(NOMINAL, camera=Camera(offset_y=0.001)), ("camera_offset.x=0.002",)
    asked = asked_of_ring(tmp_path / "positions.csv", model, declare)
    assert (asked["corrected"].offset_x, asked["corrected"].offset_y) == (0.002, 0.001)
    assert "camera_offset" not in asked["declared"]
    asked = asked_of_ring(tmp_path / "positions.csv", None, declare)
    assert (asked["corrected"].offset_x, asked["corrected"].offset_y) == (0.002, 0.0)
    asked = asked_of_ring(tmp_path / "angles.csv", model, declare)
    assert asked["declared"]["camera_offset"] == {"x": 0.002, "y": 0.001}
    assert asked["corrected"] == model.camera


def test_a_declared_number_of_the_stage_takes_the_place_of_the_models(asked_of_ring, log):
    axis = replace(NOMINAL.stage.beta, stderr={"gain": 0.01})
    model = replace(NOMINAL, stage=replace(NOMINAL.stage, beta=axis))
    plain = asked_of_ring(log, model)["known"]
    declared = asked_of_ring(log, model, ("servo_gain.beta=1.2", "backlash.gamma=0.01", "dry_friction.coefficient=0.4"))
    known = declared["known"]
    assert known.values["servo_gain"] == {**plain.values["servo_gain"], "beta": 1.2}
    assert known.values["backlash"] == {"beta": 0.0, "gamma": 0.01}
    assert known.values["servo_lag"] == plain.values["servo_lag"]
    assert set(known.values) == {*plain.values, "backlash"}
    assert plain.stderr["servo_gain"]["beta"] == 0.01
    assert set(known.stderr["servo_gain"]) == {"gamma"}


def test_a_test_record_is_seen_by_the_same_cameras_as_the_record(asked_of_ring, tmp_path, monkeypatch):
    log = tmp_path / "log.csv"
    write_csv(Table(play(seed=3, seconds=20.0, radius=0.0892, camera_offset=(0.002, 0.0))), log)
    model, true = replace(NOMINAL, camera=Camera(offset_x=0.001)), Camera(offset_x=0.002)
    asked = asked_of_ring(log, model, test=log)
    assert asked["test"].theta == pytest.approx(asked["record"].theta)
    assert asked["test_as_model"] is None
    monkeypatch.setattr(diagnose_ring, "camera_effects", lambda *given: ([{"name": "camera_offset"}], true))
    asked = asked_of_ring(log, model, test=log, radius=None)
    for test, record in (("test", "record"), ("test_as_model", "as_model")):
        assert asked[test].theta == pytest.approx(asked[record].theta)
    assert not np.allclose(asked["record"].theta, asked["as_model"].theta)


@pytest.mark.slow
def test_the_document_is_that_of_the_contract_and_the_report_stands_alone(diagnose, log, tmp_path):
    further = tmp_path / "further.csv"
    further.write_text(log.read_text().rpartition("\n")[0])
    code, out, err = diagnose(log, *KNOWN, "--test", further, "-o", tmp_path / "report", "--json", terminal=True)
    assert code == 0, err
    assert re.search(r"diagnosing .*trying dry_friction, \d+ of \d+", plain(err))
    document = json.loads(out)
    assert document["verdict"] == "effect_found"
    (effect,) = document["effects"]
    assert effect["name"] == "dry_friction"
    found = effect["parameters"]["coefficient"]
    assert found["value"] == pytest.approx(0.4, abs=0.02)
    assert found["unit"] == "rad/s^2"
    assert 0.0 < found["stderr"] < 0.02
    for part in (document["before"], document["after"], document["test"]["before"], document["test"]["after"]):
        assert set(part) == {"nrmse", "rollout20", "rollout40"}
    assert document["after"]["rollout40"] < 0.2 * document["before"]["rollout40"]
    assert document["noise_floor"] < document["after"]["rollout40"] * 1.5
    assert document["held_out"] == pytest.approx(0.3)
    assert document["unknown"] is None
    assert json.loads((tmp_path / "report" / "report.json").read_text()) == document
    model = load_model(document["model"])
    assert model.ball(1).parameter("dry_friction", "coefficient", 0.0) == pytest.approx(found["value"], rel=1e-4)
    assert model.ball(1).parameter("viscous_friction", "coefficient", 0.0) == 0.35
    page = alone(tmp_path / "report" / "report.html")
    for words in ("The model lacks dry friction", measured(found["value"], found["stderr"], "rad/s^2")):
        assert words in page
    assert "dry_friction<wbr>.coefficient" in page  # where a name may be broken


@pytest.mark.slow
def test_the_sentence_and_the_ring_of_the_map(diagnose, log, tmp_path):
    code, out, err = diagnose(log, *KNOWN)
    assert (code, err) == (0, "")
    assert out.startswith("The model lacks dry friction (coefficient 0.")
    assert "40-step error" in out.splitlines()[0]
    write_csv(Table(play(seed=3, seconds=60.0, radius=0.0689, dry=0.4)), tmp_path / "ring2.csv")
    code, out, err = diagnose(tmp_path / "ring2.csv", "--json", *KNOWN[2:])
    assert code == 0, err
    assert json.loads(out)["ring"] == 2
    assert "dry_friction" in [e["name"] for e in json.loads(out)["effects"]]
