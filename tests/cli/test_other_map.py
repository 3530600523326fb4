"""A log of another map, and a table with rings that the map does not have."""

from __future__ import annotations

import numpy as np
import pytest

from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig
from mazeplan.run.collect import Collection, run_collection


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A short log on the map cme, and a table with a ring 9."""
    place = tmp_path_factory.mktemp("other")
    maze = load_map("cme")
    plan = Collection(3.0, (1,), 0, None, 1.5, "ideal", None)
    run_collection(make_rig("ideal", maze), maze, plan, place / "a.mcap", rig_name="ideal")
    rows = []
    for t in np.arange(300) / 30.0:
        u, v = 0.03 * np.sin(3.0 * t), 0.03 * np.cos(2.0 * t)
        rows.append(f"{t:.4f},{u:.6f},{v:.6f},{u:.6f},{v:.6f},0.0892,{0.5 * np.sin(t):.6f},9")
    (place / "nine.csv").write_text("\n".join(["t,beta,gamma,u_beta,u_gamma,r,theta,ring", *rows]) + "\n")
    return place


@pytest.mark.parametrize("words", [("learn", "--kind", "pi", "-o", "m"), ("score",), ("compare",)])
def test_a_ring_that_the_map_does_not_have(refused, folder, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    command, *more = words
    first = ["ideal"] if command == "score" else []
    err = refused(command, *first, folder / "nine.csv", *more)
    assert "nine.csv: ring: got 9, expected 1 to 5: the rings of the map cme" in err


def test_a_log_of_another_map_is_told(call, folder):
    for words in (["score", "ideal"], ["compare"], ["diagnose"]):
        _, _, err = call(*words, folder / "a.mcap", "--map", "lopsided")
        assert "a.mcap: recorded on the map cme, used with --map lopsided\n" in err
    _, _, err = call("score", "ideal", folder / "a.mcap")
    assert "recorded on" not in err
