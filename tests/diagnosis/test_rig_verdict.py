"""What is said of a whole rig: records of the tests' own plant with contact, which shares nothing with the models."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from commands import call
from contacteffects import EFFECTS, changed, truth
from contactrig import Rig, record
from hidden_effects import write_hidden_rig
from planar_rig import PATIENT
from strange_rigs import StrangeRig

import mazeplan
from mazeplan.control.estimation.rigid_body_fit import value_of, with_values
from mazeplan.core.logs.table import Table, join, read_table
from mazeplan.diagnosis.rig import fitting, search, verdict
from mazeplan.diagnosis.rig.imbalance import BALANCED
from mazeplan.diagnosis.rig.record import filter_on_stage
from mazeplan.diagnosis.rig.reference import known_reference, reference_of, textbook
from mazeplan.diagnosis.rig.scores import HeldOut
from mazeplan.diagnosis.rig.search import THE_SAME
from mazeplan.diagnosis.rig.verdict import verdict_on
from mazeplan.diagnosis.ring.system import ring_library
from mazeplan.diagnosis.stage import navigation
from mazeplan.diagnosis.update import reference_after
from mazeplan.learning.modelfile import load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.effect import DRAG, Effect, Parameter
from mazeplan.run.collect import Collection, run_collection

pytestmark = pytest.mark.slow

MAZE, SECONDS = load_map("cme"), 60.0


def table_of(rig, seed, seconds=SECONDS):
    return Table(record(rig, seconds, seed))


@cache
def known():
    return reference_of([table_of(Rig(), 1, 120.0)], MAZE, None)


@pytest.mark.parametrize(
    ("name", "seconds", "seed"),
    # of the torque's records with seeds 2 to 5, two stand at an edge: digits of the stage's fit decide
    [("lens_distortion", SECONDS, 2), ("constant_torque", 120.0, 4), ("servo_gain", SECONDS, 2)],
)
def test_one_thing_that_changed_is_named_and_nothing_else(name, seconds, seed):
    done = verdict_on(table_of(changed(Rig(), name, 2), seed, seconds), MAZE, known())
    assert done.verdict == "effect_found"
    (effect,) = done.effects
    assert effect["name"] in EFFECTS[name].names
    assert done.remaining < 1.3
    first, *rest = done.sentences()
    assert name.replace("_", " ") in first
    assert "times the noise of the camera" in first
    assert rest, "what to do"


def test_of_a_long_record_a_part_chooses_and_the_whole_gives_the_size(monkeypatch):
    monkeypatch.setattr(fitting, "SHORT_RECORD", 2000)
    rig = changed(Rig(), "dry_friction", 1)
    done = verdict_on(table_of(rig, 2, 90.0), MAZE, known())
    assert [e["name"] for e in done.effects] == ["dry_friction"]
    assert len(done.searched.fit.filtered.nu) == 2700
    told = done.effects[0]["parameters"]["coefficient"]
    ring = MAZE.track_radius(int(next(iter(done.effects[0]["rings"]))))
    assert told["value"] == pytest.approx(
        truth(rig, "dry_friction", "dry_friction", ring, Rig())["coefficient"], rel=0.05
    )
    assert done.after["rollout40"] < done.before["rollout40"]


def test_a_push_that_repeats_is_neither_a_rocking_table_nor_its_third_harmonic():
    done = verdict_on(table_of(changed(Rig(), "kicks", 2), 2), MAZE, known())
    assert done.verdict == "unknown_effect"
    assert not done.effects
    assert "again and again, every 1.11 s (0.900 Hz)" in done.sentences()[0]
    assert "Look for what bumps the table" in done.sentences()[1]


def test_what_the_reference_has_as_well_is_no_news():
    rig = changed(Rig(), "surface_bump", 2)
    was = reference_of([table_of(rig, 1)], MAZE, None)
    record_now = table_of(rig, 2)
    done = verdict_on(record_now, MAZE, was)
    assert (done.verdict, done.effects) == ("nothing_missing", ())
    tried = {one["name"]: one["why_not"] for one in done.document()["tried"]}
    assert tried["surface_bump"] == THE_SAME
    alone = verdict_on(record_now, MAZE, replace(was, then=None))  # by the numbers of the reference only
    assert "surface_bump" in [e["name"] for e in alone.effects]


def test_an_unbalanced_ball_is_named_and_no_news_afterwards():
    rig = changed(Rig(), "ball_imbalance", 2)
    done = verdict_on(table_of(rig, 2), MAZE, known())
    assert done.verdict == "effect_found"
    (effect,) = done.effects
    assert (effect["name"], effect["planned"]) == ("ball_imbalance", False)
    found, radius = effect["parameters"]["amplitude"], MAZE.track_radius(int(next(iter(effect["rings"]))))
    true = truth(rig, "ball_imbalance", "ball_imbalance", radius, Rig())["amplitude"]
    assert found["value"] == pytest.approx(true, abs=min(3.0 * found["stderr"], 0.4 * true))
    first, second, *_ = done.sentences()
    assert "ball imbalance (in ring" in first
    assert "amplitude from 0 to" in first
    assert "evenly heavy. No plan can allow for it: the phase is lost" in second
    again = verdict_on(table_of(rig, 3), MAZE, reference_after(done))
    assert "ball_imbalance" not in [e["name"] for e in again.effects]


@pytest.mark.parametrize(
    ("column", "moved", "change", "what_to_do"),
    # lower commands with the same tilt: the plate leans, and the tilt sensor shows it
    [("u_beta", -0.012, 0.012, "Level the table"), ("beta", 0.012, -0.012, "Set the tilt sensor to zero")],
)
def test_a_lean_that_the_tilt_sensor_shows_is_told_from_a_zero_that_moved(column, moved, change, what_to_do):
    def shifted(seed):
        table = table_of(Rig(), seed)
        return replace(table, columns={**table.columns, column: table[column] + moved})

    done = verdict_on(shifted(2), MAZE, known())
    (effect,) = done.effects
    assert effect["name"] == "tilt_offset"
    was, now = effect["known_before"]["beta"], effect["parameters"]["beta"]["value"]
    assert now - was == pytest.approx(change, abs=1e-3)
    assert done.sentences()[1].startswith(what_to_do)
    assert verdict_on(shifted(3), MAZE, reference_after(done)).verdict == "nothing_missing"


def test_a_ball_that_is_predicted_much_worse_than_before_is_not_called_healthy(monkeypatch):
    monkeypatch.setattr(verdict, "unbalanced", lambda body, fit: BALANCED)  # as if this had no name
    done = verdict_on(table_of(changed(Rig(), "ball_imbalance", 2), 2), MAZE, known())
    assert done.verdict == "unknown_effect"
    assert "times as badly as when the model was right" in done.sentences()[0]
    assert any("evenly heavy" in advice for advice in done.sentences()[1:])


def test_what_predicts_the_ball_no_better_is_not_called_found(monkeypatch):
    monkeypatch.setattr(HeldOut, "better", False)
    done = verdict_on(table_of(changed(Rig(), "servo_gain", 2), 2), MAZE, known())
    assert done.verdict == "unknown_effect"
    assert not done.effects
    assert "looks like servo gain, but predicts the ball no better" in done.sentences()[0]


@pytest.mark.parametrize(("kind", "effect", "gamma"), [("gain", "servo_gain", 0.85), ("tilt_scale", "tilt_gain", 1.15)])
def test_runs_show_whether_the_gain_of_servo_or_sensor_has_changed(kind, effect, gamma, tmp_path, monkeypatch, capsys):
    logs, rig = [str(tmp_path / f"{seed}.mcap") for seed in range(14)], tmp_path / "rig.yaml"
    write_hidden_rig(rig, kind, MAZE)
    for seed, log in enumerate(logs):
        mazeplan.navigate(1, rig=str(rig), model="toy", seed=seed, log=log, settings=PATIENT)

    def effects():
        code, out, err = call(monkeypatch, capsys, "diagnose", *logs, "--model", "toy", "--json")
        assert code == 0, err
        return {e["name"]: e["parameters"] for e in json.loads(out)["effects"]}

    ((name, numbers),) = effects().items()
    assert name == effect
    assert numbers["gamma"]["value"] == pytest.approx(gamma, abs=1.96 * numbers["gamma"]["stderr"])
    assert numbers["beta"]["value"] == pytest.approx(1.0, abs=1.96 * numbers["beta"]["stderr"])
    monkeypatch.setattr(navigation, "nearer_tilt", lambda *arguments: 1.9)  # the tilt has to agree
    assert effect not in effects()


def verdict_on_runs(folder, kind):
    tables, rig = [], folder / "rig.yaml"
    write_hidden_rig(rig, kind, MAZE)
    for seed in range(20):
        log = folder / f"{seed}.mcap"
        mazeplan.navigate(1, rig=str(rig), model="toy", seed=seed, log=log, settings=PATIENT)
        tables.append(read_table(log))
    return verdict_on(join(tables), MAZE, known_reference("toy", load_model("toy"), MAZE))


def test_runs_show_a_coupling_of_the_servos(tmp_path):
    done = verdict_on_runs(tmp_path, "coupling")
    (effect,) = done.effects
    assert (effect["name"], done.unknown) == ("axis_coupling", None)
    number = effect["parameters"]["gamma_from_beta"]
    assert number["value"] == pytest.approx(0.12, abs=1.96 * number["stderr"])
    assert "axis coupling (gamma from beta from 0 to 0.1" in done.sentences()[0]


def test_runs_show_that_a_servo_has_play_and_no_model_is_given_its_size(tmp_path):
    done = verdict_on_runs(tmp_path, "backlash")
    assert (done.verdict, done.effects) == ("unknown_effect", ())
    first, *advice = done.sentences()
    assert "the servo of gamma has play or a dead band." in first
    assert "mazeplan collect" in advice[0]
    assert any("gains of the servos were not compared" in note for note in done.notes)


def test_a_healthy_rig_that_loses_pictures_is_left_alone():
    table = table_of(Rig(), 3)
    lost = np.random.default_rng(0).random(len(table)) < 0.2
    x, y = (np.where(lost, np.nan, table[name]) for name in "xy")
    done = verdict_on(Table({**table.columns, "x": x, "y": y}), MAZE, known())
    assert done.verdict == "nothing_missing"
    assert done.searched.without.filtered.starts < 60, "gaps are bridged"
    assert done.after == done.before


def recorded(path, settings, seed):
    """A minute of a rig as strangers build it."""
    run_collection(StrangeRig(MAZE, settings), MAZE, Collection(SECONDS, (1, 2, 3, 4), seed), path)
    return read_table(path)


def of_a_point(path, share):
    """A minute of a rig whose ball is a point that feels a share of gravity, and meets walls without spin."""
    return recorded(path, {"share": share, "rest": 0.4}, 3)


def test_two_tilt_sensors_that_change_alike_are_one_ball(tmp_path):
    was = reference_of([of_a_point(tmp_path / "was.mcap", 0.6)], MAZE, None).body
    table = of_a_point(tmp_path / "now.mcap", 0.72)
    body = filter_on_stage(table, MAZE, None)
    sensors = search.search_rig(body, was, MAZE, without=("rolling_inertia",))
    assert [c.effect for c in sensors.candidates] == ["tilt_gain"]
    ball = search.one_ball_instead(body, sensors, was)
    assert [c.effect for c in ball.candidates] == ["rolling_inertia"]
    assert 1.0 / (1.0 + ball.fit.value("inertia")) == pytest.approx(0.72, rel=0.02)
    model = with_values(sensors.fit.model, {"gain_beta": value_of(was.model, "gain_beta")})
    one = replace(sensors, fit=replace(sensors.fit, model=model))
    assert search.one_ball_instead(body, one, was) is one


@pytest.mark.parametrize("measured", [True, False], ids=["behind the sensor", "without a sensor"])
def test_play_that_no_sensor_sees_is_no_later_camera(measured, tmp_path):
    healthy = {"servo": "stepper", "slew_deg_s": 60.0, "measured": measured, "counted": True, "late_ms": 20.0}
    now = {
        "backlash": healthy | {"play_beta_deg": 0.5, "play_gamma_deg": 0.5}, "sensor_delay": healthy | {"late_ms": 50.0}
    }  # fmt: skip
    was = reference_of([recorded(tmp_path / "was.mcap", healthy, 1)], MAZE, None)
    for name, settings in now.items():
        done = verdict_on(recorded(tmp_path / f"{name}.mcap", settings, 2), MAZE, was)
        assert [effect["name"] for effect in done.effects] == [name]
    (play,) = verdict_on(read_table(tmp_path / "backlash.mcap"), MAZE, was).effects
    for number in play["parameters"].values():
        assert math.degrees(number["value"]) == pytest.approx(0.5, abs=0.1)


def test_a_textbook_ball_lacks_what_any_rig_has():
    done = verdict_on(table_of(Rig(), 1), MAZE, textbook())
    names = {effect["name"] for effect in done.effects}
    assert {"dry_friction", "sensor_delay"} <= names
    delay = next(e for e in done.effects if e["name"] == "sensor_delay")
    assert delay["parameters"]["delay"]["value"] == pytest.approx(Rig().camera.delay, abs=0.005)


def test_an_effect_of_a_users_own_is_looked_for_and_one_without_a_place_on_a_body_is_told():
    own = Effect("air_in_the_way", {"rate": Parameter("1/s", 0.0, 0.0, 5.0, smallest=0.02)}, DRAG, lambda s, p: p.rate)
    gate = replace(own, name="bead_only", formula=lambda s, p: p.rate * s.past_1)
    done = verdict_on(table_of(changed(Rig(), "viscous_friction", 2), 2), MAZE, known(), own=[own, gate])
    assert {name for group in ([e["name"] for e in done.effects], *done.alike) for name in group} & {
        "air_in_the_way",
        "viscous_friction",
    }
    assert any(note.startswith("bead_only was not looked for") for note in done.notes)
    assert "air_in_the_way" not in {e.name for e in ring_library()}


def test_many_logs_of_navigation_are_one_record(tmp_path, monkeypatch, capsys):
    rig = tmp_path / "rig.yaml"
    toy = (Path(mazeplan.__file__).parent / "rigs" / "toy.yaml").read_text()
    rig.write_text(toy.replace("table_x_deg: 0.3", "table_x_deg: 1.2"))
    logs = []
    for seed in range(10):
        logs.append(str(tmp_path / f"{seed}.mcap"))
        mazeplan.navigate(1, rig=str(rig), seed=seed, start_angle_deg=25 * seed, log=logs[-1], settings=PATIENT)
    code, out, err = call(
        monkeypatch, capsys, "diagnose", *logs, "--model", "toy", "-o", str(tmp_path / "out"), "--json"
    )
    assert code == 0, err
    document = json.loads(out)
    assert [e["name"] for e in document["effects"]] == ["tilt_offset"]
    gamma = document["effects"][0]["parameters"]["gamma"]
    assert gamma["value"] == pytest.approx(np.radians(1.2), rel=0.2)
    assert any("in navigation" in note for note in document["notes"]), "what feedback hides is said"
    assert (tmp_path / "out" / "report.html").stat().st_size > 20_000
    assert (tmp_path / "out" / "model" / "reference.yaml").is_file()
