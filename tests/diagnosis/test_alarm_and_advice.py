"""A ball that is predicted worse than before: an alarm only where the record shows it clearly; and what to do next."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mazeplan.diagnosis.document import effect_entry
from mazeplan.diagnosis.rig import findings, verdict
from mazeplan.diagnosis.rig.scores import _ring_error
from mazeplan.diagnosis.rig.words import advice
from mazeplan.physics.registry import PACKAGED


@pytest.mark.parametrize(
    ("now", "alarmed"),
    [
        ({1: (0.10, 0.01), 2: (0.20, 0.02)}, True),  # twice as bad, for sure
        ({1: (0.10, 0.03), 2: (0.20, 0.06)}, False),  # a short record
        ({1: (0.08, 0.001)}, False),  # 1.6 times as bad is no more than other motions cause
        ({3: (0.50, 0.001)}, False),  # nobody knows how it was there
        ({}, False),
    ],
)
def test_an_alarm_needs_a_clear_record(now, alarmed):
    was = SimpleNamespace(errors={1: 0.05, 2: 0.10})
    found = verdict._worse_than_before(SimpleNamespace(by_ring=now), was)
    assert (found is not None) == alarmed
    if alarmed:
        assert "2.0 times as badly" in found.description


def test_the_error_of_a_mean_is_by_blocks():
    rng = np.random.default_rng(0)
    block = np.repeat(np.arange(400), 10)
    alike = rng.standard_normal(400)[block] + 5.0  # all of a block are the same
    assert _ring_error(alike, block)[1] == pytest.approx(1.0 / np.sqrt(400), rel=0.15)
    apart = rng.standard_normal(4000) + 5.0
    assert _ring_error(apart, block)[1] == pytest.approx(1.0 / np.sqrt(4000), rel=0.15)
    assert _ring_error(apart[:10], block[:10])[1] == np.inf


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
