"""Pose of a plate without markers: the walls' upper edges are circles of known radius and height.

1. First guess: in the picture, the outline of the maze is an ellipse. Its middle and size give the place of the plate,
   which is taken to face the camera. The openings in the walls' tops give the turn of the plate about the vertical.
2. A robust least-squares fit moves the pose until the steepest steps of light lie on the circles."""

from __future__ import annotations

import math
from itertools import product

import cv2
import numpy as np
from scipy.optimize import least_squares

from mazeplan.core.errors import InputError
from mazeplan.core.maths.angles import difference
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze, Wall
from mazeplan.rigs.camera.pinhole import CameraModel, rotation, sampled

REACHES = (10.0, 5.0, 3.0)  # px; an edge is searched so far on either side, round by round
FITTING = 0.6  # minimum share of all points that have an edge within a pixel
EVERY = math.radians(3.0)  # rad between points on a circle
ROW = 1024  # pixels per row of a lookup
TURNS = 360  # number of directions to try
FACING = np.diag([1.0, -1.0, -1.0])  # rotation to a camera that looks straight down


def pose_by_circles(matrix: Array, distortion: Array, image: np.ndarray, maze: Maze) -> tuple[Array, Array, float]:
    """(rotation, translation, rms error in px) from the level plate frame to the camera frame.

    image: picture of the empty plate. Raises InputError if the picture does not show the maze."""
    soft = cv2.GaussianBlur(image, (0, 0), 0.7)
    gray = cv2.cvtColor(soft, cv2.COLOR_BGR2GRAY).astype(np.float32)
    size = (image.shape[1], image.shape[0])
    best: tuple[float, float, CameraModel] | None = None
    rim = maze.walls[0]
    ways = product(_round_things(gray, size), (rim.inner_radius, rim.outer_radius))
    for (middle, radius), edge in ways:
        straight = cv2.undistortPoints(middle.reshape(1, 1, 2), matrix, distortion).ravel()
        far = edge * matrix[0, 0] / radius + maze.wall_height
        shift = np.array([straight[0] * far, straight[1] * far, far])
        guess = CameraModel(matrix, distortion, FACING, shift, size)
        unlike = _unlike_tops(soft, guess, maze)
        for turn in _turns(unlike, guess, maze):
            camera = CameraModel(matrix, distortion, FACING @ rotation([0.0, 0.0, turn]), shift, size)
            done = _refined(unlike, camera, maze)
            if done is not None:
                fits = _openings_seen(unlike, done[1], maze)
                if best is None or fits > best[0]:
                    best = (fits, *done)
    if best is None:
        raise InputError(f"plate: the walls of map {maze.name} are not found in the picture; put markers on the plate")
    return best[2].rotation, best[2].translation, best[1]


def _round_things(gray: np.ndarray, size: tuple[int, int]) -> list[tuple[Array, float]]:
    """(middle (2,), radius), px, of ellipses that may be the maze's outline, the largest first."""
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


def _wall_line(maze: Maze, wall: Wall) -> tuple[Array, Array, np.ndarray]:
    """Angles (TURNS,), points (TURNS, 3) along the middle of a wall's top, and whether each is in an opening."""
    angles = np.arange(TURNS) * math.tau / TURNS
    middle = 0.5 * (wall.inner_radius + wall.outer_radius)
    gap = np.zeros(TURNS, dtype=bool)
    for opening in wall.openings:
        gap |= np.abs(difference(angles, np.full(TURNS, opening.angle))) < math.asin(0.5 * opening.width / middle)
    return (
        angles, np.column_stack([middle * np.cos(angles), middle * np.sin(angles), np.full(TURNS, maze.wall_height)]),
        gap )  # fmt: skip


def _turns(unlike: np.ndarray, guess: CameraModel, maze: Maze) -> list[float]:
    """Turns of the plate about the vertical, rad, the likely ones first. They follow from the openings in the tops."""
    score = np.zeros(TURNS)
    angles = np.arange(TURNS) * math.tau / TURNS
    for wall in maze.walls:
        if wall.openings:
            _, tops, gap = _wall_line(maze, wall)
            light = _sample(unlike, guess.project(tops))
            # with a plate that is turned by t, angle a in the picture is angle a - t in the map
            score += np.fft.ifft(np.fft.fft(light - light.mean()) * np.conj(np.fft.fft(gap - gap.mean()))).real
    picked: list[float] = []
    for index in np.argsort(-score):
        if all(abs(math.remainder(float(angles[index]) - other, math.tau)) > math.radians(8.0) for other in picked):
            picked.append(float(angles[index]))
        if len(picked) == 4:
            break
    return picked


def _openings_seen(unlike: np.ndarray, camera: CameraModel, maze: Maze) -> float:
    """How much less like the walls' tops the openings are than the rest of the walls, grey levels."""
    there, beside = [], []
    for wall in maze.walls:
        _, tops, gap = _wall_line(maze, wall)
        light = _sample(unlike, camera.project(tops))
        there += light[gap].tolist()
        beside += light[~gap].tolist()
    return float(np.mean(there or [0.0]) - np.mean(beside))


def _unlike_tops(image: np.ndarray, camera: CameraModel, maze: Maze) -> np.ndarray:
    """A picture with 0 at the colour of the walls' tops, and 255 at clearly other colours.

    In this picture the walls' sides and their shadows on the floor have no edges."""
    rim = maze.walls[0]  # the rim has no openings, so that the turn of the plate does not matter
    angles = np.arange(0.0, math.tau, EVERY)
    tops = 0.5 * (rim.inner_radius + rim.outer_radius) * np.column_stack([np.cos(angles), np.sin(angles)])
    where = camera.project(np.column_stack([tops, np.full(len(tops), maze.wall_height)]))
    own = np.median(np.column_stack([_sample(image[..., i].astype(np.float32), where) for i in range(3)]), axis=0)
    far = np.abs(image.astype(np.float32) - own.astype(np.float32)).sum(axis=2)
    low, high = np.percentile(_sample(far, where), 50.0), 0.6 * float(np.percentile(far, 75.0))
    return np.clip((far - low) / max(high - low, 1.0), 0.0, 1.0) * 255.0


def _rims(maze: Maze) -> list[tuple[Array, Array]]:
    """For each edge of each wall: points (N, 3) on the upper edge and outward directions (N, 3).

    The points keep away from openings and radial walls."""
    rims = []
    for wall in maze.walls:
        for radius in (wall.inner_radius, wall.outer_radius):
            angles = np.arange(0.0, math.tau, EVERY)
            ring = wall.outer_ring + (radius == wall.inner_radius)  # the ring on this side of the wall
            angles = angles[[_solid(wall, radius, a) and not _joined(maze, ring, radius, a) for a in angles.tolist()]]
            out = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))])
            rims.append((radius * out + np.array([0.0, 0.0, maze.wall_height]), out))
    return rims


def _solid(wall: Wall, radius: float, angle: float) -> bool:
    return all(abs(difference(angle, o.angle)) > (0.5 * o.width + 0.002) / radius for o in wall.openings)


def _joined(maze: Maze, ring: int, radius: float, angle: float) -> bool:
    """Whether a radial wall of the ring joins the wall at this angle. There both have one top, without an edge."""
    return any(
        w.ring == ring and abs(difference(angle, w.angle)) < w.half_angle(radius, 0.002) for w in maze.radial_walls
    )


def _refined(gray: np.ndarray, camera: CameraModel, maze: Maze) -> tuple[float, CameraModel] | None:
    """(rms error in px, camera) with the camera's pose fitted to the edges; None if too many edges are missing."""
    rims = _rims(maze)
    # the sides of openings give the turn of the plate
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
    """Points (N, 3) on the upper edges of the openings' sides, and directions (N, 3) across these edges."""
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
    """For each place: distance, px, to the steepest step of light, and whether the step is clear.

    here (N, 2): places, px.
    across (N, 2): directions in which to search.
    reach: largest distance, px."""
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
    where = np.resize(
        pixels.astype(np.float32), (math.ceil(len(pixels) / ROW), ROW, 2)
    )  # OpenCV limits the length of a row
    return sampled(gray, where).ravel()[: len(pixels)].astype(float)
