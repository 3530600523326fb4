"""Where the plate is by its maze alone: the walls' upper edges are circles of known radius and height.

A first guess comes from the outline of the whole maze: an ellipse, whose middle, size and the camera's focal length
give the distance of a plate that faces the camera. Its turn about the upright is where the walls' tops are interrupted
as the map says. Then pixels across the edges are searched for the steepest step of light, and the pose is moved until
these lie on the circles (least squares, robust). """

from __future__ import annotations

import math

import cv2
import numpy as np
from scipy.optimize import least_squares

from mazeplan.errors import InputError
from mazeplan.maths.angles import difference
from mazeplan.maze.geometry import Maze, Wall
from mazeplan.records import Array
from mazeplan.rigs.camera.pinhole import CameraModel, rotation

REACHES = (10.0, 5.0, 3.0)  # px on either side in which an edge is looked for, round by round
FITTING = 0.6  # share of all points whose edge must lie within a pixel of where it belongs
EVERY = math.radians(3.0)  # between points on a circle
ROW = 1024  # pixels that are looked up in a row
TURNS = 360  # directions that are tried
FACING = np.diag([1.0, -1.0, -1.0])  # a camera that looks straight down


def pose_by_circles(matrix: Array, distortion: Array, image: np.ndarray, maze: Maze) -> tuple[Array, Array, float]:
    """(rotation, translation, rms px) from the level plate to the camera, by a picture of the empty plate. Raises
    InputError when no maze of that kind is to be seen."""
    gray = cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), (0, 0), 1.0).astype(np.float32)
    size = (image.shape[1], image.shape[0])
    best: tuple[float, CameraModel] | None = None
    for middle, radius in _round_things(gray, size):
        straight = cv2.undistortPoints(middle.reshape(1, 1, 2), matrix, distortion).ravel()
        far = maze.walls[0].outer_radius * matrix[0, 0] / radius + maze.wall_height
        shift = np.array([straight[0] * far, straight[1] * far, far])
        guess = CameraModel(matrix, distortion, FACING, shift, size)
        for turn in _turns(gray, guess, maze):
            camera = CameraModel(matrix, distortion, FACING @ rotation([0.0, 0.0, turn]), shift, size)
            done = _refined(gray, camera, maze)
            if done is not None and (best is None or done[0] < best[0]):
                best = done
    if best is None:
        raise InputError(f"plate: the walls of map {maze.name} are not found in the picture; put markers on the plate")
    return best[1].rotation, best[1].translation, best[0]


def _round_things(gray: np.ndarray, size: tuple[int, int]) -> list[tuple[Array, float]]:
    """(middle (2,), radius) in px of what may be the maze's outline, most likely first."""
    edges = cv2.dilate(cv2.Canny(gray.astype(np.uint8), 40, 100), np.ones((3, 3), np.uint8))
    contours, _ = cv2.findContours(edges, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    found = []
    for contour in contours:
        if len(contour) < 50:
            continue
        (x, y), (a, b), _ = cv2.fitEllipse(contour)
        if not 0.25 * min(size) < a <= b < 1.1 * max(size) or a < 0.85 * b:
            continue
        hull = cv2.contourArea(cv2.convexHull(contour))
        if abs(hull / (0.25 * math.pi * a * b) - 1.0) < 0.06:
            found.append((np.array([x, y]), 0.25 * (a + b)))
    found.sort(key=lambda one: -one[1])
    distinct: list[tuple[Array, float]] = []
    for middle, radius in found:
        if all(abs(radius - other) > 4.0 or np.hypot(*(middle - m)) > 4.0 for m, other in distinct):
            distinct.append((middle, radius))
    return distinct[:4]


def _turns(gray: np.ndarray, guess: CameraModel, maze: Maze) -> list[float]:
    """Turns of the plate about the upright, rad, likely ones first: on the tops of the walls, light is as different as
    it can be between where there is wall and where there are openings."""
    angles = np.arange(TURNS) * math.tau / TURNS
    score = np.zeros(TURNS)
    for wall in maze.walls:
        if not wall.openings:
            continue
        middle = 0.5 * (wall.inner_radius + wall.outer_radius)
        top = np.column_stack([middle * np.cos(angles), middle * np.sin(angles), np.full(TURNS, maze.wall_height)])
        light = _sample(gray, guess.project(top))
        light = light - light.mean()
        gap = np.zeros(TURNS)
        for opening in wall.openings:
            gap[np.abs(difference(angles, opening.angle)) < math.asin(0.5 * opening.width / middle)] = 1.0
        gap -= gap.mean()
        # a plate turned by t shows at angle a what the map has at a - t
        score += np.fft.ifft(np.fft.fft(light) * np.conj(np.fft.fft(gap))).real / max(1e-9, float(light.std()))
    order = np.argsort(-np.abs(score))
    picked: list[float] = []
    for index in order:
        if all(abs(math.remainder(float(angles[index]) - other, math.tau)) > math.radians(8.0) for other in picked):
            picked.append(float(angles[index]))
        if len(picked) == 4:
            break
    return picked or [0.0]


def _rims(maze: Maze) -> list[tuple[Array, Array]]:
    """(points (N, 3) on the upper edges, outward directions (N, 3)) of every wall, away from openings."""
    rims = []
    for wall in maze.walls:
        for radius in (wall.inner_radius, wall.outer_radius):
            angles = np.arange(0.0, math.tau, EVERY)
            angles = angles[[_solid(wall, radius, float(angle)) for angle in angles]]
            out = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))])
            rims.append((radius * out + np.array([0.0, 0.0, maze.wall_height]), out))
    return rims


def _solid(wall: Wall, radius: float, angle: float) -> bool:
    return all(abs(difference(angle, o.angle)) > (0.5 * o.width + 0.002) / radius for o in wall.openings)


def _refined(gray: np.ndarray, camera: CameraModel, maze: Maze) -> tuple[float, CameraModel] | None:
    """(rms px, camera) after its pose was laid to the edges, or None when most of them are not there."""
    rims = _rims(maze)
    # the sides of a opening say how the plate is turned
    points = np.vstack([p for p, _ in rims] + [_sides(maze)[0]])
    out = np.vstack([d for _, d in rims] + [_sides(maze)[1]])
    error = math.inf
    for reach in REACHES:
        here = camera.project(points)
        across = camera.project(points + 1e-4 * out) - here
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        offset, clear = _steps(gray, here, across, reach)
        if clear.mean() < 0.5:
            return None
        target = here + offset[:, None] * across

        def off(change: Array, at: CameraModel = camera, target: Array = target, across: Array = across,
                clear: np.ndarray = clear) -> Array:  # fmt: skip
            return (((_moved(at, change).project(points) - target) * across).sum(axis=1))[clear]

        done = least_squares(
            off, np.zeros(6), loss="soft_l1", f_scale=0.5, x_scale=[0.01, 0.01, 0.01, 1e-3, 1e-3, 1e-3]
        )
        camera = _moved(camera, done.x)
        left = off(done.x)
        near = np.abs(left) < 1.0
        error = float(np.sqrt((left[near] ** 2).mean())) if near.sum() > FITTING * len(points) else math.inf
    return (error, camera) if math.isfinite(error) else None


def _sides(maze: Maze) -> tuple[Array, Array]:
    """Points (N, 3) on the upper edges of openings' sides and directions (N, 3) across them."""
    points, out = [], []
    for wall in maze.walls:
        for opening in wall.openings:
            c, s = math.cos(opening.angle), math.sin(opening.angle)
            for side in (-1.0, 1.0):
                for share in (0.3, 0.5, 0.7):
                    along = wall.inner_radius + share * (wall.outer_radius - wall.inner_radius)
                    half = side * 0.5 * opening.width
                    points.append([c * along - s * half, s * along + c * half, maze.wall_height])
                    out.append([-s * side, c * side, 0.0])
    return np.array(points).reshape(-1, 3), np.array(out).reshape(-1, 3)


def _moved(camera: CameraModel, change: Array) -> CameraModel:
    turn = rotation(change[:3]) @ camera.rotation
    return CameraModel(camera.matrix, camera.distortion, turn, camera.translation + change[3:], camera.size)


def _steps(gray: np.ndarray, here: Array, across: Array, reach: float) -> tuple[Array, np.ndarray]:
    """Along `across`, (N, 2), how many px from `here` the light changes most, and whether it clearly does."""
    at = np.arange(-reach - 1.0, reach + 1.01, 0.5)
    light = _sample(gray, (here[:, None] + at[None, :, None] * across[:, None]).reshape(-1, 2)).reshape(len(here), -1)
    change = np.abs(light[:, 2:] - light[:, :-2])
    middle = at[1:-1]
    likely = change * np.exp(-0.5 * (middle / (0.6 * reach)) ** 2)
    best = np.clip(likely.argmax(axis=1), 1, len(middle) - 2)
    before, there, after = (np.take_along_axis(change, best[:, None] + i, axis=1)[:, 0] for i in (-1, 0, 1))
    bend = np.minimum(before + after - 2.0 * there, -1e-6)
    return middle[best] + 0.5 * np.clip(0.5 * (before - after) / bend, -1.0, 1.0), there > 8.0


def _sample(gray: np.ndarray, pixels: Array) -> Array:
    where = np.resize(pixels.astype(np.float32), (math.ceil(len(pixels) / ROW), ROW, 2))  # OpenCV takes no long ones
    return cv2.remap(gray, where, None, cv2.INTER_LINEAR).ravel()[: len(pixels)].astype(float)  # type: ignore[call-overload]
