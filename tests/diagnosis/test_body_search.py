"""What differs between two records of an integrator that shares nothing with the model (`plainball`), and of a rig with
contact that others simulated."""

from __future__ import annotations

import json
import os
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import plainball
import pytest
from commands import call

from mazeplan.control.estimation.rigid_body_filter import BallPictures, BodyFilter, BodyModel
from mazeplan.control.estimation.rigid_body_fit import fit_body, value_of, with_values
from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.rig.candidates import of_effect
from mazeplan.diagnosis.rig.findings import registry_entry
from mazeplan.diagnosis.rig.fitting import Reference, surely_differs
from mazeplan.diagnosis.rig.reference import reference_of
from mazeplan.diagnosis.rig.search import search_rig
from mazeplan.diagnosis.update import moved_model
from mazeplan.learning.modelfile import RigModel, load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.dynamics.plate import PlateMotion
from mazeplan.physics.dynamics.walls import GAP, SLAB, Walls
from mazeplan.physics.effect import DRAG, Effect, Parameter

FREE = (
    "rolling", "spin", "wall", "restitution", "tilt_beta", "tilt_gamma", "offset_x", "offset_y", "delay", "noise",
    "plane", "strike", "gain_beta", "gain_gamma", "inertia", "viscous",
)  # fmt: skip
TABLE, MAZE = (0.003, -0.004), load_map("cme")
CONTACT = Path(os.environ.get("MAZEPLAN_DATA", Path(__file__).parents[3] / "shared" / "data")) / "contact" / "A"


def filtered(toy, seed, table=TABLE, delay=2.0 / 30.0, lost=0.0, seconds=60.0):
    """The filter for a record."""
    t, y, wave, _ = plainball.record(toy, seed=seed, seconds=seconds, table=table, noise=5e-4, delay=delay)
    y[np.random.default_rng(5).random(len(y)) < lost] = np.nan
    grid = np.arange(0.0, t[-1] + 0.1, 5e-3)
    plate = PlateMotion(0.0, 5e-3, np.array([plainball.plate_at(wave, at) for at in grid]))
    wall = np.array([[toy.inner - 0.003, toy.inner - 1e-3, 0.0, 0.0]])
    walls = Walls(wall, np.zeros((0, GAP)), np.zeros((0, SLAB)), toy.outer, toy.radius, 1e-3)
    return BodyFilter(BallPictures(t, 1.0 / 30.0, y, t == 0.0), plate, walls)


@cache
def reference():
    fit = fit_body(filtered(plainball.Toy(), 1), with_values(BodyModel(), {"hold": 1.0}), FREE)
    return Reference(fit.model, fit.stderr)


@cache
def searched(toy, **how):
    return search_rig(filtered(toy, 2, **how), reference(), MAZE)


@pytest.mark.slow
@pytest.mark.parametrize(("toy", "how", "effect", "name", "true"), [
    (plainball.Toy(c=0.18), {"lost": 0.2}, "dry_friction", "rolling", 0.18),
    (plainball.Toy(k=2.0 / 3.0), {}, "rolling_inertia", "inertia", 2.0 / 3.0),
    (plainball.Toy(), {"table": (0.011, 0.005)}, "tilt_offset", "tilt_beta", 0.011),
    (plainball.Toy(), {"delay": 4.0 / 30.0}, "sensor_delay", "delay", 4.0 / 30.0),
])  # fmt: skip
def test_one_thing_that_changed_is_named_with_its_size_and_nothing_else(toy, how, effect, name, true):
    found = searched(toy, **how)
    assert [c.effect for c in found.candidates] == [effect]
    assert not found.found[0].rivals
    assert value_of(found.fit.model, name) == pytest.approx(true, rel=0.08)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3])
def test_a_rig_as_it_was_raises_no_alarm(seed):
    found = search_rig(filtered(plainball.Toy(), seed), reference(), MAZE)
    assert found.found == ()
    assert found.fit.minus2 == found.without.minus2


@pytest.mark.slow
def test_a_pull_without_a_body_of_its_own_is_not_called_a_friction():
    found = searched(plainball.Toy(push=2.0))  # cos(theta) along the ring
    assert found.found
    names = {c.effect for c in found.candidates}
    assert not names & {"dry_friction", "viscous_friction", "quadratic_drag", "sensor_delay"}


def test_an_effect_of_a_user_that_the_reference_lacks_is_at_its_defaults():
    rub = Effect("rub", {"rate": Parameter("1/s", 1.0, 0.0, 5.0, smallest=0.02)}, DRAG, lambda s, p: p.rate - 1.0)
    was = Reference(BodyModel())
    model = was.model._replace(terms=(rub(rate=1.01),))
    assert not surely_differs(model, {"rub.rate": 1e-4}, was, ("rub.rate",))
    fit: Any = SimpleNamespace(model=model, stderr={"rub.rate": 1e-4})
    told = registry_entry(of_effect(rub), fit, was, {1: 0.08})
    assert told["known_before"] == {"rate": 1.0}


def test_a_reference_that_fits_worse_makes_a_change_less_sure():
    now = BodyModel()._replace(ball=BodyModel().ball._replace(rolling=0.05))  # 0.03 before
    for misfit, sure in ((1.0, True), (1.5, False)):
        was = Reference(BodyModel(), {"rolling": 2e-3}, misfit=misfit)
        assert surely_differs(now, {"rolling": 1e-4}, was, ("rolling",)) == sure


@pytest.mark.slow
def test_names_of_the_registry_have_its_units():
    found = searched(plainball.Toy(c=0.18), lost=0.2)
    told = registry_entry(found.candidates[0], found.fit, reference(), {1: 0.08, 2: 0.04})
    c = told["parameters"]["coefficient"]
    assert c["unit"] == "rad/s^2"
    assert c["value"] == pytest.approx(0.18 / 1.4 / 0.08, rel=0.08)
    assert c["value"] - told["known_before"]["coefficient"] == pytest.approx(0.12 / 1.4 / 0.08, rel=0.08)
    assert told["rings"]["2"]["after"]["coefficient"] == pytest.approx(2.0 * c["value"])


@pytest.mark.slow
def test_a_model_of_beads_moves_by_as_much_as_the_body_did():
    model = RigModel.nominal(MAZE)
    found = searched(plainball.Toy(c=0.18), lost=0.2)
    told = registry_entry(found.candidates[0], found.fit, reference(), {1: 0.08, 2: 0.04})
    new = moved_model(model, [told], found.fit)
    for ring, radius in ((1, 0.08), (2, 0.04)):
        was, now = (m.ball(ring).parameter("dry_friction", "coefficient", 0.0) for m in (model, new))
        assert now - was == pytest.approx(0.12 / 1.4 / radius, rel=0.08)
    assert new.ball(1).parameter("rolling_inertia", "factor", 0.0) == model.ball(1).parameter(
        "rolling_inertia", "factor", 0.0
    )


@pytest.mark.slow
def test_a_record_without_commands_tells_the_ball_and_nothing_of_the_stage():
    t, y, wave, _ = plainball.record(plainball.Toy(), seed=2, seconds=40.0, noise=5e-4)
    tilts = np.array([plainball.plate_at(wave, at) for at in t])
    columns = {"t": t, "x": y[:, 0], "y": y[:, 1], "beta": tilts[:, 0], "gamma": tilts[:, 3]}
    known = reference_of([Table(columns)], MAZE, None)
    assert known.stage.axes() is None
    assert value_of(known.body.model, "noise") > 0.0


def shortened(name, tmp_path, rows):
    lines = (CONTACT / f"{name}.csv").read_text().splitlines()
    path = tmp_path / f"{name}.csv"
    path.write_text("\n".join(lines[: rows + 1]) + "\n")
    return str(path)


@pytest.mark.slow
@pytest.mark.skipif(not CONTACT.is_dir(), reason="no records of others' rigs with contact here")
def test_from_the_command_line_a_rig_with_contact_tells_what_changed_and_gets_a_model_with_it(
    tmp_path, monkeypatch, capsys
):
    was = shortened("reference", tmp_path, 3000)
    now = shortened("drops-friction", tmp_path, 2000)
    arguments = ("--model", str(CONTACT / "model"), "--reference", was, "-o", str(tmp_path / "out"), "--json")
    code, out, err = call(monkeypatch, capsys, "diagnose", now, *arguments)
    assert code == 0, err
    done = json.loads(out)
    assert done["verdict"] == "effect_found"
    (effect,) = done["effects"]
    assert effect["name"] == "dry_friction"
    assert effect["planned"] is True
    value, before = effect["parameters"]["coefficient"]["value"], effect["known_before"]["coefficient"]
    assert value / before == pytest.approx(3.0, rel=0.15)
    assert done["after"]["rollout40"] < 0.5 * done["before"]["rollout40"]
    assert done["remaining"] < 1.3
    assert set(done["rings"]) == {"1", "2", "3", "4"}
    there = done["rings"]["4"]["effects"][0]["parameters"]["coefficient"]["value"]
    radii = [MAZE.track_radius(ring) for ring in (1, 4)]
    assert there * radii[1] == pytest.approx(
        done["rings"]["1"]["effects"][0]["parameters"]["coefficient"]["value"] * radii[0]
    )
    old, new = load_model(CONTACT / "model"), load_model(done["model"])
    moved = [m.ball(1).parameter("dry_friction", "coefficient", 0.0) for m in (old, new)]
    assert moved[1] > moved[0] + 0.5


@pytest.mark.parametrize(("option", "value"), [("--ring", "2"), ("--declare", "dry_friction.coefficient=0.4")])
def test_options_of_one_ring_are_refused_beside_a_reference(monkeypatch, capsys, option, value):
    code, out, err = call(monkeypatch, capsys, "diagnose", "now.csv", "--reference", "was.csv", option, value)
    assert (code, out) == (2, "")
    assert err.startswith(f"mazeplan: {option}: got ")
    assert "--reference" in err


def test_a_reference_that_is_not_there_is_told_by_name(monkeypatch, capsys, tmp_path):
    now = tmp_path / "now.csv"
    now.write_text("t,x,y,beta,gamma,u_beta,u_gamma\n0,0.08,0,0,0,0,0\n0.0333,0.08,0,0,0,0,0\n")
    code, out, err = call(monkeypatch, capsys, "diagnose", str(now), "--reference", str(tmp_path / "was.csv"))
    assert (code, out) == (2, "")
    assert "was.csv" in err
