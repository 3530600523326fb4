"""The straightened picture of the plate's floor: without tilt and perspective, `PX` pixels per m, y up.

In this picture, points of the floor keep their places at any tilt. Objects on the floor seem to lean away from the
camera's foot. With C the camera's place in the plate frame, a point p at height z hides the floor at
C + (p - C) Cz / (Cz - z).
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from mazeplan.core.records import Array
from mazeplan.maze.drawing import radial_outline, wall_outlines
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.camera.pinhole import CameraModel, sampled

PX = 2000.0  # pixels of the floor's picture per m
CELL = 8  # px between projected points; between these points the map is nearly linear
FINE = 4  # the walls are first drawn this many times finer
HEIGHTS = (1.0, 0.66, 0.33, 0.0)  # shares of the walls' height; at these heights the walls hide the floor
CLEAR = 25  # of 255, share of a pixel that a wall may hide


def floor_side(maze: Maze) -> int:
    """Length of a side of the floor's picture, px."""
    return CELL * math.ceil(2.0 * (maze.walls[0].outer_radius + 0.001) * PX / CELL)


class Floor:
    """The floor inside the rim, and the walls that hide it.

    side: length of a side of the floor's picture, px.
    half: half of that length, m.
    solid: picture with 255 at walls."""

    def __init__(self, maze: Maze) -> None:
        self.maze = maze
        self.side = floor_side(maze)
        self.half = 0.5 * self.side / PX
        self.solid = self._solid()
        nodes = np.arange(0.5 * CELL - 0.5, self.side, CELL)
        across, down = np.meshgrid(nodes, nodes)
        flat = self.metres(np.array([across.ravel(), down.ravel()], dtype=float).T)
        self._nodes = np.column_stack([flat, np.zeros(len(flat))])

    def _solid(self) -> np.ndarray:
        size = self.side * FINE
        picture = np.zeros((size, size), np.uint8)

        def fixed(points: Array) -> np.ndarray:
            at = np.column_stack([points[:, 0] + self.half, self.half - points[:, 1]]) * PX * FINE - 0.5
            return np.round(at).astype(np.int32)

        angle = np.linspace(0.0, math.tau, 720, endpoint=False)
        circle = np.column_stack([np.cos(angle), np.sin(angle)])
        picture[:] = 255
        cv2.fillPoly(picture, [fixed(self.maze.walls[0].inner_radius * circle)], 0)
        for wall in self.maze.walls[1:]:
            pieces = wall_outlines(wall) or [wall.inner_radius * circle, wall.outer_radius * circle]
            cv2.fillPoly(picture, [fixed(piece) for piece in pieces], 255)
        for across in self.maze.radial_walls:
            cv2.fillPoly(picture, [fixed(radial_outline(self.maze, across))], 255)
        return cv2.resize(picture, (self.side, self.side), interpolation=cv2.INTER_AREA)

    def pixels(self, points: Array) -> Array:
        """Pixels (N, 2) of points (N, 2), m."""
        return np.column_stack([points[:, 0] + self.half, self.half - points[:, 1]]) * PX - 0.5

    def metres(self, pixels: Array) -> Array:
        """Points (N, 2), m, of pixels (N, 2)."""
        at = (np.asarray(pixels) + 0.5) / PX
        return np.column_stack([at[:, 0] - self.half, self.half - at[:, 1]])

    def straighten(self, image: np.ndarray, camera: CameraModel, beta: float, gamma: float) -> np.ndarray:
        """The floor's picture (side, side, 3) from a picture of the camera."""
        cells = self.side // CELL
        coarse = camera.project(self._nodes, beta, gamma).astype(np.float32).reshape(cells, cells, 2)
        where = cv2.resize(coarse, (self.side, self.side), interpolation=cv2.INTER_LINEAR)
        return sampled(image, where)

    def visible(self, eye: Array) -> np.ndarray:
        """255 where the floor is visible, 0 where a wall stands or hides the floor.

        eye (3,): place of the camera in the plate frame, m."""
        foot = self.pixels(eye[None, :2])[0]
        hidden = self.solid.copy()
        for share in HEIGHTS:
            k = share * self.maze.wall_height / eye[2]
            if k > 0.0:
                warp = np.array([[1.0 - k, 0.0, k * foot[0]], [0.0, 1.0 - k, k * foot[1]]])
                flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
                layer = cv2.warpAffine(self.solid, warp, (self.side, self.side), flags=flags, borderValue=255)
                cv2.max(hidden, layer, hidden)
        return cv2.threshold(hidden, CLEAR, 255, cv2.THRESH_BINARY_INV)[1]
