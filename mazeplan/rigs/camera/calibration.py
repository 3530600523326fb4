"""Calibrates a camera from pictures of a chessboard and of the empty plate.

Lens: Zhang's method (cv2.calibrateCamera) on the corners of the chessboard. A picture is left out if the others agree
much better without it.
Pose of the level plate: by its markers.
Background: the empty floor, straightened, as the mean of all pictures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from mazeplan.core.errors import InputError
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.camera.detector import Background
from mazeplan.rigs.camera.floor import Floor
from mazeplan.rigs.camera.pinhole import CameraModel, Markers, TiltFinder, detector, find, rotation

LEAST_BOARDS = 5  # minimum number of pictures of the chessboard
GOOD_PX = 0.25  # px, rms error of the corners above which a picture may be wrong
BETTER = 0.7  # a picture is left out if this reduces the error to less than this share
MOST_PX = 1.5  # px, largest rms error of a calibration
NamedPicture = tuple[str, np.ndarray]
Pictures = Sequence[NamedPicture]


@dataclass(frozen=True)
class LensCalibration:
    """Result for the lens. matrix (3, 3), distortion (5,), size: see `CameraModel`."""

    matrix: Array
    distortion: Array
    size: tuple[int, int]
    error_px: float  # rms error of the corners
    used: int  # number of used pictures
    left_out: tuple[str, ...] = ()  # names of the other pictures, each with the reason


@dataclass(frozen=True)
class Calibration:
    """Result of a calibration."""

    camera: CameraModel
    background: Background
    error_px: float  # rms error of the markers
    error_mm: float  # the same error on the floor


def calibrate_lens(pictures: Iterable[NamedPicture], corners: tuple[int, int], square: float) -> LensCalibration:
    """Calibrate the lens. Raises InputError if the pictures do not suffice.

    corners: numbers of inner corners of the chessboard, across and down.
    square: side of a square of the chessboard, m."""
    board = np.zeros((corners[0] * corners[1], 3), np.float32)
    board[:, :2] = np.mgrid[0 : corners[0], 0 : corners[1]].T.reshape(-1, 2) * square
    what = f"board of {corners[0]} x {corners[1]} inner corners"
    size: tuple[int, int] | None = None
    found: list[tuple[str, np.ndarray]] = []
    without: list[str] = []
    for name, image in pictures:
        size = size or (image.shape[1], image.shape[0])
        _check_size(name, image, size)
        at = _chessboard(image, corners)
        if at is None:
            without.append(f"{name}: no {what}")
        else:
            found.append((name, at))
    if size is None or len(found) < LEAST_BOARDS:
        got = f"got {len(found)} pictures with a whole {what} among {len(found) + len(without)}"
        hint = "take more, or count the inner corners for --corners"
        raise InputError(f"chessboard: {got}, expected at least {LEAST_BOARDS}; {hint}")
    lens = _zhang(board, [at for _, at in found], size)
    while lens.error_px > GOOD_PX and len(found) > LEAST_BOARDS:
        # find the picture without which the others agree best
        fewer = [_zhang(board, [at for _, at in found[:i] + found[i + 1 :]], size) for i in range(len(found))]
        worst = min(range(len(found)), key=lambda i: fewer[i].error_px)
        if fewer[worst].error_px > BETTER * lens.error_px:
            break
        fall = f"the error falls from {lens.error_px:.2f} px to {fewer[worst].error_px:.2f} px"
        without.append(f"{found[worst][0]}: without it {fall}")
        lens = fewer[worst]
        found.pop(worst)
    if lens.error_px > MOST_PX:
        raise InputError(f"chessboard: the corners are still {lens.error_px:.1f} px off, expected below {MOST_PX:g} px")
    return replace(lens, left_out=tuple(without))


def _check_size(name: str, image: np.ndarray, size: tuple[int, int]) -> None:
    if image.shape[1::-1] != size:
        got = f"{image.shape[1]} x {image.shape[0]}"
        raise InputError(f"got a picture of {got}, expected {size[0]} x {size[1]} as before", file=name)


def _chessboard(image: np.ndarray, corners: tuple[int, int]) -> np.ndarray | None:
    """Corners of a chessboard in a picture, px; None if it is not seen whole."""
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_FAST_CHECK
    done, at = cv2.findChessboardCorners(gray, corners, flags=flags)
    term = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 30, 1e-3)
    return cv2.cornerSubPix(gray, at, (4, 4), (-1, -1), term) if done else None


def _zhang(board: np.ndarray, found: Sequence[np.ndarray], size: tuple[int, int]) -> LensCalibration:
    start = np.array([[1.5 * size[0], 0, 0.5 * size[0]], [0, 1.5 * size[0], 0.5 * size[1]], [0, 0, 1.0]])
    flags = cv2.CALIB_FIX_K3 + cv2.CALIB_USE_INTRINSIC_GUESS
    boards = [board] * len(found)
    error, matrix, bent, _, _ = cv2.calibrateCamera(boards, list(found), size, start, np.zeros(5), flags=flags)
    values = np.array(bent, dtype=float).ravel()[:5]
    return LensCalibration(np.array(matrix, dtype=float), values, size, float(error), len(found))


def calibrate_plate(
    lens: LensCalibration, pictures: Pictures, maze: Maze, markers: Markers, pivot: Array | None = None
) -> Calibration:
    """Pose and background from pictures of the empty, level plate. Raises InputError if the pictures do not suffice.

    pivot (3,): fixed point of the tilt in the plate frame, m; by default the origin."""
    for name, image in pictures:
        _check_size(name, image, lens.size)
    if not pictures:
        raise InputError("plate: got no picture of the empty plate")
    pivot = np.zeros(3) if pivot is None else pivot
    rotation, translation, error = _pose_by_markers(lens, pictures, markers)
    if error > MOST_PX:
        raise InputError(f"plate: markers are {error:.1f} px off, expected below {MOST_PX:g} px")
    camera = CameraModel(lens.matrix, lens.distortion, rotation, translation, lens.size, pivot)
    error_mm = 1000.0 * error * float(translation[2]) / float(lens.matrix[0, 0])
    return Calibration(camera, calibrate_background(camera, pictures, maze, markers), error, error_mm)


def _pose_by_markers(lens: LensCalibration, pictures: Pictures, markers: Markers) -> tuple[Array, Array, float]:
    """(rotation, translation, rms error in px) from the level plate frame to the camera frame, by the median of each
    marker's corners over all pictures."""
    finder = detector()
    seen: dict[int, list[Array]] = {}
    for _, image in pictures:
        for number, four in find(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), finder, markers).items():
            seen.setdefault(number, []).append(four)
    often = {number: fours for number, fours in seen.items() if 2 * len(fours) >= len(pictures)}
    if len(often) < 2:
        got = f"{pictures[0][0]}: got markers {sorted(often)} in most pictures"
        raise InputError(f"{got}, expected at least two of {sorted(markers.places)}")
    points = np.vstack([markers.corners(number) for number in often])
    pixels = np.vstack([np.median(fours, axis=0) for fours in often.values()])
    done, turn, shift = cv2.solvePnP(points, pixels, lens.matrix, lens.distortion, flags=cv2.SOLVEPNP_IPPE)
    if not done:
        raise InputError(f"{pictures[0][0]}: the markers give no pose; do they lie where the rig's file says?")
    turn, shift = cv2.solvePnPRefineLM(points, pixels, lens.matrix, lens.distortion, turn, shift)
    off = cv2.projectPoints(points, turn, shift, lens.matrix, lens.distortion)[0].reshape(-1, 2) - pixels
    error = float(np.sqrt((off**2).sum(axis=1).mean()))
    return rotation(turn.ravel().tolist()), np.array(shift, dtype=float).ravel(), error


def calibrate_background(camera: CameraModel, pictures: Pictures, maze: Maze, markers: Markers) -> Background:
    """The empty floor. Places that walls hide are filled in from their surroundings."""
    floor = Floor(maze)
    tilts = TiltFinder(camera, markers)
    total = np.zeros((floor.side, floor.side, 3))
    count = np.zeros((floor.side, floor.side, 1))
    for _, image in pictures:
        tilt = tilts.tilt(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        beta, gamma = (0.0, 0.0) if tilt is None else tilt[:2]
        seen = floor.visible(camera.centre(beta, gamma))[..., None] > 0
        total += floor.straighten(image, camera, beta, gamma) * seen
        count += seen
    known = (count[..., 0] > 0).astype(np.uint8) * 255
    mean = np.clip(total / np.maximum(count, 1) + 0.5, 0, 255).astype(np.uint8)
    filled = cv2.inpaint(mean, 255 - known, 4, cv2.INPAINT_TELEA)
    # filled pixels count as known only near seen pixels
    near = cv2.dilate(known, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (11, 11)))
    return Background(filled, near)
