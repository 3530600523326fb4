"""A camera over a simulated maze: renders pictures and finds the ball in them.

The renderer uses the true camera (TRUE). The detector uses the calibrated camera (FOUND), which differs a little:
`calibrate_lens` and `calibrate_plate` computed it from rendered chessboards and plates (tools/calibrate_packaged.py).
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.camera.calibration import calibrate_background
from mazeplan.rigs.camera.detector import BallDetector, DetectorSettings, Sighting
from mazeplan.rigs.camera.look import Look
from mazeplan.rigs.camera.markers import corner_markers
from mazeplan.rigs.camera.pinhole import CameraModel, rotation
from mazeplan.rigs.camera.render import Overhead

EMPTY = 8  # number of pictures of the empty plate
WHOLE = 0.10189  # m, outer radius of the packaged maze, whose whole plate the camera sees
HUES = {"steel": None, "orange": (4.0, 40.0)}

TRUE = CameraModel(
    np.array([[1200.0, 0.0, 322.0], [0.0, 1200.0, 241.0], [0.0, 0.0, 1.0]]),
    np.array([-0.12, 0.08, 0.0005, -0.0004, 0.0]),
    rotation([0.01, -0.012, 0.015]) @ np.diag([1.0, -1.0, -1.0]),
    np.array([0.001, -0.002, 0.62]),
)
FOUND = CameraModel(
    np.array([[1200.401, 0.0, 322.386], [0.0, 1200.437, 240.966], [0.0, 0.0, 1.0]]),
    np.array([-0.119506, 0.076225, 0.000547, -0.000348, 0.0]),
    rotation([-3.131103, -0.023554, -0.018581]),
    np.array([0.000809, -0.00198, 0.620261]),
)


def over(camera: CameraModel, maze: Maze) -> CameraModel:
    """The camera over a maze. It hangs higher over a larger maze, which then looks as large as the packaged maze."""
    larger = maze.walls[0].outer_radius / WHOLE
    return camera if larger <= 1.0 + 1e-9 else replace(camera, translation=camera.translation * larger)


def overhead(maze: Maze, look: Look | None = None) -> tuple[Overhead, BallDetector]:
    """Renderer and detector for a maze. The detector's background comes from rendered pictures."""
    look = look or Look()
    found = over(FOUND, maze)
    eye = Overhead(maze, over(TRUE, maze), look)
    rng = np.random.default_rng(1)
    empty = [(f"empty plate {i}", eye.render(None, 0.0, 0.0, rng)) for i in range(EMPTY)]
    markers = corner_markers(maze)
    background = calibrate_background(found, empty, maze, markers)
    return eye, BallDetector(maze, found, background, markers, DetectorSettings(hue_deg=HUES[look.ball]))


class CameraSense:
    """Detects the ball in rendered pictures."""

    def __init__(self, maze: Maze, look: Look | None = None) -> None:
        cv2.setNumThreads(1)  # other runs need the other cores
        self.overhead, self.detector = overhead(maze, look)

    def look(self, ball: Array | None, beta: float, gamma: float, rng: np.random.Generator) -> Sighting:
        """Render one picture, and detect the ball in it.

        ball: true centre (3,) of the ball in the plate frame, m; None: no ball.
        beta, gamma: true tilt, rad."""
        return self.detector.locate(self.overhead.render(ball, beta, gamma, rng))
