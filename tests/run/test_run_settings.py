"""The one file of costs, gains and windows."""

from __future__ import annotations

from dataclasses import fields

import pytest

from mazeplan.core.errors import SettingsError
from mazeplan.maze.yamltree import read_yaml
from mazeplan.run.settings import PACKAGED, load_settings


def written(tmp_path, text):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    return path


def test_the_packaged_file_names_every_key_there_is():
    """Or a user would have to read code to find one."""
    data, settings = read_yaml(PACKAGED).data, load_settings()
    for field in fields(settings.leaves):
        options = getattr(settings.leaves, field.name)
        known = {f.name for f in fields(options) if f.type in ("int", "float")}
        assert set(data[field.name]) == known
        for name, value in data[field.name].items():
            assert getattr(options, name) == value
    assert settings.estimator.camera_sigma == data["estimator"]["camera_sigma"]


def test_a_file_says_only_what_it_wants_otherwise(tmp_path):
    packaged = load_settings()
    mine = load_settings(written(tmp_path, "gate: {kp: 77}\nestimator:\n  acceleration_sigma: 0.9\n"))
    assert (mine.leaves.gate.kp, mine.estimator.acceleration_sigma) == (77, 0.9)
    assert mine.leaves.gate.kd == packaged.leaves.gate.kd
    assert mine.leaves.cost == packaged.leaves.cost
    assert load_settings() == packaged  # and the packaged ones stay


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gates: {kp: 1}", r"mine.yaml:1: gates: unknown section, expected one of cost, travel, gate"),
        ("gate:\n  kp: strong", r"mine.yaml:2: gate.kp: got 'strong'"),
        ("rollout: {grid: 1000}", r"rollout.grid: got 1000"),
        ("travel: {horizon: 40.5}", r"travel.horizon: got 40.5"),
        ("gate: 3", r"mine.yaml:1: gate: got 3"),
    ],
)
def test_what_is_wrong_is_said_with_file_line_and_key(tmp_path, text, message):
    with pytest.raises(SettingsError, match=message):
        load_settings(written(tmp_path, text))
