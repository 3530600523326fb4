"""A rig's model that learns: what it takes from a run, whose friction it finds, when it does not trust itself."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mazeplan.control.estimation.rigid_body_parameters import body_of
from mazeplan.core.errors import InputError, ModelError, SettingsError
from mazeplan.core.logs.table import Table
from mazeplan.learning.modelfile import RigModel, load_model, save_model
from mazeplan.learning.online_folder import ROWS, read_online, write_online
from mazeplan.learning.online_rig import ENDS, PACES, WATCHED, OnlineModel, OnlineOptions, accelerations
from mazeplan.learning.samples import SampleOptions, ring_samples
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effects.ball import quadratic_drag

MAZE = load_map("cme")
QUICK = OnlineOptions(most=150)


@pytest.fixture(scope="module")
def toy():
    """The packaged model with few rows, so that tests are quick."""
    model = load_model("toy")
    small = {}
    for ring, p in model.processes.items():
        small[ring] = replace(p, inputs=p.inputs[::8], features=p.features[::8], alpha=p.alpha[::8])
    return replace(model, processes=small, camera_delay=0.0)


def driven(model, seconds=4.0, seed=0, more_dry=0.0, noise=0.0) -> Table:
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
    seen = theta[::10] + noise * rng.standard_normal(len(theta[::10])) / radius
    x, y = radius * np.cos(seen), radius * np.sin(seen)
    return Table({
        "t": t[::10], "x": x, "y": y, "theta": np.arctan2(y, x), "r": np.hypot(x, y), "beta": tilts[0][::10],
        "gamma": tilts[1][::10],
    })  # fmt: skip


def dry_of(model, ring=1):
    return model.ball(ring).parameter("dry_friction", "coefficient", 0.0) * MAZE.track_radius(ring)


def test_before_the_first_run_it_is_the_model_as_it_was(toy):
    online = OnlineModel(toy, MAZE)
    assert online.model is toy
    for ring, process in toy.processes.items():
        np.testing.assert_allclose(online.learned.processes[ring].alpha, process.alpha, atol=1e-8)
    assert [dry_of(online.learned, r) for r in range(1, 5)] == pytest.approx([dry_of(toy, r) for r in range(1, 5)])


@pytest.mark.parametrize("kind", ["sp", "pi"])
def test_more_friction_is_found_at_once_and_kept(toy, kind):
    effects = toy if kind == "sp" else replace(toy, kind="pi", processes={})
    # the ball of this test obeys the effects alone; a process that says otherwise is for others to find
    quiet = {ring: replace(p, alpha=0.0 * p.alpha) for ring, p in effects.processes.items()}
    online = OnlineModel(replace(effects, processes=quiet), MAZE, QUICK)
    lessons = [online.learn(driven(toy, seed=run, more_dry=0.15 if run > 2 else 0.0)) for run in range(1, 6)]
    assert [lesson.run for lesson in lessons] == [1, 2, 3, 4, 5]
    assert all(list(lesson.rows) == [1] and not lesson.why for lesson in lessons)
    assert online.learned.kind == "sp"
    slow, _, fast = (pace for pace, _ in PACES)
    assert [lesson.pace for lesson in lessons] == [slow, slow, fast, slow, slow]
    assert dry_of(online.learned) - dry_of(toy) == pytest.approx(0.15, abs=0.04)
    assert [lesson.error < 0.2 * lesson.fixed for lesson in lessons[2:]] == [False, True, True]
    disc = [m.ball(5).parameter("dry_friction", "coefficient", 0.0) for m in (toy, online.learned)]
    assert disc[1] == disc[0]  # the nearest ring, 4, was not seen: nothing is known of it
    assert len(online.rings[1]) <= 150


def test_the_rigid_body_stays_with_what_is_learned(toy):
    online = OnlineModel(toy, MAZE, QUICK)
    online.learn(driven(toy, more_dry=0.15))
    was, now = body_of(toy), body_of(online.learned)
    assert dry_of(online.learned) != dry_of(toy)
    assert was is not None
    assert now == was
    other = replace(toy, body=replace(toy.body, of="of other effects"))
    assert body_of(OnlineModel(other, MAZE, QUICK).learned) is None


def test_a_disc_changes_as_the_nearest_ring_does(toy):
    online = OnlineModel(toy, MAZE, QUICK)
    rows = online.rings[4]
    x, n = np.tile(rows.inputs[:1], (60, 1)), 60
    features = np.zeros((n, 5))
    features[:, 2] = -1.0
    online.rings[4] = rows.added(x, features, np.full(n, -0.05 / MAZE.track_radius(4)), np.ones(n))
    online.now, online.clock = 1, 1.0
    changed = dry_of(online.learned, 4) - dry_of(toy, 4)
    assert changed > 0.005
    place = MAZE.ring(5)
    reach = max(place.track_radius, 0.5 * place.outer_radius)
    disc = [m.ball(5).parameter("dry_friction", "coefficient", 0.0) * reach for m in (toy, online.learned)]
    assert disc[1] - disc[0] == pytest.approx(changed)


def test_rows_are_those_of_learn_without_rest_and_ends_of_stretches(toy):
    table = driven(toy, seed=3)
    samples = ring_samples(table, MAZE, None, SampleOptions(recompute=True))[1]
    online = OnlineModel(toy, MAZE, QUICK)
    taken = online.learn(table).rows[1]
    stretches = len(np.unique(samples.segment))
    assert len(samples) - 2 * ENDS * stretches - 40 < taken <= len(samples) - 2 * ENDS * stretches
    still = Table({**table.columns, **{k: np.full(len(table), table[k][0]) for k in ("x", "y", "theta", "r")}})
    assert "not seen moving" in online.learn(still).why


def test_camera_and_tilt_sensor_are_put_right_first(toy):
    table, camera = driven(toy, seed=4), replace(toy.camera, offset_x=0.004, offset_y=-0.003, angle=0.05)
    c, s = math.cos(0.05), math.sin(0.05)
    x = c * table["x"] - s * table["y"] + 0.004
    y = s * table["x"] + c * table["y"] - 0.003
    wrong = {"x": x, "y": y, "theta": np.arctan2(y, x), "r": np.hypot(x, y), "beta": 1.1 * table["beta"]}
    sensor = replace(toy.tilt_sensor, gain_beta=1.1)
    lessons = [
        OnlineModel(toy, MAZE, QUICK).learn(table),
        OnlineModel(replace(toy, camera=camera, tilt_sensor=sensor), MAZE, QUICK).learn(
            Table({**table.columns, **wrong})
        ),
    ]
    assert lessons[1].error == pytest.approx(lessons[0].error, rel=1e-3)
    assert lessons[1].rows == lessons[0].rows


def test_impacts_are_left_out(toy):
    table = driven(toy, seed=5)
    kicked = table["theta"].copy()
    kicked[60:] += 0.4
    hit = {"theta": kicked, "x": table["r"] * np.cos(kicked), "y": table["r"] * np.sin(kicked)}
    assert OnlineModel(toy, MAZE, QUICK).learn(Table({**table.columns, **hit})).impacts > 0


def test_where_it_predicts_worse_than_the_first_model_that_one_is_used_until_it_does_not(toy):
    online = OnlineModel(toy, MAZE, QUICK)
    online.learn(driven(toy, seed=6))
    assert online.trusted
    for _ in range(WATCHED):
        online.watched.append((3.0, 1.0))
    assert online.model is toy
    assert online.learned is not toy
    for _ in range(WATCHED):
        online.watched.append((1.0, 3.0))
    assert online.model is not toy


def test_a_record_that_is_no_number_or_too_short_changes_nothing(toy):
    online = OnlineModel(toy, MAZE, QUICK)
    online.learn(driven(toy, seed=7))
    before = {ring: rows.alpha for ring, rows in online.rings.items()}
    table = driven(toy, seed=8)
    broken = Table({**table.columns, "beta": np.full(len(table), np.nan)})
    short = Table({name: column[:6] for name, column in table.columns.items()})
    for bad in (broken, short):
        assert online.learn(bad).why
    for ring, rows in online.rings.items():
        np.testing.assert_array_equal(rows.alpha, before[ring])
    assert online.now == 3


def test_effects_that_nothing_is_learned_of_stay(toy):
    drag = quadratic_drag(0.02)
    balls = {ring: BallModel((*ball.effects, drag), ball.stderr) for ring, ball in toy.balls.items()}
    online = OnlineModel(replace(toy, balls=balls), MAZE, QUICK)
    online.learn(driven(toy, seed=9))
    assert all(ball.effects.count(drag) == 1 for ball in online.learned.balls.values())


def test_a_process_alone_learns_too(toy):
    online = OnlineModel(replace(toy, kind="np"), MAZE, QUICK)
    table = driven(toy, seed=10)
    first = online.learn(table)
    samples = ring_samples(table, MAZE, None, SampleOptions(recompute=True))[1]
    k = samples.at(samples.good)
    off = [
        np.sqrt(np.mean((samples.theta_ddot[samples.good] - accelerations(m, 1, k)) ** 2))
        for m in (online.start, online.learned)
    ]
    assert not first.why
    assert off[1] < 0.8 * off[0]
    assert online.learned.balls == online.start.balls


def test_textbook_physics_cannot_learn_and_say_what_to_do(toy):
    with pytest.raises(InputError, match="collect"):
        OnlineModel(RigModel.nominal(MAZE), MAZE)
    known = replace(RigModel.nominal(MAZE), camera_delay=0.02)
    assert not OnlineModel(known, MAZE).learn(driven(toy, seed=11)).why


@pytest.mark.parametrize("wrong", [{"dry": -1.0}, {"process": math.nan}, {"most": 0}, {"keep": "best"}])
def test_options_are_checked(wrong):
    with pytest.raises(SettingsError, match=next(iter(wrong))):
        OnlineOptions(**wrong)


def test_it_is_kept_in_a_file_and_goes_on_as_if_it_had_never_stopped(toy, tmp_path):
    save_model(toy, tmp_path / "start")
    one = OnlineModel(load_model(tmp_path / "start"), MAZE, QUICK)
    for run in range(3):
        one.learn(driven(toy, seed=run, more_dry=0.04))
    write_online(one, tmp_path)
    other = read_online(tmp_path, MAZE, QUICK)
    assert (other.now, other.clock, list(other.watched)) == (one.now, one.clock, list(one.watched))
    for online in (one, other):
        online.learn(driven(toy, seed=20, more_dry=0.04))
    for ring in one.rings:
        np.testing.assert_allclose(other.rings[ring].alpha, one.rings[ring].alpha, rtol=1e-7, atol=1e-8)
    assert dry_of(other.model) == pytest.approx(dry_of(one.model), rel=1e-8)


def test_a_file_that_does_not_fit_is_refused_in_one_line(toy, tmp_path):
    save_model(toy, tmp_path / "start")
    write_online(OnlineModel(toy, MAZE, QUICK), tmp_path)
    path = tmp_path / ROWS
    whole = path.read_bytes()
    with np.load(path) as held:
        arrays = {name: held[name] for name in held.files}
    spoilt = {
        "nan": {"ring1_y": np.full_like(arrays["ring1_y"], np.nan)}, "short": {"ring2_age": arrays["ring2_age"][:-1]},
        "later": {"ring3_age": arrays["ring3_age"] + 5.0}, "format": {"format": np.array(9)},
        "text": {"ring4_inputs": np.array(["x"])}, "runs": {"watched": np.array([[np.nan, 1.0]])},
        "clock": {"clock": np.array(-1.0)},
    }  # fmt: skip
    for change in spoilt.values():
        np.savez(path, **{**arrays, **change})
        with pytest.raises(ModelError) as problem:
            read_online(tmp_path, MAZE)
        assert "\n" not in str(problem.value)
    del arrays["ring1_inputs"]
    np.savez(path, **arrays)
    for content in (path.read_bytes(), whole[: len(whole) // 2], b"", b"not a file of arrays"):
        path.write_bytes(content)
        with pytest.raises(ModelError, match=ROWS):
            read_online(tmp_path, MAZE)
