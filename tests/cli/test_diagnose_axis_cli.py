"""`diagnose --system emps`."""

from __future__ import annotations

import json
from functools import partial

import axisplant
import pytest
from scipy.io import savemat
from standalone_page import alone

EMPS = ("--system", "emps")
FRICTION = ("--declare", "viscous_friction", "--declare", "dry_friction")


@pytest.fixture
def diagnose(call):
    return partial(call, "diagnose", *EMPS)


@pytest.fixture(scope="module")
def columns():
    return axisplant.play(seed=1, seconds=12.0, lopsided=-35.0)


@pytest.fixture(scope="module")
def log(tmp_path_factory, columns):
    path = tmp_path_factory.mktemp("logs") / "axis.mat"
    savemat(path, columns)
    return path


@pytest.mark.slow
def test_the_document_is_that_of_the_contract_and_the_report_stands_alone(diagnose, log, columns, tmp_path):
    other = tmp_path / "other.mat"  # without a gain of its own
    savemat(other, {key: value for key, value in columns.items() if key != "gtau"})
    code, out, err = diagnose(log, *FRICTION, "--test", other, "-o", tmp_path / "report", "--json")
    assert code == 0, err
    document = json.loads(out)
    assert document["verdict"] == "effect_found"
    (effect,) = document["effects"]
    assert effect["name"] == "viscous_asymmetry"
    found = effect["parameters"]["coefficient"]
    assert found["unit"] == "N s/m"
    assert found["value"] == pytest.approx(-35.0, abs=4.0 * found["stderr"])
    assert effect["before"] > effect["after"]
    for part in (document["before"], document["after"], document["test"]["before"], document["test"]["after"]):
        assert set(part) == {"nrmse", "free_run"}
    assert document["after"]["nrmse"] < document["before"]["nrmse"]
    assert [entry["name"] for entry in document["fitted"]] == ["moving_mass", *FRICTION[1::2]]
    assert document["held_out"] == pytest.approx(0.5)
    assert (document["unknown"], document["system"]) == (None, "emps")
    assert json.loads((tmp_path / "report" / "report.json").read_text()) == document
    page = alone(tmp_path / "report" / "report.html")
    assert "The model lacks viscous asymmetry" in page
    assert "theta" not in page
