"""What a model lacks is named, on records of a plant that shares nothing with the models."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import axisplant
import contactplant
import contactrig
import numpy as np
import plainball
import plant
import pytest
from plant import play
from ring_records import DECLARED, found, names, parameters, record

from mazeplan.core.errors import TableError
from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.record import record_of, turned_round
from mazeplan.diagnosis.ring.diagnose import diagnose


@pytest.mark.parametrize("truth", [plant, axisplant, contactplant, contactrig, plainball], ids=lambda m: m.__name__)
def test_the_plants_share_nothing_with_the_models(truth):
    tree = ast.parse(Path(truth.__file__).read_text())
    imported = [a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names]
    imported += [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    assert not any(name.startswith("mazeplan") for name in imported)


@pytest.mark.parametrize("process", [0.0, 0.4], ids=["quiet", "process noise"])
def test_where_nothing_is_missing_it_says_so(process):
    done = found(seed=1, process=process)
    assert done.verdict == "nothing_missing"
    assert done.effects == ()
    assert done.sentence().startswith("Nothing is missing" if process == 0.0 else "Nothing that is missing was found")
    assert done.after.rollout40 < 1.5 * done.after.floor if process == 0.0 else done.after.rollout40 > 0.0


@pytest.mark.slow
def test_what_noise_does_not_explain_is_said_where_nothing_was_found():
    done = found(seed=1)
    error = 3.0 * done.before.floor
    more = replace(done, before=replace(done.before, rollout40=error))
    rest = "what causes the rest comes too seldom or too irregularly to be named: a longer record would tell more"
    noise = f"noise alone would cause {done.before.floor:.4f}"
    said = f"Nothing that is missing was found: 40-step error {error:.4f} rad, {noise}; {rest}."
    assert (more.verdict, more.sentence()) == ("nothing_missing", said)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "name", "parameter", "true"),
    [
        ({"dry": 0.3}, "dry_friction", "coefficient", 0.3),
        ({"offset": (0.004, -0.003)}, "tilt_offset", "beta", 0.004),
        ({"delay": 0.05}, "sensor_delay", "delay", 0.05),
        ({"viscous": 0.6}, "viscous_friction", "coefficient", 0.6),
        ({"factor": 0.6}, "rolling_inertia", "factor", 0.6),
        ({"quadratic": 0.1}, "quadratic_drag", "coefficient", 0.1),
        ({"angle": 0.05}, "axis_misalignment", "angle", 0.05),
        ({"bump": (1.0, 0.25, 1.5)}, "surface_bump", "height", 1.5),
        ({"camera_offset": (0.002, -0.001)}, "camera_offset", "x", 0.002),
        ({"drift": 0.005}, "friction_drift", "rate", 0.005),
        ({"gate": (0.8, 0.3)}, "gate_loss", "loss", 0.3),
    ],
    ids=lambda x: x if isinstance(x, str) else None,
)
def test_one_effect_is_named_with_its_size(what, name, parameter, true):
    done = found(seed=3, seconds=60.0, **what)
    assert names(done) == [name], done.sentence()
    assert done.verdict in ("effect_found", "ambiguous")
    got = parameters(done, name)[parameter]
    assert got["value"] == pytest.approx(true, abs=max(5.0 * got["stderr"], 0.02 * abs(true)))
    assert done.after.rollout40 < 2.0 * done.after.floor
    assert done.before.rollout40 > 1.5 * done.after.rollout40
    assert name.replace("_", " ") in done.sentence()


@pytest.mark.slow
def test_two_effects_at_once():
    done = found(seed=4, seconds=60.0, dry=0.3, offset=(0.004, -0.003))
    assert names(done) == ["dry_friction", "tilt_offset"]


@pytest.mark.slow
def test_what_swings_with_time_has_no_name_and_a_frequency():
    done = found(seed=5, hum=(1.7, 0.8))
    assert done.verdict == "unknown_effect"
    document = done.document()
    assert document["unknown"]["depends_on"] == ["time"]
    assert "1.700 Hz" in document["unknown"]["description"]
    assert document["after"]["rollout40"] < 0.5 * document["before"]["rollout40"]


@pytest.mark.slow
def test_friction_that_grows_with_the_tilt_has_no_name_and_no_wrong_one():
    done = found(seed=6, lean=8.0)
    assert done.verdict == "unknown_effect", done.sentence()
    assert set(done.document()["unknown"]["depends_on"]) >= {"theta_dot", "beta", "gamma"}


@pytest.mark.slow
def test_a_tilt_offset_is_hard_to_tell_from_a_wave_of_the_floor_and_it_says_so():
    done = found(seed=3, offset=(0.006, -0.004))
    assert any({"tilt_offset", "surface_profile"} <= set(group) for group in done.finding.alike)
    assert done.verdict == "effect_found", "the one with fewer parameters is taken"


@pytest.mark.slow
def test_gaps_frozen_samples_and_wrapped_angles_do_no_harm():
    columns = play(seed=3, dry=0.3)
    columns["theta"][500:520] = np.nan
    columns["r"][500:520] = np.nan
    columns["theta"][1500:1540] = columns["theta"][1500]
    done = diagnose(record_of(Table(columns)), 0.0925, DECLARED)
    assert names(done) == ["dry_friction"]
    assert any("repeat" in note for note in done.notes)
    assert any("not seen in 59" in note for note in done.notes)


def test_without_commands_the_tilt_sensor_stands_in_and_it_says_so():
    columns = play(seed=3, dry=0.4)
    bare = {name: column for name, column in columns.items() if name not in ("u_beta", "u_gamma", "r")}
    done = diagnose(record_of(Table(bare)), 0.0925, DECLARED)
    assert "dry_friction" in names(done)
    assert done.tilt_source == "the tilt sensor, smoothed"
    assert len([n for n in done.notes if "cannot be checked" in n]) == 2


def test_a_plate_that_does_not_move_teaches_nothing():
    columns = play(seed=1, seconds=20.0, u=np.zeros((600, 2)))
    columns["beta"][:] = columns["gamma"][:] = 0.0
    with pytest.raises(TableError, match="nothing can be learned"):
        record_of(Table(columns))
    said = r"got 100 samples of the ball in ring 1, expected at least 300 \(10 s\): record for longer: mazeplan collect"
    with pytest.raises(TableError, match=said):
        record_of(Table(play(seed=1, seconds=20.0)), np.arange(600) < 100, ring=1)


@pytest.mark.slow
def test_a_further_record_is_scored_and_not_looked_at():
    done = diagnose(record(seed=3, seconds=60.0, dry=0.3), 0.0925, DECLARED, test=record(seed=9, seconds=40.0, dry=0.3))
    assert done.test is not None
    before, after = done.test
    assert after.rollout40 < 0.5 * before.rollout40
    assert set(done.document()["test"]) == {"before", "after"}


def test_an_axis_that_is_counted_the_other_way_round_is_turned_and_told():
    columns = play(seed=3, dry=0.4)
    right, none = turned_round(Table(columns), 0.0925)
    assert none == ()
    assert (right["beta"] == columns["beta"]).all()
    other = Table({**columns, "beta": -columns["beta"], "u_beta": -columns["u_beta"]})
    back, notes = turned_round(other, 0.0925)
    assert (back["beta"] == columns["beta"]).all()
    assert (back["u_beta"] == columns["u_beta"]).all()
    assert (back["gamma"] == columns["gamma"]).all()
    assert len(notes) == 1
    assert notes[0].startswith("beta is counted the other way round")
    assert notes[0] in record_of(back, notes=notes).notes
    rings = np.full(len(columns["t"]), 2.0)  # of a log: all rows count, whatever their ring
    assert turned_round(Table({**other.columns, "ring": rings}), 0.0925)[1] == notes
