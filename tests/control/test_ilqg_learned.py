"""Planning along a ring whose model has learned something: the plan is right for the ball that does so."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from gaussian_processes import plain
from ilqg_problems import LIMIT, ring_planner
from ring_numbers import G, numbers_of, ring_of

from mazeplan.control.ilqg import IlqgOptions
from mazeplan.control.ring_planner import RingPlanner
from mazeplan.core.errors import ModelError
from mazeplan.core.records import StopReason
from mazeplan.learning import fast_gp
from mazeplan.learning.features import inputs
from mazeplan.learning.gaussian_process import GaussianProcess
from mazeplan.physics.ball_model import RingKinematics
from mazeplan.physics.dynamics import ring_dynamics
from mazeplan.physics.dynamics.ring_parameters import RingParameters

P = RingParameters(0.0689)
STEEP = numbers_of(P).rolling_factor * G / P.radius  # rad/s^2 per rad of tilt along the ring
WIDE = np.full(9, 20.0)  # length scales of what is nearly constant
SCALES = np.array([3.0, 1.0, 1.0, 0.5, 0.5, 0.2, 0.05, 0.2, 0.05])


def seen(states):
    zero = np.zeros(len(states))
    theta, theta_dot, beta, beta_dot, gamma, gamma_dot = states.T
    return inputs(RingKinematics(P.radius, theta, theta_dot, beta, beta_dot, zero, gamma, gamma_dot, zero))


def process(function, scales, n=250, amplitude=2.0):
    """A process that has learned function(states), rad/s^2, from states on the way of a plan."""
    rng = np.random.default_rng(0)
    states = np.array([math.pi, 3.0, 0.09, 0.6, 0.09, 0.6]) * rng.uniform(-1, 1, (n, 6))
    hyper = plain(scales, amplitude, 0.02)
    return GaussianProcess.condition(hyper, seen(states), np.zeros((n, 0)), function(states))


PUSH = 1.0  # rad/s^2
PUSHED = process(lambda s: np.full(len(s), PUSH), WIDE, 60, 5.0)
WAVY = process(lambda s: 1.5 * np.sin(3.0 * s[:, 0]) - 0.2 * s[:, 1], SCALES)
ZERO = replace(WAVY, alpha=1e-12 * WAVY.alpha)


def played(plan, gp, parameters=P, *, moved: float | np.ndarray = 0.0, feedback=False):
    """States (T + 1, 6) of a ball with another model, or moved at first, under the commands of a plan."""
    s, out = plan.states[0] + moved, np.empty(6)
    path = [s]
    packed = parameters.pack() if gp is None else fast_gp.pack_with_process(parameters, gp)
    dynamics = ring_dynamics if gp is None else fast_gp
    for k, u in enumerate(plan.controls):
        if feedback:
            u = np.clip(u + plan.gains[k] @ (s - plan.states[k]), -LIMIT, LIMIT)
        dynamics.linearise(s, u, packed, out, np.empty((6, 6)), np.empty((6, 2)))
        s = out.copy()
        path.append(s)
    return np.array(path)


def along(theta, beta, gamma):
    """What gravity does along the ring, rad/s^2."""
    return -STEEP * (np.sin(beta) * np.sin(theta) + np.sin(gamma) * np.cos(beta) * np.cos(theta))


@pytest.mark.parametrize("goal", [math.pi / 4, -math.pi / 4, 2.0])
@pytest.mark.parametrize("gp", [PUSHED, WAVY], ids=["push", "wavy"])
def test_it_reaches_the_goal_on_its_own_dynamics(gp, goal):
    plan = ring_planner(process=gp).plan(np.zeros(6), goal)
    assert plan.reason is StopReason.CONVERGED
    assert (np.abs(plan.controls) <= LIMIT).all()
    assert np.abs(plan.states[-5:, 0] - goal).max() < 0.03
    assert np.abs(plan.states[-1, 1]) < 0.1
    np.testing.assert_allclose(played(plan, gp), plan.states, atol=1e-12)


def test_a_plan_without_what_was_learned_misses():
    """On the ball that does what was learned, the plan that knows is better; so the process is worth its time."""
    for gp in (PUSHED, WAVY):
        without = played(ring_planner().plan(np.zeros(6), 1.0), gp)
        knowing = played(ring_planner(process=gp).plan(np.zeros(6), 1.0), gp)
        assert abs(knowing[-1, 0] - 1.0) < 0.02
        assert abs(without[-1, 0] - 1.0) > 5.0 * abs(knowing[-1, 0] - 1.0)


def test_a_process_of_almost_nothing_changes_nothing():
    exact = IlqgOptions(40, tolerance=1e-11)
    plain, learned = ring_planner(options=exact), ring_planner(options=exact, process=ZERO)
    rng = np.random.default_rng(1)
    for _ in range(10):
        s0 = rng.normal(size=6) * [1.0, 1.0, 0.03, 0.2, 0.03, 0.2]
        goal, lean = s0[0] + rng.uniform(-2, 2), rng.uniform(-0.03, 0.03)
        a, b = plain.plan(s0, goal, lean=lean), learned.plan(s0, goal, lean=lean)
        assert b.cost == pytest.approx(a.cost, rel=1e-8)
        np.testing.assert_allclose(b.controls, a.controls, atol=1e-4)
        np.testing.assert_allclose(b.gains, a.gains, atol=0.1)


def test_without_physics_the_process_is_all_there_is():
    """kind np: the process that has learned gravity and friction plans as the effects do."""
    p = ring_of(P.radius, viscous=0.3)

    def effects(s):
        return along(s[:, 0], s[:, 2], s[:, 4]) - 0.3 * s[:, 1]

    gp = process(effects, np.array([8.0, 8.0, 8.0, 1.5, 1.5, 0.4, 0.4, 0.4, 0.4]), 500, 8.0)
    plan = RingPlanner(replace(p, physics=False), LIMIT, IlqgOptions(40), process=gp).plan(np.zeros(6), math.pi / 4)
    effects_alone = RingPlanner(p, LIMIT, IlqgOptions(40)).plan(np.zeros(6), math.pi / 4)
    assert abs(plan.states[-1, 0] - math.pi / 4) < 0.02
    assert plan.cost == pytest.approx(effects_alone.cost, rel=0.05)  # gravity held over a step is a little late
    assert abs(played(plan, None, p)[-1, 0] - math.pi / 4) < 0.1
    blind = RingPlanner(replace(p, physics=False), LIMIT, IlqgOptions(40)).plan(np.zeros(6), math.pi / 4)
    assert abs(blind.states[-1, 0]) < 0.1  # without either nothing can move the ball


def test_gains_hold_the_ball_on_the_learned_model():
    plan = ring_planner(process=WAVY).plan(np.zeros(6), 1.0)
    moved = np.array([0.05, -0.2, 0.0, 0.0, 0.0, 0.0])
    missed, led = (abs(played(plan, WAVY, moved=moved, feedback=feedback)[-1, 0] - 1.0) for feedback in (False, True))
    assert led < 0.02
    assert missed > 3.0 * led


def test_a_rough_process_is_refused():
    rough = replace(WAVY, hyper=replace(WAVY.hyper, family="exponential"))
    with pytest.raises(ModelError, match="family: got a kernel exponential, expected rbf"):
        ring_planner(process=rough)
