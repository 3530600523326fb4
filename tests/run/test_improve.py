"""The loop, closed on a simulated rig, and its parts on a rig of the tests' own with contact."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
from contacteffects import changed
from contactrig import Rig, record

from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.rig.reference import reference_of
from mazeplan.diagnosis.rig.verdict import verdict_on
from mazeplan.diagnosis.update import moved_model, reference_after
from mazeplan.learning.identification import fit_rig
from mazeplan.learning.modelfile import load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.run.commands.improve import improve

MAZE = load_map("cme")


def table_of(rig, seed):
    """Eighty seconds of a rig: twenty in each ring."""
    columns = record(rig, 80.0, seed)
    x, y = columns["x"], columns["y"]
    return Table({**columns, "theta": np.arctan2(y, x), "r": np.hypot(x, y)})


@cache
def known():
    """A healthy rig, what a record of it tells, and its model of kind pi."""
    table = table_of(Rig(), 1)
    model = fit_rig(table, MAZE, ()).model
    return reference_of([table], MAZE, model), model


@cache
def seen(name):
    """The verdict on a rig in which one thing changed."""
    rig = changed(Rig(), name, 1)
    return verdict_on(table_of(rig, 2), MAZE, known()[0])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tilt_offset", "camera_offset", "dry_friction"])
def test_what_changed_is_found_goes_into_the_model_and_is_no_news_then(name):
    done, (_, model) = seen(name), known()
    assert [e["name"] for e in done.effects] == [name]
    assert done.after["rollout40"] < 0.8 * done.before["rollout40"]
    new = moved_model(model, done.effects, done.searched.fit)
    assert new != model
    again = verdict_on(table_of(changed(Rig(), name, 1), 3), MAZE, reference_after(done))
    assert again.verdict == "nothing_missing"


@pytest.mark.slow
def test_a_table_that_leans_leans_in_all_rings_of_the_new_model():
    done, (was, model) = seen("tilt_offset"), known()
    new = moved_model(model, done.effects, done.searched.fit)
    (effect,) = done.effects
    for axis in ("beta", "gamma"):
        change = effect["parameters"][axis]["value"] - effect["known_before"][axis]
        moved = [m.ball(ring).parameter("tilt_offset", axis, 0.0) for ring in (1, 4) for m in (model, new)]
        assert [moved[1] - moved[0], moved[3] - moved[2]] == pytest.approx([change] * 2, abs=1e-6)
    assert was.body.model.tilting.tilt_beta == effect["known_before"]["beta"]


@pytest.mark.slow
def test_a_leaning_rig_from_beginning_to_end(tmp_path):
    rig = tmp_path / "rig.yaml"
    rig.write_text("model: ideal\nrolling_friction_m: 2.0e-5\ntable_x_deg: 1.5\n")
    told, doing, far = [], [], []
    (entry,) = improve(
        rig, output=tmp_path / "out", runs=2, seconds=40.0, seed=1,
        tell=told.append, progress=doing.append, advance=lambda *how: far.append(how),
    ).rounds  # fmt: skip
    assert far == [*((s, 40) for s in range(1, 41)), (1, 2), (2, 2), (1, 2), (2, 2)]
    assert {"stage", "navigating before", "navigating after"} <= set(doing)
    assert "tilt_offset" in [e["name"] for e in entry["diagnosis"]["effects"]]
    new = load_model(entry["diagnosis"]["model"])
    assert new.ball(1).parameter("tilt_offset", "gamma", 0.0) == pytest.approx(np.radians(1.5), abs=4e-3)
    before, after = entry["navigation"]["before"], entry["navigation"]["after"]
    assert "results" not in before
    assert (entry["compared"]["pairs"], entry["compared"]["b"]) == (2, "after")
    assert after["success"] == 2
    assert after["success"] > before["success"] or after["time_s"]["mean"] < before["time_s"]["mean"]
    assert json.loads((tmp_path / "out" / "round1" / "round.json").read_text())["navigation"]["after"] == after
    assert (tmp_path / "out" / "round1" / "record.mcap").exists()
    assert any(text.startswith("before: ") for text in told)


@pytest.mark.slow
def test_a_rig_without_a_model_learns_one_first(tmp_path):
    """Servos with a limited rate and a ball that is a point: a healthy rig of a stranger."""
    told = []
    out = tmp_path / "out"
    (entry,) = improve("strange_rigs:Slow", output=out, runs=4, seconds=150.0, seed=3, tell=told.append).rounds
    diagnosis = entry["diagnosis"]
    assert (diagnosis["verdict"], diagnosis["effects"]) == ("nothing_missing", [])
    assert (out / "first" / "record.mcap").is_file()
    assert diagnosis["model"] == str(out / "first" / "model")
    assert diagnosis["advice"] == [
        f"Plan with the model that was learned: mazeplan navigate --rig RIG --model {diagnosis['model']}."
    ]
    assert load_model(diagnosis["model"]).stage.beta.order == 1
    assert entry["navigation"]["after"]["success"] == 4
