"""`diagnose LOG.csv --system MODULE:CLASS`: a user's class, from its record to the report."""

from __future__ import annotations

import importlib.util
import itertools
import json
import shutil

import numpy as np
import pytest
from pages import ROOT, blocks
from standalone_page import alone

EXAMPLE = ROOT / "examples" / "one-degree"
COUNT = itertools.count()  # Python reads an imported module only once


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """A working folder with the example."""
    for name in ("pendulum.py", "pendulum.csv"):
        shutil.copy(EXAMPLE / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def words(desk):
    """The words of `diagnose` of the example; change: (old, new) text of its class; MODULE: its module."""

    def words(*arguments, change=("", "")):
        name = f"pendulum_{next(COUNT)}"
        (desk / f"{name}.py").write_text((desk / "pendulum.py").read_text().replace(*change))
        given = [str(argument).replace("MODULE", name) for argument in arguments]
        system = () if "--system" in given else ("--system", f"{name}:Pendulum")
        log = () if given and given[0].endswith(".csv") else ("pendulum.csv",)
        return ("diagnose", *log, *given, *system)

    return words


def columns():
    """t, theta, torque (N, 3) of the example."""
    return np.loadtxt(EXAMPLE / "pendulum.csv", delimiter=",", skiprows=1)


def write(path, table, names="t,theta,torque"):
    np.savetxt(path, table, fmt="%.6g", delimiter=",", header=names, comments="")
    return path.name


def test_the_example_is_its_plain_integrator_and_stands_in_the_documentation():
    text = (EXAMPLE / "record.py").read_text()
    assert "mazeplan" not in text, "the truth shares nothing with the models"
    spec = importlib.util.spec_from_file_location("pendulum_record", EXAMPLE / "record.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert np.allclose(columns(), module.record(), atol=2e-5)
    assert all(len((EXAMPLE / name).read_text().splitlines()) <= 40 for name in ("pendulum.py", "record.py"))
    (shown,) = (b.text for b in blocks("docs/diagnosis.md") if b.file == "pendulum.py")
    assert shown == (EXAMPLE / "pendulum.py").read_text()


@pytest.mark.slow
def test_the_paddle_is_found_and_the_report_stands_alone(call, words, desk):
    code, out, err = call(*words("--declare", "motion.mass=0.25", "-o", "report", "--json"))
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
    assert document["after"]["nrmse"] < 0.3 * (document["before"]["nrmse"] or 10.0)
    assert document["after"]["free_run"] < 0.01
    assert document["before"]["free_run"] is None, "it leaves the record"
    assert document["system"].endswith(":Pendulum")
    assert json.loads((desk / "report" / "report.json").read_text()) == document
    page = alone(desk / "report" / "report.html")
    assert "The model lacks quadratic drag" in page
    assert "angle of the ball" not in page


def test_your_own_effects_may_use_inputs(call, words, desk):
    (desk / "more_pendulum.py").write_text(
        "from mazeplan.physics import Effect, Parameter\n"
        "effects = Effect('weak_motor', {'share': Parameter('1/(kg m^2)', 0.0, -50.0, 50.0)},\n"
        "                 formula=lambda s, p: -p.share * s.torque)\n"
    )
    log = write(desk / "strong.csv", columns() * [1.0, 1.0, 1.25])  # the logged torque is too large
    declared = ("motion.mass=0.25", "motion.length=0.4", "quadratic_drag.coefficient=0.15")
    known = [word for text in declared for word in ("--declare", text)]
    code, out, err = call(*words(log, *known, "--effects", "more_pendulum:effects", "--json"))
    assert code == 0, err
    (effect,) = json.loads(out)["effects"]
    assert effect["name"] == "weak_motor"
    assert effect["parameters"]["share"]["value"] == pytest.approx(0.2 / (0.25 * 0.4**2), rel=0.05)
