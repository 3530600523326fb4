"""Pixel observations of a maze larger than the packaged one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.camera.sensing import RenderedPictures


@pytest.mark.parametrize("name", ["cme", "seven"])
def test_the_ball_is_in_the_small_picture_wherever_it_is(name):
    maze = load_map(name)
    pictures, radius = RenderedPictures(maze), maze.track_radius(1)
    seen = []
    for k in range(8):
        angle = math.tau * k / 8
        ball = [radius * math.cos(angle), radius * math.sin(angle), maze.ball.radius]
        seen.append(pictures.small(np.array([*ball, 0.0, 0.0]), np.random.default_rng(0), 96).astype(int))
    empty = np.median(seen, axis=0)
    for k, picture in enumerate(seen):
        changed = np.argwhere(np.abs(picture - empty).sum(axis=-1) > 60)
        assert len(changed) >= 3, k
        down, across = changed.mean(axis=0) - 47.5
        assert math.remainder(math.atan2(-down, across) - math.tau * k / 8, math.tau) == pytest.approx(0.0, abs=0.1), k
