"""Radial walls of the simulated rig: where the map has them, without a hole beside them; the ball in front of them."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from test_mjcf import built

from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.sim.simulated import SimulatedRig

MAZE = load_map("detour")
WALLS = MAZE.radial_walls
HEIGHT = 6.35e-3  # m, of rays: where the ball touches a wall


def ray(simulation, start, direction):
    """Distance from a point of the plate to the first wall that way."""
    model, data = simulation
    model.geom_group[[i for i in range(model.ngeom) if (model.geom(i).name or "").startswith("plug:")]] = 5
    groups = np.array([1, 1, 1, 1, 1, 0], dtype=np.uint8)
    found = np.zeros(1, dtype=np.int32)
    at = np.array([*start, HEIGHT])
    return mujoco.mj_ray(model, data, at, np.array([*direction, 0.0]), groups, 1, -1, found, None)


@pytest.fixture(scope="module")
def simulation():
    return built(MAZE)


@pytest.mark.parametrize("wall", WALLS, ids=lambda wall: wall.name)
def test_radial_walls_are_where_the_map_has_them(simulation, wall):
    ring, c, s = MAZE.ring(wall.ring), math.cos(wall.angle), math.sin(wall.angle)
    for r in np.linspace(ring.inner_radius + 1e-4, ring.outer_radius - 1e-4, 9):
        for side in (-1.0, 1.0):
            away = side * 0.012
            start = np.array([c * r - s * away, s * r + c * away])
            distance = ray(simulation, start, (side * s, -side * c))
            if math.hypot(*start) < ring.outer_radius - 2e-4:  # else it begins in the wall around the ring
                assert distance == pytest.approx(0.012 - 0.5 * wall.thickness, abs=1e-5)


@pytest.fixture(scope="module")
def rig():
    rig = SimulatedRig(MAZE, {})
    yield rig
    rig.close()


@pytest.mark.parametrize("index", [0, 2])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_ball_pushed_against_a_wall_rests_there(rig, index, side):
    wall = WALLS[index]
    rig.reset(ring=wall.ring, theta=wall.angle + side * 0.4, rng=np.random.default_rng(1))
    c, s, pull = math.cos(wall.angle), math.sin(wall.angle), -side * MAZE.tilt_limit
    across = 0.0
    for _ in range(60):
        seen = rig.observe()
        across = side * (-s * seen.x + c * seen.y)
        assert across > 0.5 * wall.thickness + MAZE.ball.radius - 5e-4
        rig.command(-s * pull, -c * pull)
    assert across == pytest.approx(0.5 * wall.thickness + MAZE.ball.radius, abs=5e-4)


def test_no_ball_is_placed_in_a_wall(rig):
    wall = WALLS[0]
    rig.reset(ring=wall.ring, theta=wall.angle - 0.02, rng=np.random.default_rng(1))
    seen = rig.observe()
    across = -math.sin(wall.angle) * seen.x + math.cos(wall.angle) * seen.y
    assert across == pytest.approx(-(0.5 * wall.thickness + MAZE.ball.radius), abs=4e-4)
