"""The filter of a ball with a body, and what a record tells of it: on a simulated table whose physics are others'."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from mazeplan.control.estimation.rigid_body_filter import BodyFilter
from mazeplan.control.estimation.rigid_body_fit import autocorrelation, fit_body, with_values
from mazeplan.core.errors import TableError
from mazeplan.core.logs.table import Table, read_table
from mazeplan.diagnosis.rig.record import body_filter, first_guess
from mazeplan.learning.modelfile import load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig
from mazeplan.run.collect import Collection, run_collection

MAZE = load_map("cme")
DATA = Path(os.environ.get("MAZEPLAN_DATA", Path(__file__).parents[3] / "shared" / "data")) / "contact" / "A"
ROLLING = 5e-5 / MAZE.ball.radius * 9.81  # m/s^2, of the toy
DELAY = 2.0 / 30.0 - 0.5 / 600.0  # s, of the toy; half a step of MuJoCo, by which its ball is ahead of its forces
LATE = 2.5e-3  # s; six records of 180 s with other noise: 1.4 ms too short on average, and scatter by 1.0 ms


WHITE = 0.06  # autocorrelation of innovations up to which only noise is left


def fitted(table, model):
    """The filter of a record, and the numbers of the ball that fit it."""
    body, _ = body_filter(table, MAZE)
    return SimpleNamespace(body=body, fit=fit_body(body, first_guess(model, MAZE)))


def collected(path, seconds):
    """A log of the toy."""
    run_collection(make_rig("toy", MAZE), MAZE, Collection(seconds, (1, 2, 3, 4), 3, None, 1.5), path, rig_name="toy")
    return path


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return collected(tmp_path_factory.mktemp("toy") / "toy.mcap", 180.0)


@pytest.fixture(scope="module")
def seen(log):
    return fitted(read_table(log), load_model("toy"))


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A record of 45 s: too short to tell small values, long enough for a filter."""
    return read_table(collected(tmp_path_factory.mktemp("short") / "toy.mcap", 45.0))


@pytest.fixture(scope="module")
def briefly(short):
    return fitted(short, load_model("toy"))


def near(seen, name, true, least):
    value, stderr = seen.fit.value(name), seen.fit.stderr[name]
    return value == pytest.approx(true, abs=max(4.0 * stderr, least))


@pytest.mark.slow
def test_a_record_of_the_toy_gives_its_parameters(seen):
    """MuJoCo's ball: the rig says what is true, none of which the fit was told."""
    assert near(seen, "noise", 5e-4, 2e-5)
    assert near(seen, "delay", DELAY, LATE)
    assert near(seen, "tilt_beta", math.radians(0.15), 5e-4)
    assert near(seen, "tilt_gamma", math.radians(0.3), 6e-4)
    assert near(seen, "rolling", ROLLING, 8e-3)
    assert near(seen, "wall", 0.3, 0.05)
    assert autocorrelation(seen.fit.filtered) == pytest.approx(np.zeros(3), abs=WHITE)
    assert seen.fit.filtered.left_out < 0.01 * len(seen.body.pictures)


@pytest.mark.slow
def test_a_wrong_body_leaves_a_memory_behind(seen):
    wrong = with_values(seen.fit.model, {"wall": 0.0, "inertia": 0.05, "tilt_beta": 0.02, "plane": 1e-6})
    assert max(autocorrelation(seen.body.run(wrong))) > 2.0 * WHITE


@pytest.mark.slow
def test_lost_pictures_are_bridged(briefly):
    body, rng = briefly.body, np.random.default_rng(1)
    y = body.pictures.y.copy()
    y[rng.random(len(y)) < 0.2] = math.nan
    poor = BodyFilter(replace(body.pictures, y=y), body.plate, body.walls).run(briefly.fit.model)
    whole = body.run(briefly.fit.model)
    assert poor.starts <= whole.starts + 2
    counted, before = (int(np.isfinite(f.nu[:, 0]).sum()) for f in (poor, whole))
    assert counted > 0.75 * before
    assert np.mean(poor.whitened() ** 2) == pytest.approx(1.0, abs=0.1), "as sure as it says"


@pytest.mark.slow
def test_it_goes_on_by_itself_as_the_ball_does(briefly):
    """A second ahead: most windows end within 15 mm of where the camera sees the ball."""
    model, body = briefly.fit.model, briefly.body
    state = body.run(model).state
    starts = np.arange(300, len(body.pictures) - 40, 25)
    rolled, y = body.rolled_out(model, state, starts, 30), body.pictures.y
    off = np.hypot(*(rolled[:, -1] - y[starts + 30]).T)
    whole = [not body.pictures.begins[s + 1 : s + 31].any() for s in starts.tolist()]
    assert np.nanmedian(off[np.array(whole)]) < 0.015
    assert np.nanmedian(np.hypot(*(rolled[:, 2] - y[starts + 2]).T)) < 1.5e-3


def test_a_model_of_beads_is_where_the_fit_begins():
    toy = load_model("toy")
    guess = first_guess(toy, MAZE)
    assert guess.view.delay == toy.camera_delay
    assert guess.tilting.tilt_gamma == toy.ball(1).parameter("tilt_offset", "gamma", 0.0)
    assert 0.03 < guess.ball.rolling < 0.3
    assert first_guess(None, MAZE).view.delay == 0.06
    assert first_guess(replace(toy, camera_delay=-0.05), MAZE).view.delay == -0.05  # of a late tilt sensor


def test_records_that_tell_nothing_are_refused(short):
    with pytest.raises(TableError, match="got a table without x and y"):
        body_filter(Table({name: short[name] for name in ("t", "theta", "beta", "gamma")}), MAZE)
    few = Table({name: short[name][:600] for name in ("t", "x", "y", "beta", "gamma", "u_beta", "u_gamma")})
    with pytest.raises(TableError, match="pictures of the ball, expected 900 at least"):
        body_filter(few, MAZE)


@pytest.mark.slow
@pytest.mark.skipif(not DATA.is_dir(), reason="no records of others' rigs with contact here")
def test_friction_of_another_rig_is_found():
    table = read_table(DATA / "friction.csv")
    table = Table({name: column[:4500] for name, column in table.columns.items()})
    seen = fitted(table, load_model(DATA / "model"))
    assert autocorrelation(seen.fit.filtered) == pytest.approx(np.zeros(3), abs=WHITE)
    assert near(seen, "rolling", 12e-5 / MAZE.ball.radius * 9.81, 3e-3)  # three times what it was
    assert near(seen, "wall", 0.22, 0.02)
    assert near(seen, "tilt_beta", math.radians(0.15), 5e-4)


def test_hitting_or_missing_an_edge_does_not_make_the_likelihood_jump(briefly):
    fit = briefly.fit
    there = fit.value("rolling") + np.linspace(-4e-3, 4e-3, 41)
    minus2 = [briefly.body.innovations(with_values(fit.model, {"rolling": value})).minus2 for value in there]
    assert np.max(np.abs(np.diff(minus2, n=2))) < 35.0  # 55 without the noise at edges
    assert np.ptp(minus2) > 1.0
