"""Two balls in one simulated maze: they touch, and each goes as it would alone while they do not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.sim.settings import Fault
from mazeplan.rigs.sim.simulated import SimulatedRig

CME = load_map("cme")
TWO = replace(CME, balls=2)
IDEAL = make_rig("ideal", CME).settings  # pyright: ignore[reportAttributeAccessIssue]


def commands(samples, seed=0):
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-1.0, 1.0, (samples // 10, 2)) * CME.tilt_limit, 10, axis=0)


def begun(maze, settings=IDEAL, ring=1, theta=0.4):
    rig = SimulatedRig(maze, settings)
    rig.reset(ring=ring, theta=theta, rng=np.random.default_rng(3))
    return rig


def test_they_begin_on_opposite_sides_of_their_ring():
    first = begun(TWO).observe()
    (other,) = first.others
    assert math.hypot(first.x, first.y) == pytest.approx(CME.track_radius(1))
    assert (other.x, other.y) == pytest.approx((-first.x, -first.y))
    assert (other.t, other.beta, other.gamma, other.others) == (first.t, first.beta, first.gamma, ())


def test_in_the_disc_they_begin_side_by_side():
    sample = begun(TWO, ring=5).observe()
    gap = math.dist((sample.x, sample.y), (sample.others[0].x, sample.others[0].y))
    assert gap == pytest.approx(2.4 * CME.ball.radius)


@pytest.mark.slow
def test_they_touch_and_do_not_pass_through_each_other():
    rig, apart = begun(TWO), []
    for command in commands(450):
        sample = rig.observe()
        apart.append(math.dist((sample.x, sample.y), (sample.others[0].x, sample.others[0].y)))
        rig.command(*command)
    assert min(apart) > 2.0 * CME.ball.radius - 2e-4
    assert sum(gap < 2.0 * CME.ball.radius + 1e-4 for gap in apart) > 10


def test_each_goes_as_alone_while_they_do_not_touch():
    pair, alone = begun(TWO), [begun(CME), begun(CME, theta=0.4 + math.pi)]
    seen = []
    for command in commands(20):
        sample, single = pair.observe(), [rig.observe() for rig in alone]
        seen = [(ball.x, ball.y) for ball in (sample, *sample.others)]
        np.testing.assert_allclose(
            seen, [(ball.x, ball.y) for ball in single], atol=5e-4
        )  # m; the solver takes both at once
        for rig in (pair, *alone):
            rig.command(*command)
    assert math.dist(seen[1], (TWO.track_radius(1) * math.cos(0.4 + math.pi), seen[1][1])) > 0.005  # it rolled


def places(rig, samples):
    """(samples, 2, 2) x, y of both balls, NaN where a ball is not seen; the plate is level."""
    out = []
    for _ in range(samples):
        sample = rig.observe()
        each = (sample, *sample.others)
        out.append([[math.nan if ball.x is None else ball.x, math.nan if ball.y is None else ball.y] for ball in each])
        rig.command(0.0, 0.0)
    return np.array(out)


def test_the_second_ball_is_kicked_moved_and_taken_out_alone():
    rig = begun(TWO)
    still = places(rig, 5)[-1]
    rig.inject(Fault(kind="push", at_s=0.0, ball=2, speed_m_s=0.1, direction_deg=math.degrees(0.4) + 90.0))
    seen = places(rig, 10)
    np.testing.assert_allclose(seen[:, 0], np.tile(still[0], (10, 1)), atol=1e-6)
    assert math.dist(seen[-1, 1], still[1]) > 0.02
    rig.inject(Fault(kind="teleport", at_s=0.0, ball=2, ring=3, direction_deg=100.0))
    seen = places(rig, 5)
    np.testing.assert_allclose(seen[-1, 0], still[0], atol=1e-6)
    assert math.hypot(*seen[-1, 1]) == pytest.approx(CME.track_radius(3), abs=1e-3)
    rig.inject(Fault(kind="removed", at_s=19.5 / 30.0, ball=2, duration_s=10.0 / 30.0))
    seen = places(rig, 10)
    assert np.isnan(seen[2:9, 1]).all()
    np.testing.assert_allclose(seen[:, 0], np.tile(still[0], (10, 1)), atol=1e-6)
    assert math.hypot(*places(rig, 5)[-1, 1]) == pytest.approx(CME.track_radius(3), abs=1e-3)  # put back


def test_one_ball_is_glued_and_the_other_rolls():
    rig = begun(TWO, replace_with(faults=(Fault(kind="stuck", at_s=0.0, duration_s=9.0, ball=2),)))
    first = rig.observe()
    for _ in range(20):
        rig.command(0.05, 0.02)
        last = rig.observe()
    assert math.dist((first.x, first.y), (last.x, last.y)) > 0.02
    assert math.dist(*[(each.others[0].x, each.others[0].y) for each in (first, last)]) < 1e-3


def replace_with(**settings):
    """The ideal rig with other settings."""
    return IDEAL.model_copy(update=settings)
