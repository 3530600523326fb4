"""Rendered pictures show what is there, where an independent projection puts it."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scenes import MAZE, STANDARD, R, overlooking, place

from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.camera.look import Look
from mazeplan.rigs.camera.render import TRUE, Overhead

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


def test_walls_have_height():
    # the outer edge of the rim's top is seen further out than its foot is
    picture = overlooking(PLAIN).render(None, 0.0, 0.0, rng())
    rim = MAZE.walls[0].outer_radius
    top = TRUE.project(np.array([[rim * math.cos(0.3) * 0.995, rim * math.sin(0.3) * 0.995, MAZE.wall_height]]))[0]
    foot = TRUE.project(np.array([[rim * math.cos(0.3) * 0.995, rim * math.sin(0.3) * 0.995, 0.0]]))[0]
    middle = 0.5 * (TRUE.matrix[:2, 2] + TRUE.matrix[:2, 2])
    assert np.linalg.norm(top - middle) > np.linalg.norm(foot - middle) + 5.0
    blue = picture[round(top[1]), round(top[0])].astype(int)
    assert blue[0] > blue[2] + 30


def test_a_lamp_casts_the_balls_shadow_away_from_it():
    look = replace(PLAIN, lamp=(-0.6, 0.0, 0.5))
    change = difference(np.array([0.0, 0.0, R]), 0.0, 0.0, look)
    expected = TRUE.project(np.array([[0.0, 0.0, R]]))[0]
    ys, xs = np.nonzero(np.abs(change[..., 2]) > 20.0)
    outside = np.hypot(xs - expected[0], ys - expected[1]) > 14.0
    assert outside.sum() > 30
    assert xs[outside].mean() > expected[0] + 8.0


def test_light_noise_and_flicker():
    base = overlooking(PLAIN).render(None, 0.0, 0.0, rng()).astype(float)
    dim = overlooking(replace(PLAIN, exposure=0.5)).render(None, 0.0, 0.0, rng()).astype(float)
    assert np.median(dim / np.maximum(base, 1.0)) == pytest.approx(0.5, abs=0.02)
    noisy = overlooking(replace(PLAIN, noise=4.0))
    one, two = (noisy.render(None, 0.0, 0.0, np.random.default_rng(seed)).astype(float) for seed in (1, 2))
    assert (one - two).std() == pytest.approx(4.0 * math.sqrt(2.0), rel=0.1)
    assert np.array_equal(one, noisy.render(None, 0.0, 0.0, np.random.default_rng(1)))


def test_radial_walls_are_in_the_picture():
    maze = load_map("detour")
    picture = Overhead(maze, TRUE, PLAIN).render(None, 0.0, 0.0, rng()).astype(int)
    for wall in maze.radial_walls:
        r = maze.track_radius(wall.ring)
        tops = [[r * math.cos(wall.angle), r * math.sin(wall.angle), maze.wall_height]]
        across, down = np.round(TRUE.project(np.array(tops))[0]).astype(int)
        assert picture[down, across, 0] > picture[down, across, 2] + 30  # blue, as the rim's top is
