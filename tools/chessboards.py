"""Rendered pictures of a chessboard before a camera, to test the calibration of its lens."""

from __future__ import annotations

import cv2
import numpy as np

from mazeplan.core.records import Array
from mazeplan.rigs.camera.pinhole import CameraModel, sampled

CELL = 40  # px of a square in the board's own picture


def board_picture(corners: tuple[int, int]) -> np.ndarray:
    """A grey picture of a chessboard with so many inner corners across and down, and a white margin of one square."""
    across, down = corners[0] + 1, corners[1] + 1
    rows, columns = np.mgrid[0 : down * CELL, 0 : across * CELL] // CELL
    board = np.where((rows + columns) % 2 == 0, 25, 225).astype(np.uint8)
    return cv2.copyMakeBorder(board, CELL, CELL, CELL, CELL, cv2.BORDER_CONSTANT, value=225)


def draw_board(
    camera: CameraModel, corners: tuple[int, int], square: float, turn: Array, shift: Array, rng: np.random.Generator
) -> np.ndarray:
    """A picture (height, width, 3) of a board in camera coordinates.

    square: side of a square, m; turn: rotation vector (3,); shift: the first inner corner (3,), m."""
    board = board_picture(corners)
    axes, _ = cv2.Rodrigues(np.asarray(turn, dtype=float))
    first = 2.0 * CELL - 0.5  # where the first inner corner is in the board's picture
    to_board = np.array(
        [[square / CELL, 0, -first * square / CELL], [0, square / CELL, -first * square / CELL], [0, 0, 1]]
    )
    plane = camera.matrix @ np.column_stack([axes[:, 0], axes[:, 1], shift]) @ to_board
    width, height = camera.size
    twice = np.array([[2.0, 0.0, 0.5], [0.0, 2.0, 0.5], [0.0, 0.0, 1.0]])
    canvas = np.full((2 * height, 2 * width), 120, np.uint8)
    cv2.warpPerspective(
        board, twice @ plane, (2 * width, 2 * height), canvas, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_TRANSPARENT
    )
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 1, 2).astype(float)
    term = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-9)
    straight = cv2.undistortPoints(grid, camera.matrix, camera.distortion, P=camera.matrix, criteria=term)
    where = (2.0 * straight.reshape(height, width, 2) + 0.5).astype(np.float32)
    soft = cv2.GaussianBlur(canvas, (0, 0), 1.4)
    picture = sampled(soft, where, cv2.BORDER_REPLICATE)
    noisy = picture[..., None] + 2.5 * rng.standard_normal((height, width, 3))
    return np.clip(noisy + 0.5, 0, 255).astype(np.uint8)


def board_poses(
    camera: CameraModel, corners: tuple[int, int], square: float, count: int, rng: np.random.Generator
) -> list[tuple[Array, Array]]:
    """Random poses (turn, shift) of a board that is wholly in the picture."""
    poses: list[tuple[Array, Array]] = []
    size = np.array([corners[0] - 1, corners[1] - 1]) * square
    ends = np.array([[x, y, 0.0] for x in (-square, size[0] + square) for y in (-square, size[1] + square)])
    while len(poses) < count:
        turn = np.radians([rng.uniform(-35, 35), rng.uniform(-35, 35), rng.uniform(-25, 25)])
        axes, _ = cv2.Rodrigues(turn)
        fill = rng.uniform(0.35, 0.7)
        far = camera.matrix[0, 0] * size[0] / (fill * camera.size[0])
        aim = np.array([rng.uniform(-0.45, 0.45), rng.uniform(-0.45, 0.45)]) * np.array(camera.size)
        middle = np.append(aim / camera.matrix[0, 0] * far, far)
        shift = middle - axes @ np.append(0.5 * size, 0.0)
        seen, _ = cv2.projectPoints(ends, turn, shift, camera.matrix, camera.distortion)
        seen = seen.reshape(-1, 2)
        if (seen > 8).all() and (seen < np.array(camera.size) - 8).all():
            poses.append((turn, shift))
    return poses
