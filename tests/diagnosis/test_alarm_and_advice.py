"""What to do next, and what nobody can tell apart without a tilt sensor."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from mazeplan.diagnosis.effect_entry import effect_entry
from mazeplan.diagnosis.rig import findings
from mazeplan.diagnosis.rig.words import advice
from mazeplan.physics.registry import PACKAGED


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"add": "-o FOLDER"}, "write a new model: add -o FOLDER to this command."),
        ({"written": "dg/model", "add": ""}, "plan with the new model: mazeplan navigate --rig RIG --model dg/model."),
        ({"add": ""}, ""),
    ],
)
def test_the_advice_asks_for_the_options_that_are_missing(how, words):
    effect = {"name": "servo_gain", "planned": True, "parameters": {}}
    done = SimpleNamespace(effects=[effect], alike=(), unknown=None, verdict="effect_found", remaining=1.0)
    said = [line for line in advice(done, **how) if line.startswith("Or leave")]
    assert said == ([f"Or leave the rig as it is, and {words}"] if words else [])


@pytest.mark.parametrize(("gamma", "alike"), [(1.19, [("servo_gain", "rolling_inertia")]), (1.0, [])])
def test_without_a_tilt_sensor_the_same_gain_of_both_servos_looks_like_another_ball(gamma, alike):
    both = {"beta": 1.0, "gamma": 1.0}
    error = dict.fromkeys(both, 0.02)
    seen = effect_entry(PACKAGED["tilt_gain"], {"beta": 1.18, "gamma": gamma}, error, both, rings={"1": {}})
    (servo,), found = findings.by_servos([seen], [], SimpleNamespace(stage=SimpleNamespace(values={})))
    assert servo["name"] == "servo_gain"
    assert servo["parameters"]["beta"]["value"] == pytest.approx(1.0 / 1.18)
    assert found == alike
