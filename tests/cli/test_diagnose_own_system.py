"""`diagnose LOG.csv --system MODULE:CLASS`: a user's class, from its record to the report."""

from __future__ import annotations

import importlib.util
import itertools
import json
import re
import shutil

import numpy as np
import pytest
from commands import call as command
from pages import ROOT, blocks

EXAMPLE = ROOT / "examples" / "one-degree"
COUNT = itertools.count()  # a module that was imported once is not read again


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """A folder with the example, where one works; modules that are imported from it are forgotten."""
    for name in ("pendulum.py", "pendulum.csv"):
        shutil.copy(EXAMPLE / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def call(monkeypatch, capsys, desk):
    def run(*arguments, text=None, change=None):
        """change: in the text of the class."""
        text = (desk / "pendulum.py").read_text() if text is None else text
        name = f"pendulum_{next(COUNT)}"
        (desk / f"{name}.py").write_text(text.replace(*change) if change else text)
        words = [str(a).replace("MODULE", name) for a in arguments]
        system = () if "--system" in words else ("--system", f"{name}:Pendulum")
        log = () if words and words[0].endswith(".csv") else ("pendulum.csv",)
        return command(monkeypatch, capsys, "diagnose", *log, *words, *system)

    return run


def columns():
    """t, theta, torque (N, 3) of the example."""
    return np.loadtxt(EXAMPLE / "pendulum.csv", delimiter=",", skiprows=1)


def write(path, table, names="t,theta,torque"):
    np.savetxt(path, table, fmt="%.6g", delimiter=",", header=names, comments="")
    return path.name


def test_the_record_is_that_of_the_plain_integrator():
    text = (EXAMPLE / "record.py").read_text()
    assert "mazeplan" not in text, "the truth shares nothing with the models"
    spec = importlib.util.spec_from_file_location("pendulum_record", EXAMPLE / "record.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert np.allclose(columns(), module.record(), atol=2e-5)
    assert all(len((EXAMPLE / name).read_text().splitlines()) <= 40 for name in ("pendulum.py", "record.py"))


def test_the_class_in_the_documentation_is_that_of_the_example():
    (shown,) = (b.text for b in blocks("docs/diagnosis.md") if b.file == "pendulum.py")
    assert shown == (EXAMPLE / "pendulum.py").read_text()


def test_the_paddle_is_found_and_the_report_stands_alone(call, desk):
    code, out, err = call("--declare", "motion.mass=0.25", "-o", "report", "--json")
    assert code == 0, err
    document = json.loads(out)
    assert document["verdict"] == "effect_found"
    (effect,) = document["effects"]
    assert effect["name"] == "quadratic_drag"
    found = effect["parameters"]["coefficient"]
    assert found["value"] == pytest.approx(0.15, rel=0.1)
    assert found["unit"] == "1/rad"
    assert effect["before"] > effect["after"]
    (fitted,) = document["fitted"]
    assert fitted["parameters"].keys() == {"length"}
    assert fitted["parameters"]["length"]["value"] == pytest.approx(0.4, rel=0.01)
    assert document["declared"] == {"motion": {"mass": 0.25}}
    assert document["after"]["nrmse"] < 0.3 * document["before"]["nrmse"]
    assert document["after"]["free_run"] < 0.01 < 1.0 < document["before"]["free_run"]
    assert document["system"].endswith(":Pendulum")
    assert json.loads((desk / "report" / "report.json").read_text()) == document
    page = (desk / "report" / "report.html").read_text()
    assert "The model lacks quadratic drag. Relative acceleration error ||e|| / ||a||: " in page
    plain = re.sub(r"base64,[^\"]*", "", page).replace("http-equiv", "")
    assert "http" not in plain, "nothing is loaded from elsewhere"
    assert "angle of the ball" not in plain


def test_in_words_with_what_is_there_fitted_along(call):
    code, out, err = call("--declare", "quadratic_drag", "--declare", "motion.mass=0.25", "--test", "pendulum.csv")
    assert (code, err) == (0, "")
    assert out.startswith("Nothing is missing: acceleration error ")
    assert " rad off." in out.splitlines()[0]


def test_effects_of_ones_own_may_use_inputs(call, desk):
    (desk / "more_pendulum.py").write_text(
        "from mazeplan.physics import Effect, Parameter\n"
        "effects = Effect('weak_motor', {'share': Parameter('1/(kg m^2)', 0.0, -50.0, 50.0)},\n"
        "                 formula=lambda s, p: -p.share * s.torque)\n"
    )
    table = columns()
    table[:, 2] *= 1.25  # what is told of the torque is too large
    log = write(desk / "strong.csv", table)
    declared = ("motion.mass=0.25", "motion.length=0.4", "quadratic_drag.coefficient=0.15")
    told = [word for one in declared for word in ("--declare", one)]
    code, out, err = call(log, *told, "--effects", "more_pendulum:effects", "--json")
    assert code == 0, err
    document = json.loads(out)
    (effect,) = document["effects"]
    assert effect["name"] == "weak_motor"
    assert effect["parameters"]["share"]["value"] == pytest.approx(0.2 / (0.25 * 0.4**2), rel=0.05)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--system", "nowhere:Pendulum"), "--system: module 'nowhere' cannot be imported: there is none of that name"),
        (("--system", "MODULE:Cart"), "has no 'Cart', expected the name of a class in it"),
        (("--system", "MODULE:"), "has no '', expected the name of a class in it"),
        (("--system", ":Pendulum"), "--system: got '', expected the name of a Python module"),
        (("--ring", "2"), "--ring: got 2, expected none with --system"),
        (("--declare", "motion.length"), "--declare: got 'motion.length', expected EFFECT.PARAM=VALUE"),
        (("--declare", "motion.weight=1"), "got parameter 'weight' of motion, expected one of mass, length"),
        (("--declare", "motion.length=9"), "got motion.length 9, expected 0.1 to 2"),
        (("--declare", "wind"), "got effect 'wind', expected one of motion, viscous_friction"),
        (("--effects", "MODULE"), "--effects: got 'pendulum_"),
        (("--effects", "MODULE:nothing"), "gives no effects: AttributeError"),
        (("--effects", "MODULE:Pendulum"), "gives no effects: "),
        (("--test", "nowhere.csv"), "nowhere.csv: no such file"),
        (("nowhere.csv",), "nowhere.csv: no such file, expected a table (CSV) with t, theta, torque"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(call, arguments, message):
    code, out, err = call(*arguments)
    assert code == 2
    assert not out
    assert message in err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("def motion(", "def movement("), "Pendulum: got no motion, expected position, unit and motion(s, p)"),
        (("unit =", "units ="), "got no unit, expected position, unit and motion(s, p)"),
        (('("torque",)', '("force",)'), "the formula of motion cannot be used: got torque in a formula"),
        (('"dry_friction"', '"wet_friction"'), "effects: got 'wet_friction', expected an Effect or one of"),
        (('Parameter("kg", 0.2, 0.01, 5.0)', 'Parameter("kg")'), "cannot be imported: "),
        (('Parameter("kg", 0.2, 0.01, 5.0)', "0.25"), "motion.mass: got 0.25, expected Parameter(unit, value"),
        (("sin(s.theta)", "sin(s.theta"), "cannot be imported: "),
        (("p.mass * p.length", "p.mass * p.long"), "the formula of motion cannot be used: "),
        (('"torque"', '"tork"'), "the formula of motion cannot be used: got torque"),
    ],
)
def test_a_class_that_says_too_little_is_one_line_and_exit_2(call, change, message):
    code, out, err = call(change=change)
    assert code == 2
    assert not out
    assert message in err
    assert len(err.splitlines()) == 1


def _cell(row, column, value):
    def change(table):
        table[row, column] = value
        return table

    return change


@pytest.mark.parametrize(
    ("change", "names", "message"),
    [
        (lambda c: c[:, :2], "t,theta", "column torque is missing; there are t, theta"),
        (lambda c: c[:, 1:], "theta,torque", "column t is missing"),
        (lambda c: c[:50], "t,theta,torque", "t: got 50 samples, expected at least 100"),
        (lambda c: np.delete(c, 70, axis=0), "t,theta,torque", "expected samples at one rate"),
        (_cell(9, 2, np.nan), "t,theta,torque", "bad.csv:11: torque: got 'nan', expected a finite number"),
        (_cell(9, 1, np.inf), "t,theta,torque", "bad.csv:11: theta: got 'inf', expected a finite number"),
        (lambda c: c * [1.0, 0.0, 1.0], "t,theta,torque", "theta: got 3000 samples of one position"),
        (lambda c: c * [1.0, np.nan, 1.0], "t,theta,torque", "theta: got no position"),
    ],
)
def test_a_bad_table_is_one_line_and_exit_2(call, desk, change, names, message):
    code, out, err = call(write(desk / "bad.csv", change(columns()), names))
    assert code == 2
    assert not out
    assert message in err
    assert len(err.splitlines()) == 1
