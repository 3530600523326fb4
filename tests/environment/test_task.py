"""What is made of samples: observations, rewards and ends, without any physics."""

import math

import numpy as np
import pytest

from mazeplan.apps.environment.task import ANGLES, HOLD, LOST, NAMES, RATE, Judge, Senses, Task, potential
from mazeplan.control.estimation.sample_check import SAMPLES
from mazeplan.core.records import Observation
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")
STILL = np.zeros(2)


def sample(t, x, y, beta=0.0, gamma=0.0):
    return Observation(t, None if math.isnan(x) else x, None if math.isnan(y) else y, beta, gamma)


def begun(reward="sparse", ring=1, theta=0.0, **options):
    radius = MAZE.track_radius(ring)
    senses = Senses(MAZE, 30.0, sample(0.0, radius * math.cos(theta), radius * math.sin(theta)), ring, theta)
    task = Task(reward=reward, start_ring=ring, **options)
    return senses, Judge(task, senses, potential(task, MAZE))


def walk(places, reward="sparse", **options):
    """Verdicts of a ball seen at these places, one sample apart."""
    senses, judge = begun(reward, **options)
    verdicts = []
    for step, (x, y) in enumerate(places, start=1):
        senses.take(sample(step / 30.0, x, y), STILL)
        verdicts.append(judge.judge())
    return verdicts


def named(senses):
    return dict(zip(NAMES, senses.state().tolist(), strict=True))


def test_the_state_is_what_its_names_say():
    senses, _ = begun(ring=2, theta=0.5)
    for step in range(1, 4):  # 30 mm/s outwards, 1 rad/s round, and a plate that tilts at 0.3 rad/s
        radius, theta = 0.070 + 0.03 * step / 30.0, 0.5 + step / 30.0
        at = sample(step / 30.0, radius * math.cos(theta), radius * math.sin(theta), 0.01 * step, -0.005)
        senses.take(at, np.array([0.02, -0.04]))
    got, limit = named(senses), MAZE.tilt_limit
    expected = {
        "radius": radius / MAZE.rings[0].outer_radius, "cos_theta": math.cos(theta), "sin_theta": math.sin(theta),
        "beta": 0.03 / limit, "gamma": -0.005 / limit, "beta_rate": 0.3 / (RATE * limit), "gamma_rate": 0.0,
        "u_beta": 0.02 / limit, "u_gamma": -0.04 / limit, "ring": 0.25, "unseen": 0.0,
    }  # fmt: skip
    assert {name: got[name] for name in expected} == pytest.approx(expected, abs=1e-6)
    assert got["radial_speed"] == pytest.approx(0.03, abs=0.004)  # differences lag by a sample
    assert got["tangential_speed"] == pytest.approx(0.073, abs=0.004)


def test_an_unseen_ball_keeps_its_place_and_speed():
    senses, _ = begun(ring=2)
    for step in range(1, 4):
        senses.take(sample(step / 30.0, 0.07, 0.004 * step), STILL)
    before = named(senses)
    for step in range(4, 7):
        senses.take(sample(step / 30.0, math.nan, math.nan), STILL)
    after = named(senses)
    assert after.pop("unseen") == pytest.approx(0.1)
    assert before.pop("unseen") == 0.0
    assert after == before
    senses.take(sample(7 / 30.0, 0.07, 0.028), STILL)  # seen again, on its way: speed over the time that passed
    assert named(senses)["tangential_speed"] == pytest.approx(0.12, abs=0.02)


def test_arrival_is_a_hold_inside_the_goal():
    needed = round(30 * HOLD) + 1
    here, gone, beside = (0.0, 0.001), (math.nan, math.nan), (0.0, 0.018)
    whole = walk([here] * needed)
    assert [v.arrived for v in whole] == [False] * (needed - 1) + [True]
    assert [v.reward for v in whole] == [0.0] * (needed - 1) + [1.0]
    blinked = walk([here, *[gone] * (needed - 2), here])
    assert blinked[-1].arrived
    assert not blinked[-2].arrived
    assert not walk([*[here] * (needed - 2), beside, *[here] * (needed - 1)])[-1].arrived
    assert not any(v.out for v in whole)


def test_an_unseen_ball_or_one_beyond_the_rim_is_out():
    lost = walk([(math.nan, math.nan)] * round(30 * LOST))
    assert [v.out for v in lost] == [False] * (len(lost) - 1) + [True]
    assert not any(v.left for v in lost)
    outside = walk([(0.12, 0.0)] * SAMPLES)
    assert [v.out for v in outside] == [False] * (len(outside) - 1) + [True]
    assert [v.left for v in outside] == [v.out for v in outside]
    assert not any(v.out for v in walk([(0.12, 0.0), (0.12, 0.0), (0.09, 0.0)] * 8))  # a wrong position or two
    nowhere = (math.nan, math.nan)
    assert not any(v.left for v in walk([(0.12, 0.0), nowhere, nowhere, nowhere] * 4))
    for flown in ([(0.12, 0.0), (0.13, 0.0), nowhere], [(0.12, 0.0), nowhere, (0.13, 0.0)]):  # out of the picture
        assert [v.left for v in walk(flown)] == [False, False, True]


def test_the_dense_reward_is_the_sparse_one_and_a_potential():
    """Summed with its discount, shaping leaves -phi(start): the same for all ways, so that none gains by it."""
    inwards = [(r, 0.0) for r in np.linspace(0.089, 0.001, 40)] + [(0.0, 0.001)] * 8
    wandering = [(0.089 * math.cos(a), 0.089 * math.sin(a)) for a in np.linspace(0.0, 4.0, 30)] + inwards
    start = np.interp(0.0, ANGLES, potential(Task(), MAZE)[0])
    assert 0.0 < start < 0.5
    for places in (inwards, wandering):
        dense = walk(places, "dense", discount=0.97)
        sparse = walk(places)
        last = next(k for k, v in enumerate(dense) if v.arrived)
        factors = 0.97 ** np.arange(last + 1)
        shaped = sum(f * (d.reward - s.reward) for f, d, s in zip(factors, dense, sparse, strict=False))
        assert shaped == pytest.approx(-start, abs=1e-12)
