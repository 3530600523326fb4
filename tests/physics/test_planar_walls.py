"""Radial walls in the planar model: the ball leans on them, bounces off, and never comes to the other side."""

from __future__ import annotations

import math

import numpy as np
import pytest
from planar_rig import known

from mazeplan.maze.mapfile import load_map
from mazeplan.physics.dynamics.planar import RESTITUTION, SUBSTEP, contact, predict_given_tilt

MAZE = load_map("detour")
PLANAR = known(MAZE).planar(MAZE)
RADIUS = MAZE.ball.radius
WALLS = MAZE.radial_walls


def at(ring: int, theta: float, along: float = 0.0) -> np.ndarray:
    """A ball on the track of a ring, with a speed along it, m/s."""
    r, c, s = MAZE.track_radius(ring), math.cos(theta), math.sin(theta)
    return np.array([r * c, r * s, -along * s, along * c, 0.0, 0.0, 0.0, 0.0])


def tilted(z: np.ndarray, duration: float, beta: float, gamma: float) -> None:
    p = PLANAR
    times, tilts = np.array([0.0]), np.array([[beta, gamma]])
    predict_given_tilt(z, 0.0, duration, times, tilts, p.scalars, p.rings, p.walls, p.gaps)


def across(z: np.ndarray, angle: float) -> float:
    return -math.sin(angle) * z[0] + math.cos(angle) * z[1]


def test_all_openings_and_radial_walls_of_a_map_are_in_its_arrays():
    planar = known(load_map("cme")).planar(load_map("cme"))
    assert planar.walls.shape == (4, 6)
    assert len(planar.gaps) == 13
    assert PLANAR.walls.shape == (3, 6)
    assert len(PLANAR.gaps) == len(MAZE.openings) + len(WALLS)


@pytest.mark.parametrize("wall", WALLS, ids=lambda wall: wall.name)
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_ball_that_is_pushed_against_a_wall_stays_on_its_side_and_touches_it(wall, side):
    z = at(wall.ring, wall.angle + side * 0.5)
    c, s, pull = math.cos(wall.angle), math.sin(wall.angle), -side * math.radians(5.0)
    for _ in range(60):
        tilted(z, 1.0 / 30.0, -s * pull, -c * pull)
        assert side * across(z, wall.angle) >= 0.5 * wall.thickness + RADIUS - 1e-9
    assert side * across(z, wall.angle) == pytest.approx(0.5 * wall.thickness + RADIUS, abs=1e-4)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_fastest_ball_gives_back_what_the_wall_does_not_take(side):
    wall = WALLS[0]
    z = at(wall.ring, wall.angle + side * (0.5 * wall.thickness + RADIUS + 1e-3) / MAZE.track_radius(1), -side * 1.0)
    for _ in range(3):
        tilted(z, SUBSTEP, 0.0, 0.0)
    speed = -math.sin(wall.angle) * z[2] + math.cos(wall.angle) * z[3]
    assert side * speed == pytest.approx(RESTITUTION, rel=0.1)


@pytest.mark.parametrize("seed", range(2))
def test_a_ball_that_is_shaken_changes_its_sector_through_openings_only(seed):
    rng = np.random.default_rng(seed)
    z = at(2, math.radians(320.0))
    ring, sector = 2, MAZE.sector(2, math.radians(320.0))
    changed = 0
    for _ in range(1500):
        tilted(z, 1.0 / 30.0, *rng.uniform(-0.0873, 0.0873, 2))
        r, theta = math.hypot(z[0], z[1]), math.atan2(z[1], z[0])
        now = MAZE.ring_at(r)
        if now == ring:
            assert MAZE.sector(ring, theta) == sector
        changed += now != ring
        ring, sector = now, MAZE.sector(now, theta)
    assert changed > 0


def test_an_estimate_inside_a_wall_is_moved_to_the_nearer_side():
    wall = WALLS[0]
    for side in (-1.0, 1.0):
        z = at(wall.ring, wall.angle + side * 0.01)
        assert contact(z, RADIUS, PLANAR.rings, PLANAR.walls, PLANAR.gaps, 0.0)
        assert across(z, wall.angle) == pytest.approx(side * (0.5 * wall.thickness + RADIUS))


def test_the_wall_of_one_ring_is_none_in_the_next():
    wall = next(w for w in WALLS if w.ring == 1)
    z = at(2, wall.angle)
    assert not contact(z, RADIUS, PLANAR.rings, PLANAR.walls, PLANAR.gaps, 0.0)
    z = at(1, wall.angle + math.pi)  # nor on the other side of the centre
    assert not contact(z, RADIUS, PLANAR.rings, PLANAR.walls, PLANAR.gaps, 0.0)
