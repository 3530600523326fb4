"""What the floor of a ring adds: one number by three routes, and its slope."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mazeplan.maze.mapfile import load_map
from mazeplan.models import ring_dynamics, surface
from mazeplan.models.ball import BallModel
from mazeplan.models.effects import ConstantTorque, RingKinematics, SurfaceBump, SurfaceProfile
from mazeplan.models.modelfile import load_model
from mazeplan.models.planar import PlanarModel, predict_given_tilt
from mazeplan.models.ring_parameters import RingParameters

MAZE = load_map("cme")
FLOOR = BallModel((ConstantTorque(0.2), SurfaceProfile(0.1, -0.2, 0.3, 0.5, -0.1, 0.2), SurfaceBump(1.0, 0.2, -2.0)))


def kinematics(theta):
    zero = np.zeros_like(theta)
    return RingKinematics(0.09, theta, zero, zero, zero, zero, zero, zero, zero)


def test_compiled_and_effects_agree_in_force_and_slope():
    theta, p = np.linspace(-4.0, 4.0, 50), np.concatenate([[7.0], surface.pack(FLOOR)])
    k = kinematics(theta)
    assert [surface.force(p, 1, x) for x in theta] == pytest.approx(sum(e.term(k) for e in FLOOR.effects))
    assert [surface.slope(p, 1, x) for x in theta] == pytest.approx(sum(e.jacobian(k)[:, 0] for e in FLOOR.effects))
    h = 1e-6
    differences = [(surface.force(p, 1, x + h) - surface.force(p, 1, x - h)) / (2 * h) for x in theta]
    assert [surface.slope(p, 1, x) for x in theta] == pytest.approx(differences, abs=1e-6)


def test_a_plan_knows_the_floor_and_its_derivatives():
    parameters = replace(RingParameters(0.09), surface=tuple(surface.pack(FLOOR)))
    p, s, u = parameters.pack(), np.array([1.2, 0.3, 0.01, 0.0, -0.02, 0.0]), np.array([0.01, 0.02])
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
    expected = sum(e.term(kinematics(np.array([1.2])))[0] for e in FLOOR.effects) / 30.0
    assert out[1] - flat[1] == pytest.approx(expected, rel=0.1)


def test_the_prediction_knows_the_floor():
    model = load_model("ideal")
    plain = PlanarModel.build(MAZE, model)
    assert plain.rings.shape == (5, 5), "as ever, where there is none"
    ball = BallModel((*model.ball(1).effects, SurfaceBump(0.0, 0.3, -3.0)))
    bent = PlanarModel.build(MAZE, replace(model, balls={**model.balls, 1: ball}))
    moved = []
    for p in (plain, bent):
        z = np.zeros(8)
        z[:2] = MAZE.track_radius(1) * np.array([np.cos(0.3), np.sin(0.3)])
        predict_given_tilt(z, 0.0, 0.3, np.array([0.0]), np.zeros((1, 2)), p.scalars, p.bias, p.rings, p.walls, p.gaps)
        moved.append(np.arctan2(z[1], z[0]))
    assert moved[0] == pytest.approx(0.3)
    assert 0.1 < moved[1] < 0.25, "towards the spot"
