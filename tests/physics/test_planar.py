"""The planar model: gravity gain, walls, openings, and commands that act when they should."""

from __future__ import annotations

import math

import numpy as np
import pytest
from planar_rig import known

from mazeplan.core.constants import FREE_ROLLING, GRAVITY
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.dynamics.planar import contact, predict, predict_given_tilt, ring_index

MAZE = load_map("cme")
PLANAR = known(MAZE).planar(MAZE)
RADIUS = MAZE.ball.radius


def at(r: float, theta: float, vr: float = 0.0, vt: float = 0.0) -> np.ndarray:
    c, s = math.cos(theta), math.sin(theta)
    return np.array([r * c, r * s, vr * c - vt * s, vr * s + vt * c, 0.0, 0.0, 0.0, 0.0])


def held_tilt(z: np.ndarray, duration: float, beta: float, gamma: float) -> None:
    p = PLANAR
    times, tilts = np.array([0.0]), np.array([[beta, gamma]])
    predict_given_tilt(z, 0.0, duration, times, tilts, p.scalars, p.rings, p.walls, p.gaps)


@pytest.mark.parametrize(
    ("beta", "gamma", "direction"), [(0.05, 0.0, (1.0, 0.0)), (-0.05, 0.0, (-1.0, 0.0)), (0.0, 0.05, (0.0, -1.0))]
)
def test_free_ball_rolls_down_with_five_sevenths(beta, gamma, direction):
    z = at(0.0, 0.0)
    duration = 0.05  # s: too short to reach the wall of the disc
    held_tilt(z, duration, beta, gamma)
    expected = FREE_ROLLING * GRAVITY * math.sin(0.05) * duration
    viscous = 0.02  # relative; the nominal model has some
    assert np.allclose(z[2:4], expected * np.array(direction), rtol=viscous, atol=1e-9)


def test_along_a_wall_the_factor_of_the_ring_counts():
    ring = MAZE.ring(1)
    z = at(ring.inner_radius + RADIUS, 0.0)  # on the inner wall, at theta = 0 (no opening there)
    held_tilt(z, 0.05, -0.02, -0.05)  # leans inwards, and along +theta
    factor = RigModel.nominal(MAZE).ball(1).parameter("rolling_inertia", "factor", 1.0)
    assert z[3] / 0.05 == pytest.approx(factor * GRAVITY * math.sin(0.05), rel=0.03)


@pytest.mark.parametrize("seed", range(3))
def test_the_ball_never_enters_a_wall(seed):
    rng = np.random.default_rng(seed)
    z = at(MAZE.track_radius(1), 1.0)
    for _ in range(600):
        held_tilt(z, 1.0 / 30.0, *rng.uniform(-0.0873, 0.0873, 2))
        before = z.copy()
        contact(z, RADIUS, PLANAR.rings, PLANAR.walls, PLANAR.gaps, 0.0)
        assert np.hypot(*(z[:2] - before[:2])) < 2e-4  # m; what the last contact of a corner may leave
        assert np.hypot(*z[:2]) <= MAZE.ring(1).outer_radius - RADIUS + 1e-9


@pytest.mark.parametrize("opening", MAZE.openings, ids=lambda o: o.name)
@pytest.mark.parametrize("inwards", [True, False])
def test_every_opening_lets_the_ball_through_both_ways(opening, inwards):
    start = opening.outer if inwards else opening.inner
    z = at(MAZE.track_radius(start), opening.angle)
    tilt = -0.08 if inwards else 0.08  # acceleration along the opening's middle line, over g
    held_tilt(z, 0.5, tilt * math.cos(opening.angle), -tilt * math.sin(opening.angle))
    assert ring_index(math.hypot(z[0], z[1]), PLANAR.rings) + 1 == opening.leads_to(start)


def test_a_wall_without_opening_holds_the_ball():
    z = at(MAZE.track_radius(1), 0.0)
    held_tilt(z, 1.0, -0.08, 0.0)
    assert math.hypot(z[0], z[1]) == pytest.approx(MAZE.ring(1).inner_radius + RADIUS, abs=1e-6)


def test_commands_act_from_their_moment_on():
    late, early = at(0.0, 0.0), at(0.0, 0.0)
    commands = np.array([[0.0, 0.0], [0.08, 0.0]])
    predict(late, 0.0, 0.1, np.array([-1.0, 0.09]), commands, *PLANAR)
    predict(early, 0.0, 0.1, np.array([-1.0, 0.01]), commands, *PLANAR)
    assert late[4] < 0.1 * early[4]
    still = at(0.0, 0.0)
    predict(still, 0.0, 0.1, np.array([-1.0, 0.5]), commands, *PLANAR)
    assert np.all(still == 0.0)


def test_the_servo_reaches_the_command_as_a_second_order_lag():
    z = at(0.0, 0.0)
    predict(z, 0.0, 0.1, np.array([0.0]), np.array([[0.05, -0.03]]), *PLANAR)
    axis = RigModel.nominal(MAZE).stage.beta
    wn, zeta, t = axis.natural_frequency, axis.damping, 0.1
    wd = wn * math.sqrt(1.0 - zeta**2)
    step = 1.0 - math.exp(-zeta * wn * t) * (math.cos(wd * t) + zeta * wn / wd * math.sin(wd * t))
    assert z[4] == pytest.approx(0.05 * step, rel=0.03)
    assert z[6] == pytest.approx(-0.03 * step, rel=0.03)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_sides_of_an_opening_hold_the_ball(side):
    opening = MAZE.opening("1-2@45")
    z = at(MAZE.threshold_radius(opening), opening.angle)
    c, s = math.cos(opening.angle), math.sin(opening.angle)
    pull = 0.05 * side  # across the opening: too short a time to leave it along its middle line
    held_tilt(z, 0.12, -s * pull, -c * pull)
    assert -s * z[0] + c * z[1] == pytest.approx(side * (0.5 * opening.width - RADIUS), abs=1e-5)
