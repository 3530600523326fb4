"""The straightened picture of the plate's floor: without tilt and perspective, `PX` pixels per m, y up.

In this picture, points of the floor keep their places at any tilt. Objects on the floor seem to lean away from the
camera's foot. With C the camera's place in the plate frame, a point p at height z hides the floor at
C + (p - C) Cz / (Cz - z).

`Outline` fits the outline of a sphere of known radius to its edge in this picture. The outline is a circle across the
line of sight. Rays go out from the middle of this circle. On each ray the edge is where the difference from the empty
floor changes most. A robust least-squares fit (Tukey) moves the centre until the edges lie on the circle. Rays that a
wall hides do not count: half a circle is enough.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from mazeplan.core.records import Array
from mazeplan.maze.drawing import radial_outline, wall_outlines
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.camera.pinhole import CameraModel, sampled

PX = 2000.0  # pixels of the floor's picture per m
CELL = 8  # px between projected points; between these points the map is nearly linear
SUPERSAMPLING = 4  # the walls are first drawn this many times finer
HEIGHTS = (1.0, 0.66, 0.33, 0.0)  # shares of the walls' height; at these heights the walls hide the floor
CLEAR = 25  # of 255, share of a pixel that a wall may hide
RAYS = 72
RAY_STEP_M = 0.00025  # m between points on a ray
RAY_POINTS = 11  # points on either side of the circle
WINDOWS = (0.0014, 0.0008, 0.0005, 0.0005)  # m, standard deviation of the search for the edge, round by round
TUKEY = (0.0025, 0.0012, 0.0008, 0.0006)  # m; an edge farther from the circle does not count, round by round
INLIER = 0.0005  # m, largest distance from the circle at which an edge agrees with it
SHARE = 0.4  # of the strength of a ray's clearest edge; a stronger change of light is an edge, too
PRIOR = np.diag([1e-9, 1e-9, 1.0])  # prior of the fit: the known radius counts as much as one ray
WHITE = 248.0  # if all colours just inside the circle are above this, the ray is overexposed
HOPELESS = 0.3  # minimum share of the visible rays that must agree in every round
WEAK = 8.0  # grey levels, sum of the colours over the edge's width; a weaker change of light is no edge


def floor_side(maze: Maze) -> int:
    """Length of a side of the floor's picture, px."""
    return CELL * math.ceil(2.0 * (maze.walls[0].outer_radius + 0.001) * PX / CELL)


class Floor:
    """The floor inside the rim, and the walls that hide it."""

    def __init__(self, maze: Maze) -> None:
        self.maze = maze
        self.side = floor_side(maze)  # of the floor's picture, px
        self.half = 0.5 * self.side / PX  # half of it, m
        self.solid = self._solid()  # picture with 255 at walls
        nodes = np.arange(0.5 * CELL - 0.5, self.side, CELL)
        across, down = np.meshgrid(nodes, nodes)
        flat = self.metres(np.array([across.ravel(), down.ravel()], dtype=float).T)
        self._nodes = np.column_stack([flat, np.zeros(len(flat))])

    def _solid(self) -> np.ndarray:
        size = self.side * SUPERSAMPLING
        picture = np.full((size, size), 255, np.uint8)

        def fixed(points: Array) -> np.ndarray:
            at = np.column_stack([points[:, 0] + self.half, self.half - points[:, 1]]) * PX * SUPERSAMPLING - 0.5
            return np.round(at).astype(np.int32)

        angle = np.linspace(0.0, math.tau, 720, endpoint=False)
        circle = np.column_stack([np.cos(angle), np.sin(angle)])
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


@dataclass(frozen=True, slots=True)
class OutlineFit:
    """A fitted outline."""

    x: float  # centre of the sphere, m
    y: float
    clear: float  # share of visible rays
    agree: float  # share of the visible rays that have an edge on the circle
    error: float  # standard deviation of x and y together, m
    wider: float  # radius of the edge minus radius of the sphere, m
    strength: float  # of the edge, grey levels, sum of the colours

    @property
    def confidence(self) -> float:
        """0 to 1, from the share of the outline that is visible and the share of it that agrees."""
        return min(1.0, self.agree) * min(1.0, 2.0 * self.clear * self.agree)


class Outline:
    """Fits outlines of spheres with one radius, m.

    darker: the ball is darker than the floor, so that bright spots are no edges."""

    def __init__(self, radius: float, floor: Floor, darker: bool) -> None:
        self.radius = radius
        self.floor = floor
        self.darker = darker
        angle = np.arange(RAYS) * math.tau / RAYS
        self._turn = np.column_stack([np.cos(angle), np.sin(angle)])
        self._offset = np.arange(-RAY_POINTS, RAY_POINTS + 1) * RAY_STEP_M

    def fit(
        self, seen: np.ndarray, empty: np.ndarray, clear: np.ndarray, eye: Array, place: Array
    ) -> OutlineFit | None:
        """Fit an outline near a place; None if there is none.

        seen, empty (side, side, 3): the floor now, and without a ball. clear (side, side): 255 where it is visible.
        eye (3,), place (2,): the camera, and a first guess of the centre, in the plate frame, m."""
        start = place.copy()
        result = None
        for window, tukey in zip(WINDOWS, TUKEY, strict=True):
            edge, strength, ok, flat = self._edges(seen, empty, clear, eye, place, window)
            known = ok & (strength > WEAK)
            if known.sum() < RAYS // 8:
                return None
            move, off, weight, spread = _laid(edge, flat, known, tukey)
            place = place + np.clip(move[:2], -0.0015, 0.0015)
            if np.hypot(*(place - start)) > self.radius:
                return None
            on = known & (np.abs(off) < INLIER)
            if on.sum() < HOPELESS * ok.sum():
                return None
            scatter = math.sqrt(float((weight * off**2).sum()) / max(1.0, float(weight.sum()) - 3.0))
            error = scatter * math.sqrt(float(np.trace(spread[:2, :2])))
            agree, clearest = float(on.sum() / max(1, ok.sum())), float(np.median(strength[on])) if on.any() else 0.0
            x, y = place.tolist()
            result = OutlineFit(x, y, float(ok.mean()), agree, error, float(move[2]), clearest)
        return result

    def _edges(
        self, seen: np.ndarray, empty: np.ndarray, clear: np.ndarray, eye: Array, place: Array, window: float
    ) -> tuple[Array, Array, np.ndarray, Array]:
        """For each ray: distance of its edge from the circle, + outside, m; strength of the edge; whether the ray is
        visible; its direction in the plate's x, y plane, (RAYS, 2)."""
        centre = np.array([place[0], place[1], self.radius])
        away = centre - eye
        far = float(np.linalg.norm(away))
        away /= far
        first = np.cross(away, [0.0, 1.0, 0.0])
        first /= np.linalg.norm(first)
        rays = self._turn @ np.array([first, np.cross(first, away)])
        circle = self.radius * math.sqrt(1.0 - (self.radius / far) ** 2)
        middle = centre - away * self.radius**2 / far
        points = middle + (circle + self._offset)[None, :, None] * rays[:, None, :]
        on_floor = eye[:2] + (points[..., :2] - eye[:2]) * (eye[2] / (eye[2] - points[..., 2]))[..., None]
        where = self.floor.pixels(on_floor.reshape(-1, 2)).astype(np.float32).reshape(RAYS, -1, 2)
        now = sampled(seen, where).astype(np.float32)
        then = sampled(empty, where).astype(np.float32)
        sure = sampled(clear, where) > 250
        off = now - then
        rise = (off[:, 2:] - off[:, :-2]).sum(axis=2)  # rise of the light outwards
        change = np.maximum(rise, 0.0) if self.darker else np.abs(rise)
        change[~(sure[:, 2:] & sure[:, :-2])] = 0.0
        at = self._offset[1:-1]
        likely = change * np.exp(-0.5 * (at / window) ** 2)
        # take the outermost of the clear edges, because farther inside the ball mirrors other edges
        peak = (change >= np.roll(change, 1, axis=1)) & (change >= np.roll(change, -1, axis=1))
        peak &= likely > SHARE * likely.max(axis=1, keepdims=True)
        best = np.clip(len(at) - 1 - peak[:, ::-1].argmax(axis=1), 1, len(at) - 2)
        before, there, after = (np.take_along_axis(change, best[:, None] + i, axis=1)[:, 0] for i in (-1, 0, 1))
        bend = np.minimum(before + after - 2.0 * there, -1e-6)
        edge = at[best] + RAY_STEP_M * np.clip(0.5 * (before - after) / bend, -1.0, 1.0)
        ok = sure[:, RAY_POINTS - 4 : RAY_POINTS + 5].all(axis=1)
        ok &= ~(now[:, RAY_POINTS - 4 : RAY_POINTS].min(axis=2) > WHITE).any(axis=1)
        return edge, there, ok, rays[:, :2]


def _laid(edge: Array, flat: Array, known: np.ndarray, tukey: float) -> tuple[Array, Array, Array, Array]:
    """Fit a circle to edges (RAYS,), given as distances from the present circle, + outside, m.

    Returns the change of x, y and radius, the residuals, the weights, and the inverse of the normal matrix."""
    columns = np.column_stack([flat, np.ones(len(edge))])
    off, move, spread = edge, np.zeros(3), np.eye(3)
    weight = known * np.clip(1.0 - (off / tukey) ** 2, 0.0, 1.0) ** 2
    for _ in range(3):  # the weights depend on the circle
        spread = np.array(np.linalg.inv((columns * weight[:, None]).T @ columns + PRIOR), dtype=float)
        move = spread @ ((columns * weight[:, None]).T @ edge)
        off = edge - columns @ move
        weight = known * np.clip(1.0 - (off / tukey) ** 2, 0.0, 1.0) ** 2
    return move, off, weight, spread
