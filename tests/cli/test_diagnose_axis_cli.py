"""`diagnose --system emps` from the command line."""

from __future__ import annotations

import json
import re

import axisplant
import numpy as np
import pytest
from commands import call as command
from scipy.io import savemat

FRICTION = ("--declare", "viscous_friction", "--declare", "dry_friction")


@pytest.fixture
def call(monkeypatch, capsys):
    def run(*arguments):
        return command(monkeypatch, capsys, "diagnose", *arguments, "--system", "emps")

    return run


@pytest.fixture(scope="module")
def columns():
    return axisplant.play(seed=1, seconds=12.0, lopsided=-35.0)


@pytest.fixture(scope="module")
def log(tmp_path_factory, columns):
    path = tmp_path_factory.mktemp("logs") / "axis.mat"
    savemat(path, columns)
    return path


def test_the_document_is_that_of_the_contract_and_the_report_stands_alone(call, log, columns, tmp_path):
    other = tmp_path / "other.mat"  # without a gain of its own
    savemat(other, {key: value for key, value in columns.items() if key != "gtau"})
    code, out, err = call(log, *FRICTION, "--test", other, "-o", tmp_path / "report", "--json")
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
    assert document["held_out"] == pytest.approx(0.3)
    assert document["unknown"] is None
    assert document["noise_floor"] is None
    assert document["system"] == "emps"
    assert json.loads((tmp_path / "report" / "report.json").read_text()) == document
    page = (tmp_path / "report" / "report.html").read_text()
    assert "The model lacks viscous asymmetry. Relative force error ||e|| / ||y||: " in page
    assert "relative force error" in page
    assert "theta" not in re.sub(r"base64,[^\"]*", "", page)
    plain = re.sub(r"base64,[^\"]*", "", page).replace("http-equiv", "")
    assert "http" not in plain, "nothing is loaded from elsewhere"


def test_in_words(call, log):
    code, out, err = call(log, *FRICTION)
    assert (code, err) == (0, "")
    assert out.startswith("The model lacks viscous asymmetry (coefficient -3")
    assert "force error" in out.splitlines()[0]
    assert "mm off" in out.splitlines()[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--ring", "2"), "--ring: got 2, expected none with --system emps"),
        (("--radius", "0.1"), "--radius: got 0.1, expected none"),
        (("--map", "cme"), "--map: got cme, expected none"),
        (("--model", "toy"), "--model: got toy, expected none"),
        (("--declare", "tilt_offset.beta=0.1"), "got effect 'tilt_offset', expected one of moving_mass"),
        (("--declare", "wind"), "got effect 'wind', expected one of moving_mass"),
        (("--declare", "viscous_friction.coefficient=-1"), "got viscous_friction.coefficient -1, expected 0 to inf"),
        (("--declare", "viscous_friction.coefficient=inf"), "got viscous_friction.coefficient inf, expected"),
        (("--declare", "dry_friction", "--declare", "dry_friction.coefficient=1"), "both with and without a value"),
        (("--test", "nowhere.mat"), "nowhere.mat: no such file"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(call, log, arguments, message):
    code, out, err = call(log, *arguments)
    assert code == 2
    assert not out
    assert message in err
    assert len(err.splitlines()) == 1


def test_another_system_is_refused(monkeypatch, capsys, log):
    code, _, err = command(monkeypatch, capsys, "diagnose", log, "--system", "pendulum")
    assert code == 2
    assert "--system: got 'pendulum', expected ring, emps or MODULE:CLASS" in err


def _with(**changed):
    def change(columns):
        return {**columns, **changed}

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: {"t": c["t"], "qm": c["qm"], "vir": c["vir"]}, "gtau: got only qm, t, vir, expected t, qm, vir and"),
        (lambda c: {"speed": c["t"]}, "t: got only other variables, expected"),
        (lambda c: {**c, "vir": c["vir"][:-5]}, "vir: got 11995 samples, expected 12000 as in t"),
        (
            lambda c: {**c, "qm": np.where(c["t"] == c["t"][7], np.nan, c["qm"])},
            "qm: got nan at sample 8, expected fin",
        ),
        (lambda c: {**c, "t": c["t"] ** 2}, "expected samples at one rate"),
        (lambda c: {**c, "t": c["t"][::-1]}, "expected samples at one rate"),
        (lambda c: {key: value[:500] if np.ndim(value) else value for key, value in c.items()}, "got 500 samples, exp"),
        (_with(gtau=0.0), "gtau: got 0, expected one number other than 0"),
        (_with(gtau=[1.0, 2.0]), "gtau: got 2 values, expected one number"),
        (_with(vir="volts"), "vir: got <U5 of shape"),
        (_with(qm=np.ones((12000, 2))), "qm: got float64 of shape (12000, 2), expected a column of real numbers"),
        (lambda c: {**c, "qm": 0.0 * c["t"]}, "qm: got 0 m throughout, expected an axis that moves"),
    ],
)
def test_a_bad_file_is_one_line_and_exit_2(call, columns, tmp_path, change, message):
    path = tmp_path / "bad.mat"
    savemat(path, change(columns))
    code, out, err = call(path)
    assert code == 2
    assert not out
    assert str(path) in err
    assert message in err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize("content", [b"", b"hello, this is no MATLAB file at all", b"\x00" * 400])
def test_what_is_no_matlab_file(call, tmp_path, content):
    path = tmp_path / "bad.mat"
    path.write_bytes(content)
    code, _, err = call(path)
    assert code == 2
    assert "expected a .mat file (MATLAB 4 to 7.2)" in err or "got only other variables" in err
    assert len(err.splitlines()) == 1


def test_a_file_that_was_cut_off(call, log, tmp_path):
    path = tmp_path / "cut.mat"
    path.write_bytes(log.read_bytes()[:3000])
    code, _, err = call(path)
    assert code == 2
    assert len(err.splitlines()) == 1
