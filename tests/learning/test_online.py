"""A rig's model that learns: whose friction it finds, what it leaves out, when it trusts itself, what it keeps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mazeplan.control.estimation.rigid_body_parameters import body_of
from mazeplan.core.errors import InputError, ModelError
from mazeplan.core.logs.table import Table
from mazeplan.learning.modelfile import RigModel, load_model
from mazeplan.learning.online import STATE, WATCHED, OnlineModel, open_online, save_online
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")


@pytest.fixture(scope="module")
def toy():
    """The effects of the packaged model; the ball of these tests obeys them alone."""
    return replace(load_model("toy"), camera_delay=0.0, kind="pi", processes={})


def driven(model, seconds=4.0, seed=0, more_dry=0.0) -> Table:
    """A ball that goes round ring 1 as the effects of the model say, with more dry friction (m/s^2), as a table."""
    rate, rng, ball = 300, np.random.default_rng(seed), model.ball(1)
    radius = MAZE.track_radius(1)
    n = int(seconds * rate)
    t = np.arange(n) / rate
    swing = rng.uniform(0.0, 2.0 * math.pi, 6)
    tilts = [
        sum(0.025 * np.sin(2.0 * math.pi * (0.25 + 0.2 * i) * t + swing[3 * a + i]) for i in range(3)) for a in (0, 1)
    ]
    factor = ball.parameter("rolling_inertia", "factor", 1.0)
    viscous = ball.parameter("viscous_friction", "coefficient", 0.0)
    dry = ball.parameter("dry_friction", "coefficient", 0.0) + more_dry / radius
    offset = [ball.parameter("tilt_offset", axis, 0.0) for axis in ("beta", "gamma")]
    theta, speed = np.empty(n), 1.5
    theta[0] = 0.3
    for i in range(n - 1):
        b, g = tilts[0][i] + offset[0], tilts[1][i] + offset[1]
        pull = -factor * 9.81 / radius * (math.sin(b) * math.sin(theta[i]) + math.sin(g) * math.cos(theta[i]))
        speed += (pull - viscous * speed - dry * math.tanh(speed / 0.1)) / rate
        theta[i + 1] = theta[i] + speed / rate
    seen = theta[::10]
    x, y = radius * np.cos(seen), radius * np.sin(seen)
    return Table({
        "t": t[::10], "x": x, "y": y, "theta": np.arctan2(y, x), "r": np.hypot(x, y), "beta": tilts[0][::10],
        "gamma": tilts[1][::10],
    })  # fmt: skip


def dry_of(model, ring=1):
    return model.ball(ring).parameter("dry_friction", "coefficient", 0.0) * MAZE.track_radius(ring)


def test_more_friction_is_found_in_a_few_runs_and_kept(toy):
    online = OnlineModel(toy, MAZE)
    assert online.model is toy
    lessons = [online.learn(driven(toy, seed=run, more_dry=0.15 if run > 2 else 0.0)) for run in range(1, 9)]
    assert [lesson.run for lesson in lessons] == list(range(1, 9))
    assert all(list(lesson.rows) == [1] and not lesson.why for lesson in lessons)
    assert dry_of(online.learned) - dry_of(toy) == pytest.approx(0.15, abs=0.04)
    assert lessons[-1].error < 0.3 * lessons[-1].fixed
    assert dry_of(online.learned, 3) == dry_of(toy, 3)  # nothing was seen of the other rings
    assert body_of(online.learned) == body_of(toy)


def test_a_disc_changes_as_the_nearest_ring_does(toy):
    online = OnlineModel(toy, MAZE)
    online.now = 1
    online.rings[4] = replace(online.rings[4], weights=np.array([0.0, 0.0, 0.05 / MAZE.track_radius(4), 0.0, 0.0]))
    place = MAZE.ring(5)
    reach = place.track_radius or 0.5 * place.outer_radius
    disc = [m.ball(5).parameter("dry_friction", "coefficient", 0.0) * reach for m in (toy, online.learned)]
    assert disc[1] - disc[0] == pytest.approx(0.05)


def test_camera_and_tilt_sensor_are_put_right_first(toy):
    table, camera = driven(toy, seed=4), replace(toy.camera, offset_x=0.004, offset_y=-0.003, angle=0.05)
    c, s = math.cos(0.05), math.sin(0.05)
    x = c * table["x"] - s * table["y"] + 0.004
    y = s * table["x"] + c * table["y"] - 0.003
    wrong = {"x": x, "y": y, "theta": np.arctan2(y, x), "r": np.hypot(x, y), "beta": 1.1 * table["beta"]}
    off = replace(toy, camera=camera, tilt_sensor=replace(toy.tilt_sensor, gain_beta=1.1))
    plain, corrected = OnlineModel(toy, MAZE).learn(table), OnlineModel(off, MAZE)
    lesson = corrected.learn(Table({**table.columns, **wrong}))
    assert lesson.error == pytest.approx(plain.error, rel=1e-3)
    assert lesson.rows == plain.rows


def test_impacts_and_a_ball_at_rest_are_left_out(toy):
    table = driven(toy, seed=5)
    kicked = table["theta"].copy()
    kicked[60:] += 0.4
    hit = {"theta": kicked, "x": table["r"] * np.cos(kicked), "y": table["r"] * np.sin(kicked)}
    taken = [OnlineModel(toy, MAZE).learn(Table({**table.columns, **more})).rows[1] for more in ({}, hit)]
    assert taken[1] < taken[0]
    still = {name: np.full(len(table), table[name][0]) for name in ("x", "y", "theta", "r")}
    assert OnlineModel(toy, MAZE).learn(Table({**table.columns, **still})).why


def test_where_it_predicts_worse_than_the_first_model_that_one_is_used_until_it_does_not(toy):
    online = OnlineModel(toy, MAZE)
    online.learn(driven(toy, seed=6))
    for errors, first in (((3.0, 1.0), True), ((1.0, 3.0), False)):
        online.watched.extend([errors] * WATCHED)
        assert (online.model is toy) is first


def test_a_record_that_is_no_number_or_too_short_changes_nothing(toy):
    online, table = OnlineModel(toy, MAZE), driven(toy, seed=8)
    broken = Table({**table.columns, "beta": np.full(len(table), np.nan)})
    short = Table({name: column[:6] for name, column in table.columns.items()})
    before = dict(online.rings)
    assert all(online.learn(bad).why for bad in (broken, short))
    assert (online.rings, online.now) == (before, 2)


def test_models_without_effects_or_delay_cannot_learn(toy):
    packaged = load_model("toy")
    for model, advice in ((RigModel.nominal(MAZE), "collect"), (replace(packaged, kind="np"), "kind np")):
        with pytest.raises(InputError, match=advice):
            OnlineModel(model, MAZE)
    known = replace(RigModel.nominal(MAZE), camera_delay=0.02)
    assert not OnlineModel(known, MAZE).learn(driven(toy, seed=11)).why


def test_it_is_kept_and_goes_on_as_if_it_had_never_stopped(tmp_path):
    start = load_model("toy")
    one = OnlineModel(start, MAZE)
    for run in range(2):
        one.learn(driven(start, seed=run, more_dry=0.04))
    save_online(one, tmp_path, "toy")
    other = open_online(tmp_path, MAZE, "toy")
    lessons = [online.learn(driven(start, seed=20, more_dry=0.04)) for online in (one, other)]
    assert lessons[0].error == pytest.approx(lessons[1].error, rel=1e-3)
    assert dry_of(other.model) == pytest.approx(dry_of(one.model), rel=1e-3)
    assert load_model(tmp_path).kind == "sp"
    for maze, rig in ((load_map("lopsided"), "toy"), (MAZE, "ideal")):
        with pytest.raises(InputError, match="has learned on"):
            open_online(tmp_path, maze, rig)
    for text in ("", "{}", (tmp_path / STATE).read_text().replace('"format": 1', '"format": 9')):
        (tmp_path / STATE).write_text(text)
        with pytest.raises(ModelError, match=STATE):
            open_online(tmp_path, MAZE, "toy")
