"""The filter that keeps a ball in the centre: on MuJoCo, whose ball it does not know."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mazeplan.control.command_chain import MARGIN, SafetyFilter
from mazeplan.control.tilt import Plate
from mazeplan.core.records import Command, State
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig

CME = load_map("cme")
PLATE = Plate(CME.tilt_limit)
DISC = CME.rings[-1].outer_radius - CME.ball.radius  # m, how far the ball's centre comes at the wall
LED = State(0.0, 0.03, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 4)


@pytest.fixture(scope="module")
def keeper():
    return SafetyFilter(CME, RigModel.nominal(CME).planar(CME), PLATE)


def at(x_mm=0.0, y_mm=0.0, vx=0.0, vy=0.0):
    return State(0.0, 1e-3 * x_mm, 1e-3 * y_mm, vx, vy, 0.0, 0.0, 0.0, 0.0, 5)


def seen(rig):
    """The state of the simulated ball, as the best estimator would have it."""
    x, y, _, vx, vy, beta, gamma = rig.truth()
    rates = rig.machine.gimbal.data.qvel[:2]
    return State(rig.machine.time, x, y, vx, vy, beta, float(rates[0]), gamma, float(rates[1]), 5)


def left(seed, change):
    """Whether the ball leaves the disc in 10 s of random commands, and the share of commands that `change` changed."""
    rig, rng, changed = make_rig("ideal", CME), np.random.default_rng(seed), 0
    rig.reset(ring=5, theta=0.0, rng=rng)
    wanted = np.repeat(rng.uniform(-1.0, 1.0, (30, 2)) * CME.tilt_limit, 10, axis=0)
    for pair in wanted.tolist():
        rig.observe()
        sent = change(Command(*pair), seen(rig))
        changed += sent != Command(*pair)
        rig.command(sent.u_beta, sent.u_gamma)
        if math.hypot(*rig.truth()[:2]) > CME.rings[-1].outer_radius:
            return True, changed / len(wanted)
    return False, changed / len(wanted)


def test_a_ball_that_would_leave_stays(keeper):
    plain = [left(seed, lambda wanted, ball: wanted) for seed in range(4)]
    kept = [left(seed, lambda wanted, ball: keeper.command(wanted, [ball], LED)) for seed in range(4)]
    assert sum(out for out, _ in plain) >= 2
    assert not any(out for out, _ in kept)
    assert 0.02 < np.mean([share for _, share in kept]) < 0.6


def test_a_safe_command_is_unchanged(keeper):
    away = Command(CME.tilt_limit, 0.03)  # the opening is at 180 degrees
    assert keeper.command(away, [at(-9.0)], LED) is away
    level = Command(0.0, 0.0)
    assert keeper.command(level, [at(0.0)], LED) is level


def test_a_command_is_changed_across_the_ring_first(keeper):
    led = replace(LED, x=0.0, y=0.03)  # along its ring is +-x, across it y
    wanted = Command(-0.05, 0.0)  # to -x, where the opening is
    sent = keeper.command(wanted, [at(-9.0)], led)
    assert sent.u_beta != wanted.u_beta or sent.u_gamma != wanted.u_gamma
    limit = DISC + MARGIN
    assert keeper.farthest(sent, [at(-9.0)]) <= limit < keeper.farthest(wanted, [at(-9.0)])


def test_of_two_kept_balls_both_stay(keeper):
    sent = keeper.command(Command(-0.06, 0.0), [at(9.0), at(-9.0)], LED)
    assert keeper.farthest(sent, [at(-9.0)]) <= DISC + MARGIN


def test_a_ball_beyond_help_gets_the_best_command(keeper):
    out = at(-15.0, vx=-0.2)
    sent = keeper.command(Command(-CME.tilt_limit, 0.0), [out], LED)
    assert sent.u_beta > 0.0
    assert keeper.farthest(sent, [out]) < keeper.farthest(Command(-CME.tilt_limit, 0.0), [out])


def test_commands_stay_within_the_limits_and_are_plain_numbers(keeper):
    rng = np.random.default_rng(1)
    for _ in range(30):
        x, y = rng.uniform(-7.0, 7.0, 2)
        pair = rng.uniform(-1.0, 1.0, 2) * CME.tilt_limit
        sent = keeper.command(Command(*pair.tolist()), [at(float(x), float(y), vx=float(rng.normal(0.0, 0.05)))], LED)
        assert max(abs(sent.u_beta), abs(sent.u_gamma)) <= CME.tilt_limit + 1e-12
        assert {type(sent.u_beta), type(sent.u_gamma)} == {float}
