"""Renders pictures of the overhead camera: maze, walls with height, markers, ball, light, lens, noise.

OpenCV draws from back to front: table, floor with shadows and the lamp's reflection, walls in layers from the floor up,
ball, tops of the walls. It first draws without distortion, by homographies of planes. Then it distorts the picture as
the lens does. This module does not use the projection of `pinhole`, so that rendering and detection are independent.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from emulator.look import SHADE, SPRITE, Look, grain, sprite
from mazeplan.core.records import Array
from mazeplan.maze.drawing import radial_outline, wall_outlines
from mazeplan.maze.geometry import Maze, Wall
from mazeplan.rigs.camera.pinhole import DICTIONARY, MARGIN, CameraModel, Markers, corner_markers, rotation

FLOOR_PX = 3000.0  # pixels of the floor's picture per m
LAYERS = 8  # layers in which a wall is drawn, below its top
SHIFT = 5  # fractional bits of drawn corners
PENUMBRA = 0.0015  # m, standard deviation of the blur of shadows
WALL_SHADE = 0.72  # share of the light in the shadow of a wall
WHOLE = 0.10189  # m, outer radius of the packaged maze, whose whole plate the packaged camera sees
TRUE = CameraModel(
    np.array([[1200.0, 0.0, 322.0], [0.0, 1200.0, 241.0], [0.0, 0.0, 1.0]]),
    np.array([-0.12, 0.08, 0.0005, -0.0004, 0.0]),
    rotation([0.01, -0.012, 0.015]) @ np.diag([1.0, -1.0, -1.0]),
    np.array([0.001, -0.002, 0.62]),
)


def tilting(beta: float, gamma: float, pivot: Array) -> Array:
    """Matrix (4, 4) from the plate frame to the level plate frame, from rotations about single axes."""
    out = np.eye(4)
    out[:3, :3] = rotation([0.0, beta, 0.0]) @ rotation([gamma, 0.0, 0.0])
    out[:3, 3] = pivot - out[:3, :3] @ pivot
    return out


def outlines(wall: Wall, steps: int = 360) -> list[Array]:
    """Outlines (N, 2), m, of the solid pieces of a wall. For a wall without openings they are its two circles."""
    pieces = wall_outlines(wall)
    if pieces:
        return pieces
    angle = np.linspace(0.0, math.tau, steps, endpoint=False)
    return [r * np.column_stack([np.cos(angle), np.sin(angle)]) for r in (wall.inner_radius, wall.outer_radius)]


class Overhead:
    """Draws pictures of one camera. This is the true camera; a detector should use a calibrated one."""

    def __init__(self, maze: Maze, camera: CameraModel, look: Look | None = None, markers: Markers | None = None):
        self.maze, self.camera, self.look = maze, camera, look or Look()
        self.markers = corner_markers(maze) if markers is None else markers
        self._times = 2 if self.look.sharp else 1
        pieces = [outline for wall in maze.walls for outline in outlines(wall)]
        pieces += [radial_outline(maze, wall) for wall in maze.radial_walls]
        self._corners = np.concatenate(pieces)  # one call for all pieces is faster
        self._ends = np.cumsum([len(piece) for piece in pieces])[:-1]
        places = [abs(value) + 0.5 * self.markers.size for at in self.markers.places.values() for value in at[:2]]
        self._half = max([maze.walls[0].outer_radius, *places]) + 2.0 * MARGIN
        self._bend = self._lens()
        self._paint()
        self._noise = (
            np.random.default_rng(7).standard_normal((1 << 21) + 640 * 480 * 3).astype(np.float32) * self.look.noise
        )

    # -- fixed parts ------------------------------------------------------------------------------------------------

    def _lens(self) -> tuple[np.ndarray, np.ndarray]:
        """For each pixel of the distorted picture, its place in the undistorted picture."""
        width, height = self.camera.size
        grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 1, 2).astype(float)
        term = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-9)
        straight = cv2.undistortPoints(
            grid, self.camera.matrix, self.camera.distortion, P=self.camera.matrix, criteria=term
        )
        straight = straight.reshape(height, width, 2).astype(np.float32)
        return cv2.convertMaps(straight[..., 0], straight[..., 1], cv2.CV_16SC2)

    def _floor_px(self, points: Array) -> Array:
        """Pixels (N, 2) in the floor's picture of points (N, 2), m."""
        return np.column_stack([points[:, 0] + self._half, self._half - points[:, 1]]) * FLOOR_PX - 0.5

    def _paint(self) -> None:
        """Paint the parts that stay: the floor with markers and without shadows, the places of the walls, the table."""
        look, side = self.look, round(2.0 * self._half * FLOOR_PX)
        tone = 1.0 + 0.008 * grain((side, side), 1.2, 1) + 0.012 * grain((side, side), 40.0, 2)
        floor = np.array(look.floor, dtype=np.float32) * tone[..., None]
        for number in self.markers.places:
            self._marker(floor, number)
        solid = np.zeros((side, side), np.uint8)
        corners = np.round(self._floor_px(self._corners) * (1 << SHIFT)).astype(np.int32)
        cv2.fillPoly(solid, np.split(corners, self._ends), 255, cv2.LINE_AA, SHIFT)
        near = cv2.GaussianBlur(solid, (0, 0), 0.004 * FLOOR_PX).astype(np.float32) / 255.0
        floor *= (1.0 - 0.22 * near)[..., None]  # near walls, less of the room's light reaches the floor
        self._solid, self._floor = solid, floor.astype(np.uint8)
        self._level_shade = self._wall_shade(np.array(look.lamp))
        self._lit = self._shaded(self._floor, self._level_shade)
        width, height = (self._times * value for value in self.camera.size)
        wood = 1.0 + 0.10 * cv2.resize(grain((height, width // 8), 1.5, 3), (width, height))
        self._table = np.clip(np.array(look.table, dtype=np.float32) * wood[..., None], 0, 255).astype(np.uint8)

    def _marker(self, floor: np.ndarray, number: int) -> None:
        words = cv2.aruco.getPredefinedDictionary(DICTIONARY)
        cells = words.markerSize + 2
        picture = cv2.aruco.generateImageMarker(words, number, cells * 20)
        white = round(20 * cells * MARGIN / self.markers.size)
        picture = cv2.copyMakeBorder(picture, white, white, white, white, cv2.BORDER_CONSTANT, value=255)
        picture = cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR).astype(np.float32) * 0.86 + 14.0
        side, half = picture.shape[0], 0.5 * self.markers.size + MARGIN
        x, y, _ = self.markers.places[number]
        there = self._floor_px(np.array([[x - half, y + half], [x + half, y + half], [x - half, y - half]]))
        here = np.array([[-0.5, -0.5], [side - 0.5, -0.5], [-0.5, side - 0.5]], np.float32)
        warp = cv2.getAffineTransform(here, there.astype(np.float32))
        size = floor.shape[1::-1]
        small = cv2.GaussianBlur(picture, (0, 0), 0.4 * side / (2.0 * half * FLOOR_PX))
        cv2.warpAffine(small, warp, size, floor, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_TRANSPARENT)

    # -- light --------------------------------------------------------------------------------------------------------

    def _wall_shade(self, lamp: Array) -> np.ndarray:
        """Light on the floor, 0 to 255, with the shadows of the walls. lamp: its place (3,) in the plate frame, m."""
        shade = self._solid.copy()
        for share in (0.33, 0.66, 1.0):
            k = share * self.maze.wall_height / lamp[2]
            foot = self._floor_px(lamp[None, :2])[0]
            warp = np.array([[1.0 - k, 0.0, k * foot[0]], [0.0, 1.0 - k, k * foot[1]]])
            flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            shade = cv2.max(shade, cv2.warpAffine(self._solid, warp, self._solid.shape[::-1], flags=flags))
        soft = cv2.GaussianBlur(shade, (0, 0), PENUMBRA * FLOOR_PX)
        return cv2.convertScaleAbs(soft, alpha=-(1.0 - WALL_SHADE), beta=255)

    @staticmethod
    def _shaded(floor: np.ndarray, shade: np.ndarray) -> np.ndarray:
        return cv2.multiply(floor, cv2.cvtColor(shade, cv2.COLOR_GRAY2BGR), scale=1.0 / 255.0)

    def _ball_shadow(self, floor: np.ndarray, shade: np.ndarray, ball: Array, lamp: Array) -> None:
        """Darken the floor in the ball's shadow, an ellipse."""
        along = (ball - lamp) / (lamp[2] - ball[2])
        middle = ball[:2] + along[:2] * ball[2]
        lean, radius = math.hypot(along[0], along[1]), self.maze.ball.radius
        axes = (radius * math.hypot(1.0, lean), radius)
        where, mask = self._soft_ellipse(middle, axes, math.atan2(along[1], along[0]))
        both = np.minimum(shade[where], 255.0 - (255.0 * (1.0 - SHADE)) * mask).astype(np.uint8)
        floor[where] = self._shaded(self._floor[where], both) if both.size else floor[where]

    def _soft_ellipse(self, middle: Array, axes: tuple[float, float], turn: float) -> tuple[Any, np.ndarray]:
        """Slices of the floor's picture around an ellipse (m, rad), and its mask, 0 to 1."""
        reach = max(axes) + 4.0 * PENUMBRA
        low = np.floor(self._floor_px((middle + np.array([-reach, reach]))[None])[0]).astype(int)
        high = np.ceil(self._floor_px((middle + np.array([reach, -reach]))[None])[0]).astype(int)
        side = self._floor.shape[0]
        left, top = (int(value) for value in np.clip(low, 0, side))
        right, bottom = (int(value) for value in np.clip(high, 0, side))
        mask = np.zeros((bottom - top, right - left), np.float32)
        if mask.size:
            at = (self._floor_px(middle[None])[0] - (left, top)) * 32
            size = tuple(round(value * FLOOR_PX * 32) for value in axes)
            centre, turned = (round(at[0]), round(at[1])), -math.degrees(turn)
            cv2.ellipse(mask, centre, size, turned, 0.0, 360.0, 1.0, thickness=-1, lineType=cv2.LINE_8, shift=5)
            mask = cv2.GaussianBlur(mask, (0, 0), PENUMBRA * FLOOR_PX)
        return (slice(top, bottom), slice(left, right)), mask

    def _reflection(self, floor: np.ndarray, eye: Array, lamp: Array) -> None:
        """The lamp's reflection in a glossy floor."""
        share = eye[2] / (eye[2] + lamp[2])
        middle = eye[:2] + (lamp[:2] - eye[:2]) * share
        for size, strength in ((0.011, 1.0), (0.026, 0.25)):
            where, mask = self._soft_ellipse(middle, (size * 1.3, size), 0.5)
            more = floor[where] + (255.0 * self.look.gloss * strength) * mask[..., None]
            floor[where] = np.minimum(more, 255.0).astype(np.uint8)

    # -- a picture ----------------------------------------------------------------------------------------------------

    def render(
        self, ball: Array | None, beta: float, gamma: float, rng: np.random.Generator, *, others: tuple[Array, ...] = ()
    ) -> np.ndarray:
        """A picture (height, width, 3), BGR, uint8.

        ball: centre (3,) of the ball in the plate frame, m; None: no ball.
        beta, gamma: tilt of the plate, rad.
        rng: random numbers of light and sensor.
        others: centres of more balls."""
        to_plate: Array = np.array(np.linalg.inv(tilting(beta, gamma, self.camera.pivot)), dtype=float)
        eye = (to_plate @ np.append(-self.camera.rotation.T @ self.camera.translation, 1.0))[:3]
        lamp = (to_plate @ np.append(self.look.lamp, 1.0))[:3]
        balls = [*([] if ball is None else [np.asarray(ball, dtype=float)]), *others]
        shade = self._wall_shade(lamp) if self.look.sharp else self._level_shade
        floor = self._shaded(self._floor, shade) if self.look.sharp else self._lit.copy()
        for one in balls:
            self._ball_shadow(floor, shade, one, lamp)
        if self.look.gloss > 0.0:
            self._reflection(floor, eye, lamp)
        camera = self._straight(beta, gamma)
        canvas = self._table.copy()
        corner = FLOOR_PX * self._half - 0.5
        to_metres = np.array([[1 / FLOOR_PX, 0, -corner / FLOOR_PX], [0, -1 / FLOOR_PX, corner / FLOOR_PX], [0, 0, 1]])
        cv2.warpPerspective(
            floor, camera[:, [0, 1, 3]] @ to_metres, canvas.shape[1::-1], canvas,
            flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_TRANSPARENT,
        )  # fmt: skip
        self._walls(canvas, camera)
        for one in balls:
            self._ball(canvas, camera, one, eye, lamp)
        self._level(canvas, camera, self.maze.wall_height, self.look.wall, cv2.LINE_AA)
        return self._taken(canvas, rng)

    def _straight(self, beta: float, gamma: float) -> Array:
        """Matrix (3, 4) from the plate frame to pixels of the undistorted picture, which may have twice the size."""
        pose = np.hstack([self.camera.rotation, self.camera.translation[:, None]])
        n = self._times
        larger = np.array([[n, 0.0, 0.5 * (n - 1)], [0.0, n, 0.5 * (n - 1)], [0.0, 0.0, 1.0]])
        return larger @ self.camera.matrix @ pose @ tilting(beta, gamma, self.camera.pivot)

    def _walls(self, canvas: np.ndarray, camera: Array) -> None:
        """Draw the sides of the walls: their outlines in layers, darker towards the floor."""
        for layer in range(LAYERS):
            share = (layer + 0.5) / LAYERS
            colour = tuple(float(value) * (0.42 + 0.22 * share) for value in self.look.wall)
            self._level(canvas, camera, share * self.maze.wall_height, colour, cv2.LINE_8)

    def _level(self, canvas: np.ndarray, camera: Array, z: float, colour: tuple[float, ...], line: int) -> None:
        plane = camera[:, [0, 1, 3]].copy()
        plane[:, 2] += z * camera[:, 2]
        cv2.fillPoly(canvas, np.split(_fixed(plane, self._corners), self._ends), colour, line, SHIFT)

    def _ball(self, canvas: np.ndarray, camera: Array, ball: Array, eye: Array, lamp: Array) -> None:
        """Draw a sphere: its outline is a circle across the line of sight, a little nearer than its centre."""
        radius = self.maze.ball.radius
        away = ball - eye
        far = float(np.linalg.norm(away))
        away = away / far
        middle = ball - away * radius**2 / far
        reach = radius * math.sqrt(1.0 - (radius / far) ** 2)
        right = np.cross(away, [0.0, 1.0, 0.0])
        right = right / np.linalg.norm(right)
        up = np.cross(right, away)
        ends = np.array([middle + reach * v for v in (right, -right, up, -up)])
        pixels = np.column_stack([ends, np.ones(4)]) @ camera.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        origin, u, v = pixels.mean(axis=0), 0.5 * (pixels[0] - pixels[1]), 0.5 * (pixels[2] - pixels[3])
        to_lamp = (lamp - ball) / np.linalg.norm(lamp - ball)
        seen = np.array([to_lamp @ right, to_lamp @ up, -(to_lamp @ away)])
        out = np.array([ball[0], ball[1], 0.0]) / max(1e-9, math.hypot(ball[0], ball[1]))
        colour, cover = sprite(self.look, seen, np.array([out @ right, out @ up]))
        size = np.abs(u) + np.abs(v)
        low = np.maximum(np.floor(origin - 1.3 * size).astype(int), 0)
        high = np.minimum(np.ceil(origin + 1.3 * size).astype(int) + 1, canvas.shape[1::-1])
        if (high <= low).any():
            return
        scale = 2.5 / SPRITE  # radii of the disc per pixel of the sprite
        to_unit = np.array([[scale, 0.0, 0.5 * scale - 1.25], [0.0, -scale, 1.25 - 0.5 * scale]])
        warp = np.column_stack([u, v]) @ to_unit
        warp[:, 2] += origin - low
        patch = canvas[low[1] : high[1], low[0] : high[0]]
        size_px = (int(high[0] - low[0]), int(high[1] - low[1]))
        alpha = cv2.warpAffine(cover, warp, size_px, flags=cv2.INTER_AREA)[..., None]
        paint = cv2.warpAffine(colour, warp, size_px, flags=cv2.INTER_AREA)
        patch[:] = np.clip(patch * (1.0 - alpha) + paint * alpha, 0, 255).astype(np.uint8)

    def _taken(self, canvas: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Apply lens, light and sensor to the drawn picture."""
        look, (width, height) = self.look, self.camera.size
        if self._times > 1:
            canvas = cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA)
        picture = cv2.remap(canvas, *self._bend, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        if look.blur > 0.0:
            picture = cv2.GaussianBlur(picture, (0, 0), look.blur)
        light = look.exposure * max(0.0, 1.0 + look.flicker * rng.standard_normal())
        across = light * (1.0 + look.slope * np.linspace(-0.5, 0.5, width, dtype=np.float32))
        out = picture * across[None, :, None]
        start = int(rng.integers(len(self._noise) - out.size + 1))
        out += self._noise[start : start + out.size].reshape(out.shape)
        out += 0.5
        return np.clip(out, 0, 255, out=out).astype(np.uint8)


def _fixed(plane: Array, points: Array) -> np.ndarray:
    """Pixels (N, 2), in units of 1 / 2**SHIFT, of points (N, 2), m, on a plane with this homography."""
    at = points @ plane[:, :2].T + plane[:, 2]
    return np.round(at[:, :2] / at[:, 2:] * (1 << SHIFT)).astype(np.int32)


def over(camera: CameraModel, maze: Maze) -> CameraModel:
    """The camera over a maze. It hangs higher over a larger maze, which then looks as large as the packaged maze."""
    larger = maze.walls[0].outer_radius / WHOLE
    return camera if larger <= 1.0 + 1e-9 else replace(camera, translation=camera.translation * larger)
