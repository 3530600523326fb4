"""The camera by where the ball can be, on places drawn for it."""

from __future__ import annotations

import numpy as np
import pytest

from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.maze_camera import camera_effects, fit_camera
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.rig.sensors import Camera

pytestmark = pytest.mark.slow

MAZE, NOISE = load_map("cme"), 6e-4


def places(camera, seed=0, n=3000, sides=(0.3, 0.4, 0.3)):
    """A record of a ball that is in each ring in turn, at either wall or between, as a camera sees it."""
    rng = np.random.default_rng(seed)
    x, y = np.empty(n), np.empty(n)
    rings, ball = MAZE.rings[:4], MAZE.ball.radius
    for i in range(n):
        ring = rings[i * len(rings) // n]
        low, high = ring.inner_radius + ball, ring.outer_radius - ball
        r = (low, rng.uniform(low, high), high)[rng.choice(3, p=sides)]
        angle = rng.uniform(-np.pi, np.pi)
        x[i], y[i] = camera.seen(r * np.cos(angle), r * np.sin(angle))
    x, y = x + NOISE * rng.standard_normal(n), y + NOISE * rng.standard_normal(n)
    zero = np.zeros(n)
    t = np.arange(n) / 30.0
    return Table({"t": t, "x": x, "y": y, "r": np.hypot(x, y), "beta": zero, "gamma": zero, "segment": zero})


@pytest.mark.parametrize(
    ("camera", "names"),
    [
        (Camera(), []),
        (Camera(offset_x=0.004, offset_y=-0.002), ["camera_offset"]),
        (Camera(scale=1.03), ["camera_scale"]),
        (Camera(scale=0.975, offset_x=-0.003), ["camera_offset", "camera_scale"]),
        (Camera(distortion=5.0), ["lens_distortion"]),
    ],
)
def test_what_is_off_is_named_with_its_size(camera, names):
    found, right = camera_effects(places(camera), MAZE, Camera())
    assert [effect["name"] for effect in found] == names
    for field, exact in (("offset_x", 1.5e-4), ("offset_y", 1.5e-4), ("scale", 2e-3), ("distortion", 0.4)):
        assert getattr(right, field) == pytest.approx(getattr(camera, field), abs=exact), field
    for effect in found:
        for number in effect["parameters"].values():
            assert number["stderr"] < 0.05 * max(abs(number["value"]), 0.01)


def test_noise_and_errors_are_those_of_the_record():
    drawn = [fit_camera(places(Camera(), seed, 2400), MAZE, Camera()) for seed in range(6)]
    assert np.mean([p.noise for p in drawn]) == pytest.approx(NOISE, rel=0.1)
    for field in ("offset_x", "scale"):
        spread = np.std([getattr(p.camera, field) for p in drawn])
        assert 0.3 * drawn[0].stderr[field] < spread < 3.0 * drawn[0].stderr[field]


def test_what_the_model_knew_is_no_news():
    camera = Camera(offset_x=0.004, scale=1.03)
    found, right = camera_effects(places(camera), MAZE, camera)
    assert found == []
    assert right == camera


def test_of_a_ball_that_keeps_to_one_side_nothing_is_said():
    found, right = camera_effects(places(Camera(scale=1.02), sides=(0.0, 0.0, 1.0)), MAZE, Camera())
    assert found is None
    assert right == Camera()
    short = places(Camera(), n=300)
    assert camera_effects(short, MAZE, Camera())[0] is None
