"""`diagnose --system emps`."""

from __future__ import annotations

import json
from functools import partial

import axisplant
import numpy as np
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
    assert "The model lacks viscous asymmetry. Relative force error ||e|| / ||y||: " in page
    assert "theta" not in page


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--ring", "2"), "--ring: got 2, expected none with --system emps"),
        (("--map", "cme"), "--map: got cme, expected none"),
        (("--declare", "tilt_offset.beta=0.1"), "got effect 'tilt_offset', expected one of moving_mass"),
        (("--declare", "viscous_friction.coefficient=inf"), "got viscous_friction.coefficient inf, expected"),
        (("--test", "nowhere.mat"), "nowhere.mat: no such file"),
    ],
)
def test_bad_options(refused, log, arguments, message):
    assert message in refused("diagnose", *EMPS, log, *arguments)


def changed(**new):
    return lambda columns: {**columns, **new}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: {"t": c["t"], "qm": c["qm"], "vir": c["vir"]}, "gtau: got only qm, t, vir, expected t, qm, vir and"),
        (lambda c: {**c, "vir": c["vir"][:-5]}, "vir: got 11995 samples, expected 12000 as in t"),
        (lambda c: {**c, "t": c["t"] ** 2}, "expected samples at one rate"),
        (lambda c: {key: value[:500] if np.ndim(value) else value for key, value in c.items()}, "got 500 samples, exp"),
        (changed(gtau=0.0), "gtau: got 0, expected one number other than 0"),
        (changed(vir="volts"), "vir: got <U5 of shape"),
        (lambda c: {**c, "qm": 0.0 * c["t"]}, "qm: got 0 m throughout, expected an axis that moves"),
    ],
)
def test_bad_variables_of_a_file(refused, columns, tmp_path, change, message):
    path = tmp_path / "bad.mat"
    savemat(path, change(columns))
    error = refused("diagnose", *EMPS, path)
    assert str(path) in error
    assert message in error


@pytest.mark.parametrize("content", [b"", b"hello, this is no MATLAB file at all", b"\x00" * 400, None])
def test_files_of_another_kind_and_cut_files(refused, log, tmp_path, content):
    path = tmp_path / "bad.mat"
    path.write_bytes(log.read_bytes()[:3000] if content is None else content)
    error = refused("diagnose", *EMPS, path)
    assert content is None or "expected a .mat file (MATLAB 4 to 7.2)" in error or "got only other variables" in error
