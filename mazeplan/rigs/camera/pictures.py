"""Pictures of the maze as a simulated overhead camera takes them, for people and for learners."""

from __future__ import annotations

import math

import cv2
import numpy as np

from mazeplan.maze.geometry import Maze
from mazeplan.records import Array
from mazeplan.rigs.camera.look import Look
from mazeplan.rigs.camera.render import Overhead
from mazeplan.rigs.camera.sensing import TRUE, over


class Pictures:
    """Draws what is to be seen, (5,) as `SimulatedRig.pictured`, in red, green, blue."""

    def __init__(self, maze: Maze) -> None:
        cv2.setNumThreads(1)  # the other cores are for other runs
        self._eye = Overhead(maze, over(TRUE, maze), Look(sharp=False))

    def whole(self, scene: Array, rng: np.random.Generator) -> np.ndarray:
        """(480, 640, 3), bytes."""
        ball = None if math.isnan(scene[0]) else scene[:3]
        return np.ascontiguousarray(self._eye.render(ball, float(scene[3]), float(scene[4]), rng)[..., ::-1])

    def small(self, scene: Array, rng: np.random.Generator, size: int) -> np.ndarray:
        """(size, size, 3), bytes: the square in the middle."""
        picture = self.whole(scene, rng)
        height, width = picture.shape[:2]
        left = (width - height) // 2
        return cv2.resize(picture[:, left : left + height], (size, size), interpolation=cv2.INTER_AREA)
