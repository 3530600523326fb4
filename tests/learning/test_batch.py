"""Batches of roll-outs against one step after another, for each kind of model; draws of a process."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from mazeplan.core.errors import InputError, SettingsError
from mazeplan.learning import gp_dynamics as learned_dynamics
from mazeplan.learning.batch import Plans, RingBatch
from mazeplan.learning.features import inputs
from mazeplan.learning.gaussian_process import GaussianProcess, Hyperparameters, KernelTerm
from mazeplan.learning.modelfile import RigModel
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.dynamics import ring_dynamics
from mazeplan.physics.effects.ball import dry_friction, rolling_inertia, surface_bump, surface_profile, tilt_offset
from mazeplan.physics.formulas.arrays import RingKinematics
from mazeplan.physics.rig.stage import StageAxis, StageModel
from mazeplan.physics.rig.stage_simulation import actuator_output

MANY, STEPS, LIMIT, RADIUS = 2000, 40, 0.08, 0.0689
SPREAD = np.array([math.pi, 4.0, 0.08, 0.5, 0.08, 0.5])  # of start states: rad, rad/s
STAGE = StageModel(StageAxis(0.95, 24.0, 0.8, offset=0.002), StageAxis(1.1, 28.0, 1.4))
LOOSE = StageModel(replace(STAGE.beta, backlash=0.01, deadband=0.003), replace(STAGE.gamma, deadband=0.01))
BALL = BallModel((rolling_inertia(0.55), dry_friction(0.4), tilt_offset(0.004, -0.006)))
FLOOR = BallModel((*BALL.effects, surface_profile(cos1=0.1, sin3=-0.3), surface_bump(1.0, 0.2, 0.5)))
KINDS = ("p", "pi", "np", "sp")


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    torch = pytest.importorskip("torch")
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def process(columns, rows=150):
    rng = np.random.default_rng(0)
    theta, theta_dot, beta, beta_dot, gamma, gamma_dot = (SPREAD * rng.uniform(-1, 1, (rows, 6))).T
    zero = np.zeros(rows)
    x = inputs(RingKinematics(RADIUS, theta, theta_dot, beta, beta_dot, zero, gamma, gamma_dot, zero))
    scales = np.array([3.0, 0.8, 0.8, 0.4, 0.4, 0.1, 0.02, 0.1, 0.02])[list(columns)]
    hyper = Hyperparameters((KernelTerm(columns, scales, 3.0),), 0.1, np.zeros(0))
    y = 3.0 * np.sin(2.0 * theta) - 0.5 * theta_dot + 20.0 * beta
    return GaussianProcess.condition(hyper, x, np.zeros((rows, 0)), y)


@cache
def model(kind):
    """p without friction; pi on a floor that is not flat; np with all nine inputs; sp with those that `learn` keeps."""
    columns = tuple(range(9)) if kind == "np" else (0, 1, 2, 3, 4, 5, 7)
    processes = {2: process(columns)} if kind in ("np", "sp") else {}
    ball = BallModel((rolling_inertia(0.55),)) if kind == "p" else FLOOR if kind == "pi" else BALL
    return RigModel(LOOSE if kind == "sp" else STAGE, {2: ball}, kind=kind, processes=processes)


def batch(kind, **more):
    return RingBatch.of_model(model(kind), 2, RADIUS, limit=LIMIT, **more)


@cache
def random_plans(count=MANY, feedback=False):
    rng = np.random.default_rng(1)
    starts = SPREAD * rng.uniform(-1, 1, (count, 6))
    commands = np.cumsum(rng.normal(0.0, 0.02, (count, STEPS, 2)), axis=1)
    if not feedback:
        return starts, Plans(commands)
    gains = rng.normal(0.0, 0.02, (count, STEPS, 2, 6))
    return starts, Plans(commands, gains, starts[:, None] + rng.normal(0.0, 0.1, (count, STEPS + 1, 6)))


def by_hand(kind, start, commands):
    """One roll-out with the planner's own step, the commands as `stage` passes them on."""
    rig, one = model(kind), batch(kind)
    u = np.clip(commands, -LIMIT, LIMIT)
    u = np.stack([actuator_output(u[:, 0], rig.stage.beta), actuator_output(u[:, 1], rig.stage.gamma)], axis=1)
    learned = one.process is not None
    p = learned_dynamics.pack(one.parameters, one.process) if one.process else one.parameters.pack()
    step, states = learned_dynamics.step if learned else ring_dynamics.step, [start]
    for k in range(len(u)):
        states.append(np.empty(6))
        step(states[-2], u[k], p, states[-1])
    return np.array(states)


@pytest.mark.parametrize("kind", KINDS)
def test_a_batch_is_the_planners_step_after_step(kind):
    starts, plans = random_plans(40)
    out = batch(kind, threads=2).roll_out(starts, plans)
    for i in range(0, 40, 5):
        np.testing.assert_allclose(out[i], by_hand(kind, starts[i], plans.commands[i]), atol=1e-12)


def test_what_does_not_fit_is_told():
    starts, plans = random_plans(40)
    one = batch("p")
    with pytest.raises(ValueError, match=r"gains: got shape \(40, 40, 2\), expected \(40, 40, 2, 6\)"):
        Plans(plans.commands, plans.commands, plans.commands)
    with pytest.raises(ValueError, match="belong together"):
        Plans(plans.commands, np.zeros((40, STEPS, 2, 6)))
    with pytest.raises(ValueError, match=r"starts \(40, 5\)"):
        one.roll_out(starts[:, :5], plans)
    with pytest.raises(ValueError, match="of 40"):
        one.roll_out(starts[:1], plans, which=np.array([40]))
    with pytest.raises(ValueError, match="pushes"):
        one.roll_out(starts, plans, pushes=np.zeros((40, 3)))
    with pytest.raises(SettingsError, match="float16"):
        replace(one, precision="float16")
    with pytest.raises(SettingsError, match="limit"):
        replace(one, limit=math.nan)


def test_feedback_pushes_and_a_plan_for_several_starts():
    starts, plans = random_plans(200, True)
    pushes = np.random.default_rng(2).normal(0.0, 2.0, (200, STEPS))
    out = batch("sp").roll_out(starts, plans, pushes=pushes)
    u = plans.commands[3, 0] + plans.gains[3, 0] @ (starts[3] - plans.states[3, 0])
    first, dt = by_hand("sp", starts[3], u[None])[1], 1.0 / 30.0
    first[:2] += [0.5 * dt * dt * pushes[3, 0], dt * pushes[3, 0]]
    np.testing.assert_allclose(out[3, 1], first, atol=1e-12)
    starts, plans = random_plans(40)
    which = np.array([7, 7, 3])
    expected = batch("p").roll_out(starts[:3], Plans(plans.commands[which]))
    np.testing.assert_array_equal(batch("p").roll_out(starts[:3], plans, which=which), expected)


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_earlier_devices_run_compiled(device):
    starts, plans = random_plans(40)
    with pytest.warns(DeprecationWarning, match="compiled"):
        found = batch("p", device=device, precision="float32").roll_out(starts, plans)
    np.testing.assert_array_equal(found, batch("p").roll_out(starts, plans))
    with pytest.raises(InputError, match="got 'tpu', expected one of auto, compiled, cpu, cuda"):
        batch("p", device="tpu")


# --- draws of a process

ODD = (-1.0, -1.0, 1.0)


def drawn_from(family, features=1):
    """A process of a plain and an odd term on three inputs, and states to ask it in: rows of its own, and others."""
    rng = np.random.default_rng(3)
    x = rng.uniform(-1.0, 1.0, (40, 3))
    phi = x[:, :features] + 0.5
    terms = (KernelTerm((0, 1), np.array([0.5, 0.8]), 1.5), KernelTerm((0, 1, 2), np.array([0.7, 0.6, 0.9]), 0.8, ODD))
    hyper = Hyperparameters(terms, 0.2, np.full(features, 0.7), family)
    gp = GaussianProcess.condition(hyper, x, phi, np.sin(3.0 * x[:, 0]) + x[:, 2])
    at = np.concatenate([x[:4], rng.uniform(-2.0, 2.0, (8, 3))])
    return gp, at, at[:, :features] + 0.5


@pytest.mark.parametrize("family", ["rbf", "exponential"])
def test_functions_drawn_of_a_process_have_its_mean_and_variance(family):
    from mazeplan.learning.posterior import ProcessDraws

    gp, at, phi = drawn_from(family)
    count = 1500
    draws = ProcessDraws(gp, gp, count, np.random.default_rng(4))
    each = draws.mean(np.tile(at, (count, 1)), np.tile(phi, (count, 1))).reshape(count, len(at))
    mean, variance = gp.mean(at, phi), gp.variance(at, phi)
    assert variance.min() < 0.3 < 1.5 < variance.max()
    np.testing.assert_allclose(each.mean(axis=0), mean, atol=4.0 * math.sqrt(variance.max() / count))
    # the waves are as many as they are: a variance is off by some percent where the data say nothing
    np.testing.assert_allclose(each.var(axis=0), variance, rtol=0.25)
    one = draws.mean(np.tile(at[0], (count, 1)), np.tile(phi[0], (count, 1)))  # a function has one value in one state
    np.testing.assert_allclose(one, each[:, 0], atol=1e-9)


def test_the_middle_of_the_draws_may_be_another_process_on_the_same_rows():
    from mazeplan.learning.posterior import ProcessDraws

    gp, at, phi = drawn_from("exponential")
    other = replace(gp, alpha=0.5 * gp.alpha, weights=gp.weights + 2.0)
    count, found = 300, []
    for centre in (gp, other):
        draws = ProcessDraws(gp, centre, count, np.random.default_rng(4))
        found.append(draws.mean(np.tile(at, (count, 1)), np.tile(phi, (count, 1))).reshape(count, len(at)))
    expected = np.tile(other.mean(at, phi) - gp.mean(at, phi), (count, 1))
    np.testing.assert_allclose(found[1] - found[0], expected, atol=1e-8)


def test_a_process_without_its_factor_cannot_be_drawn_from():
    from mazeplan.core.errors import ModelError
    from mazeplan.learning.posterior import ProcessDraws

    gp, _, _ = drawn_from("rbf")
    with pytest.raises(ModelError, match="for its mean alone"):
        ProcessDraws(replace(gp, factor=np.zeros((0, 0))), gp, 3, np.random.default_rng(0))
