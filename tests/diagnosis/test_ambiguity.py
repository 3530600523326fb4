"""What would tell effects apart is a command that `collect` takes."""

from __future__ import annotations

import shlex

import pytest
from commands import call

from mazeplan.diagnosis.ring.ambiguity import EXPERIMENTS, experiment_for
from mazeplan.diagnosis.ring.candidates import ring_library


@pytest.mark.parametrize("experiment", EXPERIMENTS, ids=lambda e: " ".join(sorted(e.effects)))
def test_each_experiment_is_for_effects_there_are(experiment):
    assert experiment.effects <= {c.name for c in ring_library()}
    assert experiment.preparation or experiment.options


def test_the_experiment_that_has_the_likeliest_effect_is_proposed():
    way = experiment_for(("constant_torque", "tilt_offset", "surface_profile"), 2)
    assert "a torque acts alike all around" in way["why"]
    assert (
        way["command"]
        == "mazeplan collect --rig RIG --ring ring2 --seconds 300 --tilt 5 --highest-hz 0.7 -o apart.mcap"
    )
    turned = experiment_for(("tilt_offset", "surface_profile"), 1)
    assert turned["first"] == "turn the rig by 90 degrees on its table"
    assert "900" in experiment_for(("a", "b"), None)["command"]


def test_the_proposed_command_runs(monkeypatch, capsys, tmp_path):
    words = shlex.split(experiment_for(("constant_torque", "dry_friction"), 1)["command"])
    assert words[:2] == ["mazeplan", "collect"]
    words[words.index("--seconds") + 1] = "2"
    words[words.index("apart.mcap")] = str(tmp_path / "apart.mcap")
    code, _, err = call(monkeypatch, capsys, *words[1:], "--rig", "ideal")
    assert code == 0, err
    assert (tmp_path / "apart.mcap").exists()


def test_a_tilt_beyond_the_limit_is_refused(monkeypatch, capsys, tmp_path):
    code, _, err = call(monkeypatch, capsys, "collect", "-o", tmp_path / "x.mcap", "--tilt", "9", "--seconds", "1")
    assert code == 2
    assert "--tilt: got 9, expected 0.2 to 5 degrees" in err
