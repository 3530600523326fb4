"""The generated model: openings as wide as the map says through the whole wall, and walls without holes."""

from __future__ import annotations

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module tells type checkers nothing of its names)
import math
from functools import cache

import mujoco
import numpy as np
import pytest

from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.files import validated
from mazeplan.rigs.sim.mjcf import CHEEK, mjcf
from mazeplan.rigs.sim.settings import SimulatedSettings
from mazeplan.rigs.sim.simulated import SimulatedRig

MAZES = {name: load_map(name) for name in ("cme", "lopsided")}
OPENINGS = [(name, opening.name) for name, maze in MAZES.items() for opening in maze.openings]
PLACES = ("inner", "middle", "outer")

every_opening = pytest.mark.parametrize(("name", "opening"), OPENINGS, ids=[f"{m}-{o}" for m, o in OPENINGS])


@cache
def machine(name, segments=360):
    """Model and data of a map, plate level, ball far above everything."""
    return built(MAZES[name], segments)


def built(maze, segments=360):
    model = mujoco.MjModel.from_xml_string(mjcf(maze, validated(SimulatedSettings, {"wall_segments": segments})))
    data = mujoco.MjData(model)
    data.qpos[2:6] = 0.0, 0.0, 1.0, 1.0
    mujoco.mj_forward(model, data)
    return model, data


def wall_of(maze, opening):
    return next(wall for wall in maze.walls if opening in wall.openings)


def frame(opening):
    """Unit vectors along the opening's middle line and across it."""
    c, s = math.cos(opening.angle), math.sin(opening.angle)
    return np.array([c, s]), np.array([-s, c])


def solid(simulation, points, margin):
    """Which points (N, 2) lie in a wall's box that is `margin` larger all around (smaller: negative)."""
    model, data = simulation
    low, high = points.min(axis=0) - 5e-3, points.max(axis=0) + 5e-3
    places = data.geom_xpos[:, :2]
    boxes = np.flatnonzero(
        (model.geom_type == mujoco.mjtGeom.mjGEOM_BOX) & (places > low).all(axis=1) & (places < high).all(axis=1)
    )
    boxes = [i for i in boxes if not model.geom(i).name]  # walls have no names; the floor and plugs have
    inside = np.zeros(len(points), dtype=bool)
    for i in boxes:
        axes = data.geom_xmat[i].reshape(3, 3)[:2, :2]
        local = np.abs((points - data.geom_xpos[i, :2]) @ axes)
        inside |= np.all(local < model.geom_size[i, :2] + margin, axis=1)
    return inside


def grid(maze, opening, reach):
    """Points (N, 2) in and around an opening, along and across its middle line: also those coordinates."""
    wall = wall_of(maze, opening)
    along, across = np.meshgrid(
        np.arange(0.8 * wall.inner_radius, wall.outer_radius + 1e-3, 1e-4), np.arange(-reach, reach, 1e-4)
    )
    along, across = along.ravel(), across.ravel()
    forward, sideways = frame(opening)
    near = np.hypot(along, across) > wall.inner_radius - 3e-3  # further in there may be another wall
    along, across = along[near], across[near]
    return np.outer(along, forward) + np.outer(across, sideways), along, across


@every_opening
def test_openings_are_free_and_walls_beside_them_are_solid(name, opening):
    maze = MAZES[name]
    opening = maze.opening(opening)
    wall, half = wall_of(maze, opening), 0.5 * opening.width
    points, along, across = grid(maze, opening, half + 4e-3)
    r = np.hypot(along, across)
    free = (np.abs(across) < half - 1e-5) | (r < wall.inner_radius - 1e-5) | (r > wall.outer_radius + 5e-5)
    assert not solid(machine(name), points[free], 0.0).any()
    wall_itself = (np.abs(across) > half) & (r > wall.inner_radius + 5e-5) & (r < wall.outer_radius - 1e-4)
    away = np.hypot(along - math.sqrt(wall.outer_radius**2 - half**2), np.abs(across) - half) > 2.0 * CHEEK
    inside = solid(machine(name), points[wall_itself & away], 1e-5)
    assert inside.all(), points[wall_itself & away][~inside] * 1e3


@pytest.mark.parametrize(("name", "opening"), [("cme", "4-5@180"), ("cme", "3-4@45"), ("lopsided", "2-3@251")])
@pytest.mark.parametrize("place", PLACES)
def test_the_ball_slides_along_a_cheek_without_a_catch(name, opening, place):
    """A ball held against the side of an opening stops where ball and side touch, at the wall's inner circle too."""
    maze = MAZES[name]
    opening, ball = maze.opening(opening), maze.ball.radius
    wall, half = wall_of(maze, opening), 0.5 * opening.width
    first, last = (math.sqrt(r**2 - half**2) for r in (wall.inner_radius, wall.outer_radius))
    along = {"inner": first + 2e-4, "middle": 0.5 * (first + last), "outer": last - 4e-4}[place]
    forward, sideways = frame(opening)
    rig = SimulatedRig(maze, {"wall_grip": 0.0})
    rig.reset(ring=1, theta=0.0, rng=np.random.default_rng(0))
    data = rig.machine.gimbal.data
    assert data is not None
    for side in (-1.0, 1.0):
        data.qpos[2:5] = *(along * forward), ball
        data.qvel[:] = 0.0
        for _ in range(14):
            rig.observe()
            data.qpos[2:4] += forward * (along - data.qpos[2:4] @ forward)  # stays where it is along the opening
            data.qvel[2:4] = sideways * side * 0.02
        assert side * (rig.truth()[:2] @ sideways) == pytest.approx(half - ball, abs=0.1e-3)
