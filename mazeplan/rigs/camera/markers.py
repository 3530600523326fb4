"""ArUco markers on the plate, and the tilt of the plate by its markers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.camera.pinhole import CameraModel

DICTIONARY = cv2.aruco.DICT_4X4_50
SIZE = 0.024  # m, side of a packaged marker without its white margin
MARGIN = 0.003  # m, white margin around a marker
ROOM = 14  # px, search area around a marker of the level plate: at the tilt limit the marker moves so far
STEPS, SMALL = 6, 1e-6  # end of the fit of a tilt: number of iterations at most; smaller change, rad


@dataclass(frozen=True)
class Markers:
    """Markers on the plate. The upper edge of each marker is towards +y."""

    places: dict[int, tuple[float, float, float]]  # {id: middle (x, y, z) in the plate frame, m}
    size: float = SIZE  # side of a marker, m

    def corners(self, number: int) -> Array:
        """Corners (4, 3) of a marker in the detector's order: clockwise from the upper left."""
        half = 0.5 * self.size
        return np.array(self.places[number]) + half * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0.0]])


def corner_markers(maze: Maze) -> Markers:
    """Markers 0 to 3 in the corners of a square plate, counter-clockwise from upper right, close to the maze."""
    rim = maze.walls[0].outer_radius
    near = (rim + 0.001) / math.sqrt(2.0) + MARGIN + 0.5 * SIZE
    return Markers({i: (near * sx, near * sy, 0.0) for i, (sx, sy) in enumerate([(1, 1), (-1, 1), (-1, -1), (1, -1)])})


def detector() -> cv2.aruco.ArucoDetector:
    """A detector with subpixel corners."""
    how = cv2.aruco.DetectorParameters()
    how.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    how.cornerRefinementWinSize = 3
    how.adaptiveThreshWinSizeMin = how.adaptiveThreshWinSizeMax = 23
    how.minMarkerPerimeterRate = 0.02
    return cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(DICTIONARY), how)


def find(gray: np.ndarray, finder: cv2.aruco.ArucoDetector, known: Markers) -> dict[int, Array]:
    """{id: corners (4, 2), px} of the known markers in a grey picture, without markers that appear twice."""
    corners, ids, _ = finder.detectMarkers(gray)
    numbers: list[int] = [] if ids is None else ids.astype(int).ravel().tolist()
    found = {number: four.reshape(4, 2).astype(float) for number, four in zip(numbers, corners, strict=True)}
    return {n: four for n, four in found.items() if n in known.places and numbers.count(n) == 1}


class TiltFinder:
    """The plate's tilt by its markers. Searches only around the places of the markers."""

    def __init__(self, camera: CameraModel, markers: Markers) -> None:
        self.camera, self.markers = camera, markers
        self._finder = detector()
        self._windows = {number: self._window(markers.corners(number)) for number in markers.places}

    def _window(self, corners: Array) -> tuple[int, int, int, int]:
        pixels = self.camera.project(corners)
        left, top = np.clip(pixels.min(axis=0) - ROOM, 0, self.camera.size).astype(int).tolist()
        right, bottom = np.clip(pixels.max(axis=0) + ROOM + 1, 0, self.camera.size).astype(int).tolist()
        return left, top, right, bottom

    def tilt(self, gray: np.ndarray) -> tuple[float, float, float] | None:
        """(beta, gamma, rms error of the corners in px), or None if no marker is detected."""
        found: dict[int, Array] = {}
        for number, (left, top, right, bottom) in self._windows.items():
            if right - left < 16 or bottom - top < 16:
                continue
            here = find(np.ascontiguousarray(gray[top:bottom, left:right]), self._finder, self.markers)
            if number in here:
                found[number] = here[number] + np.array([left, top])
        if not found:
            return None
        points = np.vstack([self.markers.corners(number) for number in found])
        return fit_tilt(self.camera, points, np.vstack(list(found.values())))


def fit_tilt(camera: CameraModel, points: Array, pixels: Array) -> tuple[float, float, float]:
    """(beta, gamma, rms error in px) by least squares.

    points (N, 3): in the plate frame, m.
    pixels (N, 2): places of these points in the picture."""
    tilt, step = np.zeros(2), 1e-4
    for _ in range(STEPS):
        off = (pixels - camera.project(points, *tilt)).ravel()
        moved = [camera.project(points, *(tilt + e)) - camera.project(points, *(tilt - e)) for e in step * np.eye(2)]
        slope = np.column_stack([one.ravel() for one in moved]) / (2.0 * step)
        change = np.linalg.lstsq(slope, off, rcond=None)[0]
        tilt = np.clip(tilt + change, -0.5, 0.5)
        if np.abs(change).max() < SMALL:
            break
    left = pixels - camera.project(points, *tilt)
    return float(tilt[0]), float(tilt[1]), float(np.sqrt((left**2).sum(axis=1).mean()))
