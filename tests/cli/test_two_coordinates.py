"""`diagnose --system` of machines with two coordinates: the example, from its record to the effect."""

from __future__ import annotations

import importlib.util
import json
import shutil

import numpy as np
import pytest
from pages import ROOT

EXAMPLE = ROOT / "examples" / "two-coordinates"


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """A working folder with the example."""
    for path in EXAMPLE.iterdir():
        if path.is_file():
            shutil.copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_records_are_those_of_the_plain_integrator():
    text = (EXAMPLE / "record.py").read_text()
    assert "mazeplan" not in text.replace("`mazeplan", ""), "the truth shares nothing with the models"
    spec = importlib.util.spec_from_file_location("two_records", EXAMPLE / "record.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for name, made in (("cart.csv", module.cart()), ("ball.csv", module.ball())):
        assert np.allclose(np.loadtxt(EXAMPLE / name, delimiter=",", skiprows=1), made, atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("log", "system", "name", "on", "true"),
    [
        ("cart.csv", "machines:CartPendulum", "viscous_friction", "theta", 0.3),
        ("ball.csv", "machines:BallOnPlate", "constant_force", "y", 5.0 / 7.0 * 9.81 * 0.004),
    ],
)
def test_the_effect_is_found_on_its_coordinate(call, desk, log, system, name, on, true):
    code, out, err = call("diagnose", log, "--system", system, "--json")
    assert code == 0, err
    document = json.loads(out)
    (effect,) = document["effects"]
    assert (effect["name"], effect["on"]) == (name, on)
    (number,) = effect["parameters"].values()
    assert number["value"] == pytest.approx(true, rel=0.02)
    assert document["after"]["nrmse"] < 0.1 * document["before"]["nrmse"]
    assert document["remaining"] < 1.5
