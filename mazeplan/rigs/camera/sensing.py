"""A camera over a simulated maze: pictures are rendered and the ball is found in them.

The pictures are taken by the camera as it is; the ball is found with what a calibration says of it (FOUND: what
`calibrate_lens` and `calibrate_plate` made of rendered chessboards and plates, see tools/calibrate_packaged.py).
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from mazeplan.maze.geometry import Maze
from mazeplan.records import Array
from mazeplan.rigs.camera.calibration import calibrate_background
from mazeplan.rigs.camera.detector import BallDetector, DetectorSettings, Sighting
from mazeplan.rigs.camera.look import Look
from mazeplan.rigs.camera.markers import corner_markers
from mazeplan.rigs.camera.pinhole import CameraModel, rotation
from mazeplan.rigs.camera.render import Overhead

EMPTY = 8  # pictures of the empty plate
WHOLE = 0.10189  # m, outer radius of the packaged maze, over which the camera hangs so that the whole plate is seen
HUES = {"steel": None, "orange": (4.0, 40.0), "blue": (190.0, 250.0)}

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
    """That camera as it hangs over a maze: so much higher over a larger one that it is seen as large as the packaged
    one is. A smaller one is seen smaller."""
    larger = maze.walls[0].outer_radius / WHOLE
    return camera if larger <= 1.0 + 1e-9 else replace(camera, translation=camera.translation * larger)


def overhead(maze: Maze, look: Look | None = None) -> tuple[Overhead, BallDetector]:
    """What takes pictures of a maze, and what finds the ball in them; the background is of rendered pictures, too. The
    camera hangs as high as the maze needs (`over`)."""
    look = look or Look()
    found = over(FOUND, maze)
    eye = Overhead(maze, over(TRUE, maze), look)
    rng = np.random.default_rng(1)
    empty = [(f"empty plate {i}", eye.render(None, 0.0, 0.0, rng)) for i in range(EMPTY)]
    markers = corner_markers(maze)
    background = calibrate_background(found, empty, maze, markers)
    return eye, BallDetector(maze, found, background, markers, DetectorSettings(hue_deg=HUES[look.ball]))


class CameraSense:
    """Where the camera sees the ball that is at a place."""

    def __init__(self, maze: Maze, look: Look | None = None) -> None:
        cv2.setNumThreads(1)  # the other cores are for other runs
        self.overhead, self.detector = overhead(maze, look)

    def look(self, ball: Array | None, beta: float, gamma: float, rng: np.random.Generator) -> Sighting:
        """One picture. ball: its centre (3,) in the plate frame, m, or None when there is none; tilt in rad."""
        return self.detector.locate(self.overhead.render(ball, beta, gamma, rng))
