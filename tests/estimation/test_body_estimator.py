"""The estimator of a ball with a body: MuJoCo's toy, whose physics are its own, driven by waves of commands."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hidden_effects import write_hidden_rig

from mazeplan.control.estimation.delay_bank import DelayBank, estimator_for
from mazeplan.control.estimation.estimator import Estimator
from mazeplan.control.estimation.rigid_body_estimator import BodyEstimator
from mazeplan.control.estimation.rigid_body_fit import body_of, value_of, with_body
from mazeplan.core.errors import ModelError
from mazeplan.core.records import Command, Latency, Observation
from mazeplan.core.resources import PACKAGE
from mazeplan.learning.modelfile import RigModel, load_model, save_model
from mazeplan.learning.rigid_body_entries import KEPT, Body, stamp
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effects.ball import dry_friction
from mazeplan.physics.effects.local_forces import floor_ripple, floor_warp, table_swing
from mazeplan.physics.rig.stage import StageModel
from mazeplan.rigs.registry import make_rig

MAZE = load_map("cme")
FOUND = {  # in a record of 300 s of the toy
    "rolling": 0.0817, "spin": 0.0279, "wall": 0.311, "restitution": 0.497, "hold": 0.0096, "tilt_beta": 0.00268,
    "tilt_gamma": 0.0051, "delay": 0.0004, "noise": 5.1e-4, "plane": 4e-5, "strike": 0.012,
}  # fmt: skip


def bodied(values=FOUND):
    """The toy's model with this body."""
    toy = load_model("toy")
    return replace(toy, body=Body(dict(values), stamp(toy.balls)))


def command(t):
    return Command(0.05 * math.sin(2.1 * t) + 0.02 * math.sin(7.0 * t), 0.05 * math.cos(1.3 * t + 0.4))


def played(estimators, seconds=12.0, seed=0, spoilt=lambda k, seen: seen, rig="toy"):
    """Errors of place (m) and velocity (m/s) of each estimator, (N, E, 2)."""
    rig, errors = make_rig(rig, MAZE), []
    rig.reset(ring=2, theta=0.7, rng=np.random.default_rng(seed))
    try:
        for k in range(round(30 * seconds)):
            seen = spoilt(k, rig.observe())
            true = rig.truth()
            states = [e.update(seen) for e in estimators]
            there = true[:2] + estimators[0].acts_after * true[3:5]
            errors.append([
                (math.hypot(s.x - there[0], s.y - there[1]), math.hypot(s.vx - true[3], s.vy - true[4])) for s in states
            ])  # fmt: skip
            now = command(seen.t)
            rig.command(now.u_beta, now.u_gamma)
            for e in estimators:
                e.sent(now, seen.t)
    finally:
        rig.close()
    return np.array(errors)


def before_it_acts(estimator, tmp_path, late_s=0.06, seconds=12.0):
    """Errors of place (N,), m, where the ball is when a command that is sent now acts, late_s from now."""
    file = tmp_path / "late.yaml"
    file.write_text((PACKAGE / "rigs" / "toy.yaml").read_text() + f"command_delay_ms: {1e3 * late_s}\n")
    rig, said, was = make_rig(str(file), MAZE), [], []
    rig.reset(ring=2, theta=0.7, rng=np.random.default_rng(3))
    ahead = late_s * rig.rate_hz
    try:
        for _ in range(round(30 * seconds)):
            seen = rig.observe()
            was.append(rig.truth()[:2])
            state = estimator.update(seen)
            said.append((state.x, state.y))
            now = command(3.0 * seen.t)
            rig.command(now.u_beta, now.u_gamma)
            estimator.sent(now, seen.t)
    finally:
        rig.close()
    k = np.arange(30, len(was) - 3)
    whole, part = int(ahead), ahead - int(ahead)
    true = (1.0 - part) * np.array(was)[k + whole] + part * np.array(was)[k + whole + 1]
    return np.hypot(*(np.array(said)[k] - true).T)


@pytest.mark.slow
def test_a_late_command_is_predicted_with_the_body(tmp_path):
    model = bodied()
    stage = StageModel(*(replace(axis, dead_time=0.06) for axis in (model.stage.beta, model.stage.gamma)))
    bead, body = (np.median(before_it_acts(e, tmp_path)) for e in both(replace(model, stage=stage)))
    assert body < 0.6 * bead
    assert body < 1.2e-3


@pytest.mark.slow
def test_an_uneven_floor_is_predicted(tmp_path):
    rig = str(tmp_path / "rig.yaml")
    write_hidden_rig(Path(rig), "ripple", MAZE)
    settings = make_rig(rig, MAZE).settings
    n, crest, size = settings.ripple_waves, math.radians(settings.ripple_deg), settings.ripple_m_s2
    waves = floor_ripple(float(n), -size * math.sin(n * crest), size * math.cos(n * crest))
    flat = bodied()
    uneven = replace(flat, body=replace(flat.body, terms=(waves,)))
    errors = played([estimator_for(MAZE, flat), estimator_for(MAZE, uneven)], rig=rig)[30:]
    (blind, slow), (seeing, fast) = np.median(errors, axis=0)
    assert seeing < 0.85 * blind
    assert fast < 0.7 * slow


def both(model=None):
    model = model or bodied()
    return [Estimator(MAZE, replace(model, body=None)), estimator_for(MAZE, model)]


@pytest.mark.slow
def test_it_knows_place_and_speed_better_than_the_bead():
    errors = np.concatenate([played(both(), seed=seed)[30:] for seed in (0, 1)])
    (bead, speed), (body, faster) = np.median(errors, axis=0)
    assert body < 0.92 * bead
    assert faster < 0.85 * speed
    assert body < 0.7e-3
    worst, worse = np.quantile(errors, 0.95, axis=0)
    assert worse[0] < 1.05 * worst[0]


def test_lost_pictures_and_outliers_do_it_no_harm():
    def spoilt(k, seen):
        if 150 <= k < 156 or k % 17 == 0:
            return replace(seen, x=None, y=None)
        return replace(seen, x=0.0, y=0.05) if k % 41 == 0 else seen

    estimators = both()
    errors = played(estimators, spoilt=spoilt)[30:]
    assert np.median(errors[:, 1, 0]) < np.median(errors[:, 0, 0])
    assert np.quantile(errors[:, 1, 0], 0.9) < 4e-3
    assert estimators[1].doubts <= {"ball"}


def test_a_ball_that_is_somewhere_else_is_found_again():
    body = both()[1]
    for k in range(60):
        angle = 0.5 if k < 30 else 2.0
        r = MAZE.track_radius(1)
        state = body.update(Observation(k / 30.0, r * math.cos(angle), r * math.sin(angle), 0.0, 0.0))
        body.sent(Command(0.0, 0.0), k / 30.0)
    assert math.hypot(state.x - r * math.cos(2.0), state.y - r * math.sin(2.0)) < 2e-3
    for k in range(60, 90):
        state = body.update(Observation(k / 30.0, None, None, 0.0, 0.0))
    assert state.lost
    assert all(math.isfinite(value) for value in (state.x, state.y, state.vx, state.vy))


def test_a_body_belongs_to_the_rings_it_was_found_with():
    model = bodied()
    assert isinstance(estimator_for(MAZE, model), BodyEstimator)
    rubbed = replace(model, balls=model.balls | {2: BallModel((dry_friction(3.0),))})
    assert body_of(rubbed) is None
    assert type(estimator_for(MAZE, rubbed)) is Estimator
    assert type(estimator_for(MAZE, replace(model, body=None))) is Estimator
    nominal = RigModel.nominal(MAZE)
    unknown = replace(nominal, body=Body(dict(FOUND), stamp(nominal.balls)))
    assert isinstance(estimator_for(MAZE, unknown), DelayBank), "it has to find out the delay first"


def test_a_delay_that_is_measured_takes_the_bodys_along():
    model = bodied()
    late = body_of(model.late_by(Latency(0.1, 0.001)))
    assert late is not None
    assert late.view.delay == pytest.approx(0.1 + FOUND["delay"])


def test_a_model_file_holds_it(tmp_path):
    model = bodied()
    seen = body_of(model)
    again = with_body(model, seen, {"rolling": 0.001, "offset_x": 1.0})
    back = load_model(save_model(again, tmp_path).parent)
    for name in KEPT:  # also those that the file leaves out, because they do not act
        assert value_of(body_of(back), name) == pytest.approx(value_of(body_of(again), name), rel=1e-5, abs=1e-6), name
    assert back.body.stderr == {"rolling": 0.001}
    assert body_of(back).ball.rolling == FOUND["rolling"]
    assert body_of(back).view.delay == pytest.approx(seen.view.delay)
    assert back.body.terms == ()
    text = (tmp_path / "model.yaml").read_text()
    (tmp_path / "model.yaml").write_text(text.replace("wall: {value: 0.311", "wall: {value: 7.311"))
    with pytest.raises(ModelError, match=r"wall: got 7\.311, expected 0 to 2"):
        load_model(tmp_path)
    (tmp_path / "model.yaml").write_text(text.replace("  wall: {value", "  wal: {value"))
    with pytest.raises(ModelError, match="unknown key"):
        load_model(tmp_path)


def test_what_a_record_does_not_determine_does_not_act():
    """Without a known grip of the floor, walls return what the restitution says."""
    known = with_body(bodied(), body_of(bodied()), {"hold": 2000.0, "wall": 50.0})
    ball = body_of(known).ball
    assert (ball.hold, ball.wall) == (1.0, 0.0)
    assert ball.restitution == FOUND["restitution"]


def test_a_model_file_holds_the_terms_of_a_body(tmp_path):
    model = bodied()
    warp = floor_warp(0.02, -0.1, 0.0)
    seen = body_of(model)._replace(terms=(warp, table_swing(1.3, 0.01, 0.0, 0.0, 0.0), floor_ripple(6.0)))
    back = load_model(save_model(with_body(model, seen, {}), tmp_path).parent)
    assert back.body.terms == (warp,), "no clock, and waves without a size"
    assert body_of(back).terms == (warp,)
    path = tmp_path / "model.yaml"
    text = path.read_text()
    for old, new, message in (
        ("floor_warp", "floor_wrap", "body.terms.floor_wrap: got 'floor_wrap', expected one of floor_warp"),
        ("a: {value: 0.02", "a: {value: 2.0", r"body.terms.floor_warp: a: got 2.0, expected -1.0 to 1.0 1/m"),
        ("a: {value: 0.02", "e: {value: 0.02", "body.terms.floor_warp.e: unknown key"),
    ):
        path.write_text(text.replace(old, new, 1))
        with pytest.raises(ModelError, match=message):
            load_model(tmp_path)
