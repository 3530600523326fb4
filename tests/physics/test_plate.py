"""What a plate does to things on it, against rotation matrices and differences."""

from __future__ import annotations

import numpy as np

from mazeplan.core.constants import GRAVITY
from mazeplan.physics.dynamics.plate import FELT_AT, ROW, PlateMotion, Tilting, plate_rows

STEP = 1.0 / 180.0


def angles(t):
    """beta, gamma with two derivatives each, (6,)."""
    b, c = 0.07 * np.sin(3.0 * t), 0.05 * np.cos(4.0 * t + 0.3)
    b1, c1 = 0.21 * np.cos(3.0 * t), -0.2 * np.sin(4.0 * t + 0.3)
    return np.array([b, b1, -9.0 * b, c, c1, -16.0 * c])


def standing(t, tilting):
    """Ry(beta) Rx(gamma) at t."""
    w = angles(t)
    b = tilting.gain_beta * w[0] + tilting.cross_beta * w[3] + tilting.tilt_beta
    c = tilting.gain_gamma * w[3] + tilting.cross_gamma * w[0] + tilting.tilt_gamma
    about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(c), -np.sin(c)], [0, np.sin(c), np.cos(c)]])
    return about_y @ about_x


def omega(t, tilting):
    """Angular velocity in the plate's frame by differences."""
    d = 1e-4
    skew = standing(t, tilting).T @ (standing(t + d, tilting) - standing(t - d, tilting)) / (2.0 * d)
    return np.array([skew[2, 1], skew[0, 2], skew[1, 0]])


def test_rows_are_gravity_and_rotation_of_the_plate():
    grid = STEP * np.arange(400)
    plate = PlateMotion(0.0, STEP, np.array([angles(t) for t in grid]))
    tilting = Tilting(1.1, 0.9, 0.05, -0.04, 0.01, -0.02)
    out = np.zeros((2 * 3, ROW))
    plate_rows(plate, tilting, np.array([0.5, 1.2]), 0.01, 3, out)
    for row, t in zip(out, [0.505, 0.515, 0.525, 1.205, 1.215, 1.225], strict=True):
        gravity = standing(t, tilting).T @ np.array([0.0, 0.0, -GRAVITY])
        rate = (omega(t + 1e-3, tilting) - omega(t - 1e-3, tilting)) / 2e-3
        np.testing.assert_allclose(row[FELT_AT : FELT_AT + 3], gravity, atol=1e-5)
        np.testing.assert_allclose(row[FELT_AT + 3 : FELT_AT + 6], omega(t, tilting), atol=1e-5)
        np.testing.assert_allclose(row[FELT_AT + 6 : FELT_AT + 9], rate, atol=3e-3)


def test_motion_is_held_beyond_the_ends():
    plate = PlateMotion(0.0, STEP, np.array([angles(t) for t in STEP * np.arange(50)]))
    out = np.zeros((2, ROW))
    plate_rows(plate, Tilting(), np.array([-1.0, 9.0]), 0.0, 1, out)
    np.testing.assert_allclose(out[0, :6], angles(0.0), atol=1e-6)
    np.testing.assert_allclose(out[1, :6], angles(49 * STEP), atol=1e-4)
