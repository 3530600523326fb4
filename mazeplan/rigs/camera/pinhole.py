"""A pinhole camera with a lens, the plate in front of it, and the tilt of the plate by its ArUco markers.

Plate frame: the frame of the maze (x to the right, y up, z towards the camera, floor at z = 0). It turns with the plate
about a pivot, R = Ry(beta) Rx(gamma). The level plate frame does not turn.

Camera frame: x to the right and y down in the picture, z along the optical axis. A rotation and a translation map the
level plate frame to the camera frame.

Lens (Brown, Conrady), with x = X / Z, y = Y / Z: x" = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2),
y" alike; pixel = focal x" + centre.

Lengths are in m, angles in rad, pixels from the centre of the upper left pixel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze

DICTIONARY = cv2.aruco.DICT_4X4_50
MARKER_SIZE_M = 0.024  # m, side of a packaged marker without its white margin
MARGIN = 0.003  # m, white margin around a marker
ROOM = 14  # px, search area around a marker of the level plate: at the tilt limit the marker moves so far
STEPS, SMALL = 6, 1e-6  # end of the fit of a tilt: number of iterations at most; smaller change, rad


def plate_rotation(beta: float, gamma: float) -> Array:
    """Rotation (3, 3) from the plate frame to the level plate frame."""
    cb, sb, cc, sc = math.cos(beta), math.sin(beta), math.cos(gamma), math.sin(gamma)
    return np.array([[cb, sb * sc, sb * cc], [0.0, cc, -sc], [-sb, cb * sc, cb * cc]])


def rotation(vector: Sequence[float] | Array) -> Array:
    """Rotation (3, 3) about a vector (3,) by its length, rad."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, dtype=float))[0], dtype=float)


def sampled(image: np.ndarray, where: np.ndarray, border: int = cv2.BORDER_CONSTANT) -> np.ndarray:
    """Values of the image at places (..., 2), x, y in px, float32, by linear interpolation."""
    # OpenCV takes None for the second map; its stubs do not
    return cv2.remap(image, where, None, cv2.INTER_LINEAR, borderMode=border)  # type: ignore[call-overload]


@dataclass(frozen=True)
class CameraModel:
    """A camera over the plate."""

    matrix: Array  # (3, 3), focal lengths and centre, px
    distortion: Array  # (5,), k1, k2, p1, p2, k3 of the lens
    rotation: Array  # (3, 3), with translation: from the level plate frame to the camera frame
    translation: Array  # (3,), m
    size: tuple[int, int] = (640, 480)  # width and height of a picture, px
    pivot: Array = field(default_factory=lambda: np.zeros(3))  # fixed point of the tilt in the plate frame, m

    def to_camera(self, points: Array, beta: float, gamma: float) -> Array:
        """Points (N, 3) in the plate frame, converted to the camera frame, (N, 3)."""
        level = (np.asarray(points) - self.pivot) @ plate_rotation(beta, gamma).T + self.pivot
        return level @ self.rotation.T + self.translation

    def project(self, points: Array, beta: float = 0.0, gamma: float = 0.0) -> Array:
        """Pixels (N, 2) of points (N, 3) in the plate frame."""
        seen = self.to_camera(points, beta, gamma)
        x, y = seen[:, 0] / seen[:, 2], seen[:, 1] / seen[:, 2]
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        across = x * y
        u = x * radial + 2.0 * p1 * across + p2 * (r2 + 2.0 * x * x)
        v = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * across
        m = self.matrix
        return np.column_stack([m[0, 0] * u + m[0, 1] * v + m[0, 2], m[1, 1] * v + m[1, 2]])

    def centre(self, beta: float = 0.0, gamma: float = 0.0) -> Array:
        """Place of the camera in the frame of the tilted plate, (3,)."""
        level = -self.rotation.T @ self.translation
        return plate_rotation(beta, gamma).T @ (level - self.pivot) + self.pivot


@dataclass(frozen=True)
class Markers:
    """Markers on the plate. The upper edge of each marker is towards +y."""

    places: dict[int, tuple[float, float, float]]  # {id: middle (x, y, z) in the plate frame, m}
    size: float = MARKER_SIZE_M  # side of a marker, m

    def corners(self, number: int) -> Array:
        """Corners (4, 3) of a marker in the detector's order: clockwise from the upper left."""
        half = 0.5 * self.size
        return np.array(self.places[number]) + half * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0.0]])


def corner_markers(maze: Maze) -> Markers:
    """Markers 0 to 3 in the corners of a square plate, counter-clockwise from upper right, close to the maze."""
    rim = maze.walls[0].outer_radius
    near = (rim + 0.001) / math.sqrt(2.0) + MARGIN + 0.5 * MARKER_SIZE_M
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
        self.camera = camera
        self.markers = markers
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
