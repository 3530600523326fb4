"""Two balls that meet are predicted together; two that do not, as if each were alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mazeplan.control.estimation.delay_bank import estimator_for
from mazeplan.control.estimation.encounter import NEAR, SHARE, collide, update_balls
from mazeplan.control.estimation.estimator import SIZE, Estimator
from mazeplan.control.tilt import Plate
from mazeplan.core.records import Observation
from mazeplan.learning.modelfile import RigModel, load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig

CME = load_map("cme")
TWO = replace(CME, balls=2)
R = CME.ball.radius


def state(x, y, vx=0.0, vy=0.0):
    z = np.zeros(SIZE)
    z[:4] = x, y, vx, vy
    return z


def test_approaching_balls_exchange_speed_along_their_centres():
    first, second = state(0.0, 0.0, 0.1, 0.03), state(1.9 * R, 0.0, -0.05, 0.0)
    change = collide(first, second, R)
    assert change == pytest.approx([0.15 * SHARE, 0.0])
    assert first[2:4] == pytest.approx([0.1 - 0.15 * SHARE, 0.03])
    assert second[2:4] == pytest.approx([-0.05 + 0.15 * SHARE, 0.0])
    assert (first[:2], second[:2]) == (pytest.approx([-0.05 * R, 0.0]), pytest.approx([1.95 * R, 0.0]))


def test_balls_that_part_are_separated_only_and_others_left_alone():
    first, second = state(0.0, 0.0, -0.1), state(0.0, 1.9 * R, 0.0, 0.1)
    assert collide(first, second, R) == pytest.approx([0.0, 0.0])
    assert (first[2], second[3]) == (-0.1, 0.1)
    assert np.hypot(*(second - first)[:2]) == pytest.approx(2.0 * R)
    first, second = state(0.0, 0.0, 0.1), state(2.01 * R, 0.0)
    assert collide(first, second, R) is None
    assert (first[0], second[0]) == (0.0, 2.01 * R)


def followed(model, ticks=300):
    """Rms errors, m, of the predicted places of both balls in the centre of the toy: predicted together, and alone; in
    the ticks in which they touch, and the ones behind those. A law keeps them there, beside random commands."""
    rig, rng = make_rig("toy", TWO), np.random.default_rng(5)
    rig.reset(ring=5, theta=0.3, rng=np.random.default_rng(1))
    both = [[estimator_for(TWO, model) for _ in range(2)] for _ in range(2)]
    wanted = np.repeat(rng.uniform(-1.0, 1.0, (ticks // 15, 2)) * 0.3 * CME.tilt_limit, 15, axis=0)
    found, true, touched = [], [], []
    for random in wanted:
        sample = rig.observe()
        balls = (sample, *sample.others)
        together = update_balls(both[0], balls, R)
        alone = [e.update(s) for e, s in zip(both[1], balls, strict=True)]
        places = np.array([rig.truth()[:2], rig.others()[0][:2]])
        found.append([[(s.x, s.y) for s in states] for states in (together, alone)])
        true.append(places)
        touched.append(np.hypot(*(places[1] - places[0])) < 2.04 * R)
        x, y = places.mean(axis=0)
        command = Plate(CME.tilt_limit).command(-15.0 * x + 9.81 * random[0], -15.0 * y + 9.81 * random[1])
        for estimator in (*both[0], *both[1]):
            estimator.sent(command, sample.t)
        rig.command(command.u_beta, command.u_gamma)
    rig.close()
    off = np.linalg.norm(np.array(found) - np.array(true)[:, None], axis=-1)[30:]  # (T, 2 ways, 2 balls)
    near = np.array(touched)[30:]
    near[1:] |= near[:-1].copy()
    assert 40 < near.sum() < len(near)
    return np.sqrt((off[near] ** 2).mean(axis=(0, 2)))


@pytest.mark.slow
@pytest.mark.parametrize(("body", "share"), [(True, 0.6), (False, 0.85)])
def test_the_prediction_over_the_delay_knows_that_the_balls_meet(body, share):
    model = load_model("toy")
    together, alone = followed(model if body else replace(model, body=None))
    assert together < share * alone
    assert together < 1.3e-3


def test_balls_far_apart_are_predicted_as_if_each_were_alone():
    model = RigModel.nominal(CME)
    pairs = [[Estimator(CME, model) for _ in range(2)] for _ in range(2)]
    for k in range(20):
        t, apart = k / 30.0, 2.0 * R + NEAR + 1e-3
        balls = [Observation(t, 0.07, y + 1e-3 * k, 0.01, -0.02) for y in (-0.5 * apart, 0.5 * apart)]
        together = update_balls(pairs[0], balls, R)
        assert together == [e.update(s) for e, s in zip(pairs[1], balls, strict=True)]


def test_a_hit_within_the_delay_is_predicted():
    model = replace(RigModel.nominal(CME), camera_delay=0.1)
    pair = [Estimator(CME, model) for _ in range(2)]
    for k in range(12):  # ball 1 rolls along the disc at 0.1 m/s towards ball 2, which rests
        t = k / 30.0
        x = -2.0 * R - 1e-3 - 0.1 * (11 - k) / 30.0
        balls = [Observation(t, x, 0.0, 0.0, 0.0), Observation(t, 0.0, 0.0, 0.0, 0.0)]
        first, second = update_balls(pair, balls, R)
    assert second.vx == pytest.approx(0.1 * SHARE, rel=0.15)
    assert 0.03 < first.vx < 0.06  # floor friction has slowed it, too
    assert second.x > 2e-3
