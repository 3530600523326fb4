"""Rendered pictures show what is there, where an independent projection puts it."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from emulator.look import Look
from emulator.render import TRUE, Overhead
from scenes import STANDARD, R, overlooking, place

from mazeplan.maze.mapfile import load_map

PLAIN = Look(ball="orange", noise=0.0, flicker=0.0, slope=0.0, gloss=0.0)


def rng():
    return np.random.default_rng(0)


def difference(ball, beta, gamma, look=PLAIN):
    eye = overlooking(look)
    with_ball = eye.render(ball, beta, gamma, rng()).astype(float)
    return with_ball - eye.render(None, beta, gamma, rng())


@pytest.mark.parametrize(("ball", "beta", "gamma"), [STANDARD[0], STANDARD[4], STANDARD[8], STANDARD[9]])
def test_the_ball_is_drawn_where_opencv_projects_it(ball, beta, gamma):
    # orange takes blue away as no shadow does; the shine on it does not reach its edge
    orange = difference(ball, beta, gamma)[..., 0] < -100.0
    hull = cv2.convexHull(np.argwhere(orange)[:, ::-1].astype(np.float32))
    (x, y), radius = cv2.minEnclosingCircle(hull)
    expected = TRUE.project(ball[None], beta, gamma)[0]
    assert math.hypot(x - expected[0], y - expected[1]) < 0.8
    assert radius == pytest.approx(R * 1200.0 / 0.614, abs=1.0)


def test_walls_hide_part_of_a_ball_behind_them():
    eye = TRUE.centre()
    ball = place(1, 200.0, -0.00135)  # against the wall towards the camera
    far = place(1, 200.0, 0.00135)
    assert math.hypot(*(eye[:2] - ball[:2])) > 0.05
    hidden, open_ = (np.count_nonzero(difference(b, 0.0, 0.0)[..., 0] < -60.0) for b in (ball, far))
    assert hidden < 0.97 * open_


def test_radial_walls_are_in_the_picture():
    maze = load_map("detour")
    picture = Overhead(maze, TRUE, PLAIN).render(None, 0.0, 0.0, rng()).astype(int)
    for wall in maze.radial_walls:
        r = maze.track_radius(wall.ring)
        tops = [[r * math.cos(wall.angle), r * math.sin(wall.angle), maze.wall_height]]
        across, down = np.round(TRUE.project(np.array(tops))[0]).astype(int)
        assert picture[down, across, 0] > picture[down, across, 2] + 30  # blue, as the rim's top is
