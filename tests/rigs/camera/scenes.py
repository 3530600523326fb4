"""Pictures that the tests of the camera share; made once a process."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from emulator.look import Look
from emulator.render import TRUE, Overhead, over

from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.camera.calibration import calibrate_background
from mazeplan.rigs.camera.detector import BallDetector
from mazeplan.rigs.camera.pinhole import CameraModel, corner_markers, rotation

MAZE = load_map("cme")
R = MAZE.ball.radius
# the calibrated camera, which differs a little from the true one: tools/calibrate_packaged.py computed it
FOUND = CameraModel(
    np.array([[1200.401, 0.0, 322.386], [0.0, 1200.437, 240.966], [0.0, 0.0, 1.0]]),
    np.array([-0.119506, 0.076225, 0.000547, -0.000348, 0.0]),
    rotation([-3.131103, -0.023554, -0.018581]),
    np.array([0.000809, -0.00198, 0.620261]),
)


def overhead(maze: Maze, look: Look | None = None) -> tuple[Overhead, BallDetector]:
    """Renderer and detector for a maze. The detector's background comes from rendered pictures."""
    look = look or Look()
    found = over(FOUND, maze)
    eye = Overhead(maze, over(TRUE, maze), look)
    rng = np.random.default_rng(1)
    empty = [(f"empty plate {i}", eye.render(None, 0.0, 0.0, rng)) for i in range(8)]
    markers = corner_markers(maze)
    background = calibrate_background(found, empty, maze, markers)
    return eye, BallDetector(maze, found, background, markers)


@cache
def usual() -> tuple[Overhead, BallDetector]:
    """The packaged camera and its detector."""
    return overhead(MAZE)


@cache
def orange() -> tuple[Overhead, BallDetector]:
    """With an orange ball."""
    return overhead(MAZE, Look(ball="orange"))


@cache
def overlooking(look: Look) -> Overhead:
    """The same camera in another light; the usual detector does not know of it."""
    return Overhead(MAZE, TRUE, look)


def place(ring: int, degrees: float, aside: float = 0.0) -> np.ndarray:
    """A ball's centre (3,), m: `aside` m outside of a ring's track."""
    r, angle = MAZE.track_radius(ring) + aside, math.radians(degrees)
    return np.array([r * math.cos(angle), r * math.sin(angle), R])


# (ball, beta, gamma): all rings, on the track and against both walls, an opening, tilts to all sides
STANDARD = [
    (place(1, 20.0), 0.0, 0.0),
    (place(1, 130.0, -0.00135), 0.085, -0.06),
    (place(1, 250.0, 0.00135), -0.085, 0.07),
    (place(2, 75.0, -0.001), 0.06, 0.085),
    (place(2, 190.0), -0.03, -0.085),
    (place(3, 310.0, 0.001), 0.085, 0.085),
    (place(3, 160.0), -0.085, 0.0),
    (place(4, 100.0, -0.001), 0.02, -0.05),
    (place(5, 0.0), 0.085, -0.085),
    (np.array([0.006, -0.005, R]), -0.06, 0.03),
    (np.array([0.0, 0.0588, R]), 0.04, 0.05),
]
