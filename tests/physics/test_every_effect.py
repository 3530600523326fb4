"""Every effect that `effect list` prints, in every place that uses effects: one definition, the same numbers.

An effect on the ball, put into a model at twice its smallest size, changes the acceleration of the planner's step, of
the planar prediction, of the filter and of the batch alike, to 1e-9. An effect of stage, tilt sensor or camera changes
what the model says of that part. What is not planned says why. A new name in the registry, or an effect of a package
outside, passes through the same tests.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from finite_differences import jacobian

from mazeplan.diagnosis.ring.fit import Likelihood
from mazeplan.diagnosis.ring.kalman import NODES, accelerations
from mazeplan.diagnosis.ring.system import RingSystem, Tilt
from mazeplan.learning.modelfile import RigModel, load_model, save_model
from mazeplan.learning.rig_model import part_values, with_part
from mazeplan.maze.mapfile import load_map
from mazeplan.physics import Effect, Parameter, cos, registry, sin
from mazeplan.physics.ball_model import BallModel, RingKinematics
from mazeplan.physics.dynamics import ring_dynamics
from mazeplan.physics.dynamics.planar import EFFECT_OUTPUTS, evaluate_effects, stage_step
from mazeplan.physics.effect import BALL, CAMERA, OPENING, STAGE, TILT_SENSOR
from mazeplan.physics.effects.ball import rolling_inertia
from mazeplan.physics.rig.stage import second_order_transition

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "outside"))
from outside_cart import wind_of_a_fan

MAZE, RING = load_map("cme"), 2
RADIUS = MAZE.track_radius(RING)
NEW = Effect(
    "swirl", {"strength": Parameter("rad/s^2", 0.0, -5.0, 5.0, smallest=0.05)},
    formula=lambda s, p: p.strength * cos(3 * s.theta) * sin(s.beta) * s.theta_dot, text="one that nobody has",
)  # fmt: skip
USERS = {e.name: e for e in (*wind_of_a_fan(), NEW)}
EVERY = {**registry.EFFECTS, **USERS}
ON_BALL = [name for name, e in EVERY.items() if e.acts in BALL and e.acts != OPENING and e.planned]
PARTS = [name for name, e in EVERY.items() if e.acts not in BALL]
AT = (0.7, 3.1)  # rad, rad/s: faster than dry friction changes its sign
TILT = (0.031, -0.024)  # rad, of a plate at rest


@pytest.fixture(autouse=True)
def _registered():
    registry.register(USERS.values())


def sized(effect: Effect) -> dict[str, float]:
    """Twice its smallest size; where it is, at the angle at which it is tried."""
    values = {n: p.default + 2.0 * p.smallest for n, p in effect.parameters.items()}
    near = {"centre": AT[0] - 0.1, "start": AT[0] - 0.5, "end": AT[0] + 0.4, "angle": AT[0] + 0.03, "ring": RING}
    return {n: near.get(n, min(v, effect.parameters[n].high)) for n, v in values.items()}


def model_with(effect: Effect | None) -> RigModel:
    """A rig's model whose rings hold the effect beside what every ball has."""
    plain = () if effect is not None and effect.name == "rolling_inertia" else (rolling_inertia(0.6),)
    terms = plain if effect is None else (*plain, effect(**sized(effect)))
    balls = {ring.number: BallModel(terms) for ring in MAZE.rings}
    return replace(RigModel.nominal(MAZE), balls=balls)


def planner(model: RigModel) -> float:
    """theta_dd of the planner's step."""
    p = model.ring_parameters(RING, RADIUS).pack()
    s = np.array([*AT, TILT[0], 0.0, TILT[1], 0.0])
    return ring_dynamics.acceleration(s, np.array(TILT), p)


def prediction(model: RigModel) -> float:
    """theta_dd of the planar prediction, for a ball that touches a wall, on the track."""
    planar = model.planar(MAZE)
    angle, rate = AT
    z = np.array([math.cos(angle), math.sin(angle), -rate * math.sin(angle), rate * math.cos(angle), 0, 0, 0, 0])
    z *= RADIUS
    z[4], z[6] = TILT
    ring = planar.rings[RING - 1]
    evaluate_effects(z, ring, planar.scalars[1], True)
    ax, ay, drag, dry = ring[EFFECT_OUTPUTS : EFFECT_OUTPUTS + 4]
    along = (ay * math.cos(angle) - ax * math.sin(angle)) / RADIUS
    return along - drag * rate - dry / RADIUS * math.copysign(1.0, rate)


def filtered(model: RigModel, effect: Effect) -> float:
    """theta_dd of the filter of the diagnosis."""
    t = np.arange(20) / 30.0
    grid = np.arange(120) / 180.0
    motion = np.tile([TILT[0], 0.0, 0.0, TILT[1], 0.0, 0.0], (len(grid), 1))
    first = np.arange(len(t)) == 0
    declared = {term.name: term.values() for term in model.ball(RING).effects}
    system = RingSystem(t, np.full(len(t), AT[0]), first, RADIUS, Tilt(grid, motion, "made"), declared)
    library = [rolling_inertia, effect]
    likelihood = Likelihood(system, library, np.ones(len(t), dtype=bool))
    problem, p = likelihood.system.build(library, {})
    assert problem.w.shape[1] == NODES
    return float(accelerations(problem, p, np.full(len(t), AT[0]), np.full(len(t), AT[1]))[5])


def arrays(model: RigModel) -> float:
    """theta_dd of the equation for arrays."""
    one, zero = np.ones(1), np.zeros(1)
    k = RingKinematics(RADIUS, AT[0] * one, AT[1] * one, TILT[0] * one, zero, zero, TILT[1] * one, zero, zero)
    return float(model.ball(RING).acceleration(k)[0])


@pytest.mark.slow
@pytest.mark.parametrize("name", ON_BALL)
def test_an_effect_on_the_ball_acts_alike_everywhere(name):
    effect, plain = EVERY[name], model_with(None)
    model = model_with(effect)
    bare = plain if name != "rolling_inertia" else replace(plain, balls={RING: BallModel()})
    changed = planner(model) - planner(bare)
    smallest = max(p.smallest for p in effect.parameters.values())
    assert abs(changed) > 1e-3 * smallest, "it does nothing"
    assert prediction(model) - prediction(bare) == pytest.approx(changed, abs=1e-9)
    assert filtered(model, effect) - filtered(bare, effect) == pytest.approx(changed, abs=1e-9)
    assert arrays(model) - arrays(bare) == pytest.approx(changed, abs=1e-9)


@pytest.mark.parametrize("name", [*ON_BALL, "servo_gain", "servo_lag", "axis_coupling", "tilt_gain"])
def test_the_derivatives_of_the_step_are_those_of_differences(name):
    effect = EVERY[name]
    model = model_with(effect) if effect.acts in BALL else part_with(effect)
    p = model.ring_parameters(RING, RADIUS).pack()
    x = np.array([AT[0], AT[1], 0.03, 0.2, -0.02, -0.3, 0.04, -0.05])
    out, A, B = np.empty(6), np.empty((6, 6)), np.empty((6, 2))
    ring_dynamics.linearise(x[:6], x[6:], p, out, A, B)

    def step(x):
        after = np.empty(6)
        ring_dynamics.step(np.ascontiguousarray(x[:6]), np.ascontiguousarray(x[6:]), p, after)
        return after

    np.testing.assert_array_equal(step(x), out)
    np.testing.assert_allclose(np.hstack([A, B]), jacobian(step, x, 1e-4), rtol=1e-6, atol=1e-6)


def part_with(effect: Effect) -> RigModel:
    """A model in whose part the effect is off by twice its smallest size."""
    values = {n: p.default + (2.0 if p.default < p.high else -2.0) * p.smallest for n, p in effect.parameters.items()}
    return with_part(RigModel.nominal(MAZE), effect, values, {})


@pytest.mark.parametrize("name", PARTS)
def test_an_effect_of_a_part_acts_where_that_part_is_used(name):
    effect, plain = EVERY[name], RigModel.nominal(MAZE)
    model = part_with(effect)
    assert part_values(model, effect) != part_values(plain, effect)
    if effect.acts == CAMERA:
        seen = model.camera.seen(0.05, -0.03)
        assert model.camera.true(*seen) == pytest.approx((0.05, -0.03), abs=1e-9)
        assert seen != (0.05, -0.03) or model.camera_delay > 0.0
        return
    if name in ("command_delay", "backlash", "deadband", "rate_limit"):  # a held command does not show these
        assert model.stage != plain.stage
        return
    assert effect.acts in (STAGE, TILT_SENSOR)
    tilts = [settled(m) for m in (model, plain)]
    assert np.max(np.abs(tilts[0][0] - tilts[0][1])) < 1e-9, "planner's step and planar prediction"
    assert np.max(np.abs(tilts[0][0] - tilts[1][0])) > 1e-5


def settled(model: RigModel) -> tuple[np.ndarray, np.ndarray]:
    """Tilts and rates (4,) under a held command: late, where the lag has no say; and, for the lag, those of the
    planner's table against those that the planar model's numbers give."""
    p = model.ring_parameters(RING, RADIUS).pack()
    u, s, out = np.array([0.04, -0.03]), np.zeros(6), np.empty(6)
    planar = model.planar(MAZE)
    ring_dynamics.step(s, u, p, out)
    first = out[2:].copy()
    for _ in range(300):
        ring_dynamics.step(s, u, p, out)
        s[:] = out
    z = np.zeros(8)
    for _ in range(20000):
        stage_step(z, u[0], u[1], planar.stage, 1e-3)
    exact = []
    for i, (own, other) in enumerate(((u[0], u[1]), (u[1], u[0]))):
        gain, wn, zeta, offset, coupling, _ = planar.stage[i]
        rest = gain * (own + coupling * other) + offset
        M = second_order_transition(wn, zeta, 1.0 / 30.0)
        exact += [rest * (1.0 - M[0, 0]), -rest * M[1, 0]]
    return np.concatenate([s[2:], first]), np.concatenate([z[4:], exact])


@pytest.mark.parametrize("name", EVERY)
def test_it_survives_the_model_file_or_says_why_it_is_not_planned(name, tmp_path):
    effect = EVERY[name]
    if effect.acts not in BALL:
        model = part_with(effect)
        save_model(model, tmp_path)
        again = load_model(tmp_path)
        assert part_values(again, effect) == pytest.approx(part_values(model, effect), rel=1e-5)
        return
    model = replace(RigModel.nominal(MAZE), balls={RING: BallModel((effect(**sized(effect)),))})
    save_model(model, tmp_path)
    (term,) = load_model(tmp_path).ball(RING).effects
    assert term.effect is effect
    assert term.values() == pytest.approx(sized(effect), rel=1e-5)
    assert effect.planned == (not effect.why_not)
    if not effect.planned:
        assert term not in model.ball(RING).planned
        plain = replace(model, balls={RING: BallModel()}).ring_parameters(RING, RADIUS)
        assert model.ring_parameters(RING, RADIUS) == plain, "a plan leaves it out"


@pytest.mark.parametrize("name", EVERY)
def test_the_registry_says_what_people_need(name):
    told = registry.document(EVERY[name])
    assert told["formula"]
    assert EVERY[name].text
    assert all(p["low"] <= p["default"] <= p["high"] for p in told["parameters"].values())
    assert (told["why_not"] is None) == told["planned"]
