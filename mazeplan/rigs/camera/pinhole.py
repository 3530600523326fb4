"""A pinhole camera with a lens, and the plate in front of it.

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
