"""What is wrong in a rig's file is named with its file and line, whoever finds it."""

from __future__ import annotations

import pytest

from mazeplan.maze.mapfile import dump_map, load_map


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("model: nothere", "own.yaml:2: model: nothere: no such model; expected a folder with model.yaml"),
        ("sticky_ring: 7", "own.yaml:2: sticky_ring: got 7, expected 1 to 5"),
        ("faults: [{kind: blocked, opening: 1-2@46, at_s: 1}]", "own.yaml:2: faults[0].opening: got '1-2@46'"),
        ("faults: [{kind: teleport, ring: 9, at_s: 1}]", "own.yaml:2: faults[0].ring: got 9, expected 1 to 5"),
        ("camera_nois_mm: 3", "own.yaml:2: camera_nois_mm: unknown key"),
        ("kerb_ring: 6", "own.yaml:2: kerb_ring: got 6, expected 1 to 5"),
    ],
)
def test_a_mistake_in_a_rig_file_has_its_line(refused, tmp_path, line, message):
    (tmp_path / "own.yaml").write_text(f"camera_noise_mm: 0.1\n{line}\n")
    assert message in refused("navigate", "--rig", tmp_path / "own.yaml", "--time-limit", "0.1")
    assert message in refused("evaluate", "--rig", tmp_path / "own.yaml", "--time-limit", "0.1", "--runs", "1")


def test_a_map_is_named_as_one(refused, tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text(dump_map(load_map("cme")))
    for words in (("rig", "check"), ("navigate", "--rig")):
        assert f"{path}:1: got a map, expected the file of a rig" in refused(*words, path)
    said = f"{path}:1: got a map, expected a file of `navigate --memory`"
    assert said in refused("navigate", "--rig", "ideal", "--memory", path)
    assert f"{path}:1: got a map, expected a model (model.yaml)" in refused("navigate", "--model", path)
