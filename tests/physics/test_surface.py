"""What the floor of a ring adds, as the planner and the prediction have it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mazeplan.maze.mapfile import load_map
from mazeplan.models.modelfile import load_model
from mazeplan.physics import ring_dynamics
from mazeplan.physics.ball import constant_torque, surface_bump, surface_profile
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.planar import PlanarModel, predict_given_tilt
from mazeplan.physics.ring_parameters import RingParameters

MAZE = load_map("cme")
FLOOR = (constant_torque(0.2), surface_profile(0.1, -0.2, 0.3, 0.5, -0.1, 0.2), surface_bump(1.0, 0.2, -2.0))


def floor(theta):
    """rad/s^2, written out."""
    c, s = [[f(n * theta) for n in (1, 2, 3)] for f in (np.cos, np.sin)]
    away = (theta - 1.0) / 0.2
    waves = 0.1 * c[0] - 0.2 * s[0] + 0.3 * c[1] + 0.5 * s[1] - 0.1 * c[2] + 0.2 * s[2]
    return 0.2 + waves - 2.0 * away * np.exp(0.5 - 0.5 * away**2)


def test_a_plan_knows_the_floor_and_its_derivatives():
    p, s, u = RingParameters(0.09, FLOOR).pack(), np.array([1.2, 0.3, 0.01, 0.0, -0.02, 0.0]), np.array([0.01, 0.02])
    out, A, B = np.empty(6), np.empty((6, 6)), np.empty((6, 2))
    ring_dynamics.linearise(s, u, p, out, A, B)
    for j in range(6):
        ends = []
        for sign in (1.0, -1.0):
            end = np.empty(6)
            ring_dynamics.step(s + sign * 1e-6 * np.eye(6)[j], u, p, end)
            ends.append(end)
        assert A[:, j] == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=1e-5)
    flat = np.empty(6)
    ring_dynamics.step(s, u, RingParameters(0.09).pack(), flat)
    assert out[1] - flat[1] == pytest.approx(floor(1.2) / 30.0, rel=0.1)


def test_the_prediction_knows_the_floor():
    model = load_model("ideal")
    plain = PlanarModel.build(MAZE, model)
    ball = BallModel((*model.ball(1).effects, surface_bump(0.0, 0.3, -3.0)))
    bent = PlanarModel.build(MAZE, replace(model, balls={**model.balls, 1: ball}))
    moved = []
    for p in (plain, bent):
        z = np.zeros(8)
        z[:2] = MAZE.track_radius(1) * np.array([np.cos(0.3), np.sin(0.3)])
        predict_given_tilt(z, 0.0, 0.3, np.array([0.0]), np.zeros((1, 2)), p.scalars, p.rings, p.walls, p.gaps)
        moved.append(np.arctan2(z[1], z[0]))
    assert moved[0] == pytest.approx(0.3)
    assert 0.1 < moved[1] < 0.25, "towards the spot"
