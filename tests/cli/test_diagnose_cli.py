"""`diagnose` of a ball in one ring."""

from __future__ import annotations

import json
import re
from functools import partial

import pytest
from commands import plain
from plant import play
from ring_record import write_csv
from standalone_page import alone

from mazeplan.apps.report.words import measured
from mazeplan.core.logs.table import Table
from mazeplan.learning.modelfile import load_model
from mazeplan.run.commands import diagnose_mechanism

KNOWN = ("--radius", "0.0925", "--declare", "rolling_inertia.factor=0.7142857", "--declare",
         "viscous_friction.coefficient=0.35")  # fmt: skip


@pytest.fixture
def diagnose(call):
    return partial(call, "diagnose")


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("logs") / "dry.csv"
    write_csv(Table(play(seed=3, seconds=90.0, dry=0.4)), path)
    return path


@pytest.mark.slow
def test_the_document_is_that_of_the_contract_and_the_report_stands_alone(diagnose, log, tmp_path):
    further = tmp_path / "further.csv"
    further.write_text(log.read_text().rpartition("\n")[0])
    code, out, err = diagnose(log, *KNOWN, "--test", further, "-o", tmp_path / "report", "--json", terminal=True)
    assert code == 0, err
    assert re.search(r"diagnosing .*trying dry_friction", plain(err))
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


@pytest.mark.slow
def test_no_model_is_written_that_predicts_worse(diagnose, log, tmp_path, monkeypatch):
    real = diagnose_mechanism._diagnose_ring

    def worse(*given):
        done, document = real(*given)
        return done, document | {"before": document["after"], "after": document["before"]}

    monkeypatch.setattr(diagnose_mechanism, "_diagnose_ring", worse)
    code, out, err = diagnose(log, *KNOWN, "-o", tmp_path / "report", "--json")
    assert code == 0, err
    document = json.loads(out)
    assert document["model"] is None
    assert not (tmp_path / "report" / "model").exists()
    assert "no model was written: with what was found, held-out parts are predicted worse" in document["notes"]
