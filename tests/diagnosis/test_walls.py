"""Walls, their gates and a camera off the centre are named by a record of smoothed accelerations without commands."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import pytest
from plant import play
from ring_records import DECLARED

from mazeplan.core.logs.table import Table, read_table
from mazeplan.diagnosis.record import record_of, turned_round
from mazeplan.diagnosis.ring.camera import seen_angle, true_angle, true_angle_slope
from mazeplan.diagnosis.ring.diagnose import diagnose
from mazeplan.diagnosis.ring.scores import MATCHED, seen_and_held
from mazeplan.diagnosis.ring.system import ring_library
from mazeplan.diagnosis.ring.windows import spread_of, weights_of
from mazeplan.learning.smoothing import derivatives
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.effects.ball import surface_ripple, wall_friction
from mazeplan.physics.effects.openings import Openings, closer_library, wall_library
from mazeplan.physics.formulas.compiled import term_functions
from mazeplan.physics.formulas.symbols import INPUTS
from mazeplan.physics.registry import EFFECTS
from mazeplan.run.commands.diagnose_mechanism import ring_openings

QUARTERS = tuple(0.5 * math.pi * i for i in range(4))
RADIUS = 0.0689


def smoothed_record(seconds=240.0, seed=3, **what):
    """As a rig tells it that keeps neither commands nor radius, and smooths its accelerations."""
    columns = play(seed=seed, seconds=seconds, radius=RADIUS, camera=2e-5, sensor=2e-4, **what)
    theta = np.unwrap(columns["theta"])
    found = derivatives(theta, 1.0 / 30.0, MATCHED)
    bare = {name: columns[name] for name in ("t", "beta", "gamma")}
    return record_of(Table({**bare, "theta": theta, "theta_ddot": found.acceleration}))


def of_effect(effect, what, theta, rate, values, **told):
    """A function of one effect at a state; told: inputs by name, the others nought."""
    w = [told.get(name, 0.0) for name in INPUTS]
    return term_functions(effect).vectorised(np)[what](theta, rate, 0.0, w, list(values))


def test_a_ball_is_pressed_outwards_by_its_turning_and_by_the_tilt():
    x, v, tilt = 0.7, 2.0, {"beta": 0.03, "gamma": -0.02, "radius": RADIUS}
    expected = v * v + 5 / 9 * 9.81 / RADIUS * (math.sin(0.03) * math.cos(x) + math.sin(0.02) * math.sin(x))
    assert of_effect(wall_friction, "hold", x, v, [0.3], **tilt) == pytest.approx(0.3 * expected, rel=1e-12)
    outer, inner = wall_library(Openings(QUARTERS, QUARTERS))
    lost = [of_effect(gates, "loss", x, v, [0.0, 1.0], **tilt) for gates in (outer, inner)]
    assert lost[0] > 0.9
    assert lost[1] == pytest.approx(1.0 - lost[0])


def test_ripples_are_harmonics_from_the_fourth_on():
    p = np.arange(1.0, 13.0)
    expected = sum(p[2 * i] * math.cos((4 + i) * 0.3) + p[2 * i + 1] * math.sin((4 + i) * 0.3) for i in range(6))
    assert of_effect(surface_ripple, "term", 0.3, 0.0, p) == pytest.approx(expected, rel=1e-12)


def test_a_camera_off_the_centre_bends_angles_and_back():
    phi = np.linspace(-7.0, 7.0, 200)
    offset = (0.004, -0.007)
    x, y = offset[0] + RADIUS * np.cos(phi), offset[1] + RADIUS * np.sin(phi)
    seen = seen_angle(phi, RADIUS, offset)
    assert np.allclose(np.exp(1j * seen), (x + 1j * y) / np.hypot(x, y))
    assert np.allclose(true_angle(seen, RADIUS, offset), phi)
    slope = (true_angle(seen + 1e-6, RADIUS, offset) - true_angle(seen - 1e-6, RADIUS, offset)) / 2e-6
    assert np.allclose(true_angle_slope(seen, RADIUS, offset), slope, rtol=1e-6)


def test_gates_of_a_wall_are_looked_for_within_one_period():
    outer, inner = wall_library(Openings(outer=QUARTERS, inner=(1.0,)))
    assert max(abs(start[0]) for start in outer.starts) < math.pi / 4
    assert max(abs(start[0]) for start in inner.starts) > 3.0
    assert (outer.side, inner.side) == (1.0, -1.0)
    assert wall_library(Openings()) == []


def test_long_tails_do_not_widen_the_spread():
    rng = np.random.default_rng(1)
    e = rng.standard_normal(4000)
    e[::50] += 40.0
    assert spread_of(e) < 1.3
    assert weights_of(np.array([0.0, 40.0]), 1.0)[1] < 0.01


@pytest.mark.slow
def test_records_in_pieces_hold_out_blocks_all_over():
    whole = smoothed_record(60.0)
    rows, held, words = seen_and_held(whole)
    assert not rows[held].any()
    assert held[-1]
    assert not held[: len(held) // 2].any()
    assert "last 30%" in words
    table = Table(
        {
            "t": whole.t,
            "theta": whole.theta,
            "beta": whole.beta,
            "gamma": whole.gamma,
            "segment": np.arange(1800.0) // 300.0,
        }
    )
    rows, held, words = seen_and_held(record_of(table))
    assert not rows[held].any()
    assert held[: len(held) // 2].any()
    assert held[len(held) // 2 :].any()
    assert "blocks" in words


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "name", "parameter", "true"),
    [
        ({"gates": (1.0, 0.3, 0.4)}, "outer_gates", "loss", 0.4),
        ({"gates": (-1.0, 0.3, 0.5)}, "inner_gates", "loss", 0.5),
        ({"wall": 0.1}, "wall_friction", "coefficient", 0.1),
        ({"camera_offset": (0.003, -0.002)}, "camera_offset", "x", 0.003),
    ],
    ids=lambda x: x if isinstance(x, str) else None,
)
def test_walls_gates_and_camera_are_named(what, name, parameter, true):
    gates = Openings(outer=QUARTERS, inner=tuple(a + math.pi / 4 for a in QUARTERS))
    done = diagnose(smoothed_record(75.0, **what), RADIUS, DECLARED, openings=gates)
    assert name in [e["name"] for e in done.effects], done.sentence()
    assert len(done.effects) <= 2, done.sentence()
    found = next(e for e in done.effects if e["name"] == name)["parameters"][parameter]
    assert found["value"] == pytest.approx(true, abs=max(5.0 * found["stderr"], 0.1 * abs(true)))
    assert done.after.nrmse < done.before.nrmse
    if "gates" in what:
        rotation = next(e for e in done.effects if e["name"] == name)["parameters"]["rotation"]["value"]
        at = 0.3 if name == "outer_gates" else 0.3 - math.pi / 4
        off = (rotation - at + math.pi / 4) % (math.pi / 2) - math.pi / 4
        assert abs(off) < 0.05


def test_every_candidate_of_a_ring_is_an_effect_that_can_be_listed():
    walls = Openings(QUARTERS, QUARTERS)
    for c in (*ring_library(), *wall_library(walls), *closer_library(walls)):
        assert c.name in EFFECTS, c.name
        known = EFFECTS[c.name].parameters
        assert all(known[key].unit == p.unit for key, p in c.parameters.items() if key in known), c.name


DATA = Path(os.environ.get("MAZEPLAN_DATA", Path(__file__).parents[3] / "shared" / "data")) / "cme-rig"


@pytest.mark.slow
@pytest.mark.skipif(not (DATA / "ring4.csv").exists(), reason="the measured tables of the rig are not on this machine")
def test_the_measured_rig_rolls_on_floor_and_wall_and_its_camera_is_off():
    maze = load_map("cme")
    table, odd = turned_round(read_table(DATA / "ring4.csv"), maze.track_radius(4))
    record = record_of(table, np.arange(len(table)) < 0.6 * len(table), odd)  # more takes minutes
    done = diagnose(record, maze.track_radius(4), {}, openings=ring_openings(maze, 4))
    names = {e["name"]: e["parameters"] for e in done.effects}
    assert {"rolling_inertia", "wall_friction", "camera_offset", "outer_edges"} <= set(names), done.sentence()
    assert names["rolling_inertia"]["factor"]["value"] == pytest.approx(5 / 9, abs=0.05)
    assert names["camera_offset"]["y"]["value"] == pytest.approx(0.007, abs=0.001)
    assert done.after.nrmse < 0.5 < 1.2 < done.before.nrmse
