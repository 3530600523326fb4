"""The loop, closed on the simulated rig, and its parts on a plant of its own."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from plant import DAMPING, SERVO, play

from mazeplan.data.table import Table
from mazeplan.errors import ModelError, TableError
from mazeplan.improve import Options, improve, one_round, reference_of, ring_records
from mazeplan.maze.mapfile import load_map
from mazeplan.models.modelfile import RigModel, load_model
from mazeplan.physics.ball import rolling_inertia, viscous_friction
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.sensors import Camera
from mazeplan.physics.stage import StageAxis, StageModel

MAZE = load_map("cme")
KNOWN = BallModel((rolling_inertia(5 / 7), viscous_friction(0.35)))
STAGE = StageModel(*[StageAxis(1.0, SERVO, DAMPING)] * 2)
MODEL = RigModel(STAGE, dict.fromkeys((1, 2), KNOWN), kind="pi")


def in_two_rings(**effects):
    """The plant for a minute in ring 1, then in ring 2, with x and y."""
    parts = [play(seed=ring, seconds=60.0, radius=MAZE.track_radius(ring), **effects) for ring in (1, 2)]
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    n = len(parts[0]["t"])
    columns["t"] = np.arange(2 * n) / 30.0
    columns["segment"] = np.repeat([0.0, 1.0], n)
    columns["x"], columns["y"] = (columns["r"] * f(columns["theta"]) for f in (np.cos, np.sin))
    return Table(columns)


def test_a_record_that_is_too_short_says_by_how_much():
    table = in_two_rings()
    short = Table({name: column[:300] for name, column in table.columns.items()})
    with pytest.raises(TableError, match=r"got 10 s of the ball in one ring at the most, expected 30 s; record more"):
        ring_records(short, MAZE, MODEL)


def test_a_table_that_is_not_level_is_found_in_both_rings_and_put_into_all():
    table = in_two_rings(offset=(0.006, -0.004))
    document, new = one_round(table, MAZE, MODEL, None, lambda text: None)
    assert document["verdict"] == "effect_found"
    (effect,) = document["effects"]
    assert (effect["name"], effect["rings"]) == ("tilt_offset", [1, 2])
    for ring in (1, 2):
        found = [new.ball(ring).parameter("tilt_offset", axis, 0.0) for axis in ("beta", "gamma")]
        assert found == pytest.approx([0.006, -0.004], abs=5e-4)
    assert document["after"]["rollout40"] < 0.3 * document["before"]["rollout40"]
    again, same = one_round(table, MAZE, new, None, lambda text: None)
    assert again["verdict"] == "nothing_missing"
    assert same == new


def test_a_camera_that_is_off_is_found_once():
    table = in_two_rings(camera_offset=(0.0015, -0.001))
    document, new = one_round(table, MAZE, MODEL, None, lambda text: None)
    assert [e["name"] for e in document["effects"]] == ["camera_offset"]
    assert (new.camera.offset_x, new.camera.offset_y) == pytest.approx((0.0015, -0.001), abs=2e-4)
    assert new == replace(MODEL, camera=Camera(new.camera.offset_x, new.camera.offset_y))
    assert one_round(table, MAZE, new, None, lambda text: None)[0]["verdict"] == "nothing_missing"


def test_a_rig_with_a_surprise_from_beginning_to_end(tmp_path):
    rig = tmp_path / "rig.yaml"
    rig.write_text("model: ideal\nrolling_friction_m: 2.0e-5\ntable_x_deg: 1.5\n")
    told, doing, far = [], [], []
    (entry,) = improve(
        str(rig), tmp_path, Options(runs=2, seconds=60.0, seed=1),
        tell=told.append, working=doing.append, advance=lambda *how: far.append(how),
    )  # fmt: skip
    assert far == [*((s, 60) for s in range(1, 61)), (1, 2), (2, 2), (1, 2), (2, 2)]
    assert {"ring 1: stage", "navigating before", "navigating after"} <= set(doing)
    assert "tilt_offset" in [e["name"] for e in entry["diagnosis"]["effects"]]
    new = load_model(entry["diagnosis"]["model"])
    assert new.ball(1).parameter("tilt_offset", "gamma", 0.0) == pytest.approx(np.radians(1.5), abs=4e-3)
    before, after = entry["navigation"]["before"], entry["navigation"]["after"]
    assert "results" not in before
    assert after["success"] == 2
    assert after["success"] > before["success"] or after["time_s"]["mean"] < before["time_s"]["mean"]
    assert json.loads((tmp_path / "round1" / "round.json").read_text())["navigation"]["after"] == after
    assert (tmp_path / "round1" / "record.mcap").exists()
    assert any(text.startswith("before: ") for text in told)


def test_what_a_model_keeps_of_its_old_log_is_read_or_refused():
    kept = replace(MODEL, scores={"evidence_when_learned": {"samples": 900, "gains": {"gate_loss": 120.0}}})
    found = reference_of(kept)
    assert found is not None
    assert (found.samples, found.gains) == (900, {"gate_loss": 120.0})
    assert reference_of(MODEL) is None
    with pytest.raises(ModelError, match="evidence_when_learned: expected"):
        reference_of(replace(MODEL, scores={"evidence_when_learned": 3}))
