"""Finds the ball in a picture.

1. Find the plate's tilt by its markers.
2. Straighten the picture of the floor (`floor`), and subtract the empty floor in the same light. Ball, reflections and
   shadows remain.
3. Find discs of large difference at places where a ball has room.
4. For each disc, fit the outline of a sphere to the visible edge (`Outline`).

If one outline fits, it is the ball. If two fit, there is no result. The detector uses this picture alone: it has no
memory.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import cv2
import numpy as np

from mazeplan.core.errors import SettingsError
from mazeplan.core.records import Array
from mazeplan.core.whole_file import whole_file
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.camera.floor import PX, Floor, Outline, OutlineFit, floor_side
from mazeplan.rigs.camera.pinhole import CameraModel, Markers, TiltFinder

HALF = 2  # the search for discs uses a picture this many times smaller
LIGHT = 100.0  # a floor with a median above this, 0 to 255, is brighter than the ball
LIGHT_SCALE = 8  # the light is compared in a picture this many times smaller
BLACK = 12.0  # median of a picture without light, 0 to 255
CONTRAST = 14.0  # minimum difference between ball and floor, grey levels
DARKEST = 0.2  # minimum light, as a share of the background's light
MOVED_PX = 2.5  # px, largest rms error of the markers
CLEAR, AGREE = 0.3, 0.66  # minimum shares of the outline that agree with the circle: of all rays, of the visible rays
ERROR_M = 0.00012  # m, largest standard deviation of the centre
WIDER_M = 0.0005  # m, largest difference between the radius of the edge and that of the ball
TOLERANCE_M = 0.001  # m, allowed error of the places of walls and ball
RIVAL = 0.5  # an outline with more than this share of the best one's strength x agreement may be a second ball
EDGE = 0.06  # minimum step of light at the outline, as a share of the floor's light
FILLED = 0.05  # minimum score of a candidate, divided by the area of its disc
CANDIDATES, RIVAL_SCORE = 4, 0.2  # largest number of candidates; minimum score, as a share of the best one's


class DetectionOutcome(StrEnum):
    """Result of the search in a picture."""

    FOUND = "found"
    DARK = "too dark"
    NO_MARKERS = "no markers"
    MOVED = "camera moved"
    NO_BALL = "no ball"
    UNSURE = "no clear outline"
    TWO = "two balls"


@dataclass(frozen=True, slots=True)
class Sighting:
    """What the detector found in a picture."""

    x: float | None  # centre of the ball in the plate frame, m; None without a ball
    y: float | None
    confidence: float  # 0 to 1
    why: DetectionOutcome
    beta: float | None = None  # tilt of the plate by its markers, rad; None without markers
    gamma: float | None = None


@dataclass(frozen=True)
class Background:
    """The floor without a ball, on a level plate."""

    picture: np.ndarray  # (side, side, 3)
    known: np.ndarray  # (side, side), 255 where the floor was seen

    def write(self, path: Path) -> None:
        """Write a PNG with `known` as its fourth channel. Raises SettingsError if that fails."""
        done, data = cv2.imencode(".png", np.dstack([self.picture, self.known]))
        try:
            with whole_file(path) as beside:
                beside.write_bytes(data.tobytes() if done else b"")
        except OSError as problem:
            raise SettingsError(f"cannot be written: {problem.strerror or problem}", file=path) from None

    @staticmethod
    def read(path: Path, maze: Maze) -> Background:
        """Read what `write` wrote. Raises SettingsError if it is no background of this maze."""
        try:
            data = np.frombuffer(path.read_bytes(), np.uint8)
        except OSError as problem:
            raise SettingsError(f"background cannot be read: {problem.strerror or problem}", file=path) from None
        picture = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
        side = floor_side(maze)
        if picture is None or picture.shape != (side, side, 4):
            got = "no picture" if picture is None else f"a picture of shape {picture.shape}"
            raise SettingsError(f"got {got}, expected {(side, side, 4)}: a background of map {maze.name}", file=path)
        return Background(np.ascontiguousarray(picture[..., :3]), np.ascontiguousarray(picture[..., 3]))


class BallDetector:
    """Finds the ball in pictures of one calibrated camera."""

    def __init__(self, maze: Maze, camera: CameraModel, background: Background, markers: Markers | None) -> None:
        self.maze = maze
        self.camera = camera
        self.background = background
        self.floor = Floor(maze)
        self._tilt = None if markers is None else TiltFinder(camera, markers)
        floor = np.median(background.picture[background.known > 0], axis=0)
        self._light = float(floor.sum())
        self._outline = Outline(maze.ball.radius, self.floor, darker=float(floor.mean()) > LIGHT)
        self._room = cv2.distanceTransform(255 - self.floor.solid, cv2.DIST_L2, 5) / PX
        allowed = (self._room >= maze.ball.radius - TOLERANCE_M).astype(np.uint8) * 255
        self._allowed = cv2.resize(allowed, None, fx=1 / HALF, fy=1 / HALF)
        self._disc, self._ring = _kernels(maze.ball.radius * PX / HALF)

    def locate(self, image: np.ndarray, tilt: tuple[float, float] | None = None) -> Sighting:
        """Find the ball in a picture (height, width, 3), BGR.

        tilt: beta, gamma, rad; used if the picture shows no markers.

        Raises ValueError for a picture of another size than the camera's."""
        if image.shape != (self.camera.size[1], self.camera.size[0], 3):
            raise ValueError(f"got a picture of shape {image.shape}, expected {self.camera.size[::-1]} and 3 colours")
        found = None if self._tilt is None else self._tilt.tilt(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        if found is not None and found[2] > MOVED_PX:
            return Sighting(None, None, 0.0, DetectionOutcome.MOVED)
        used = tilt if found is None else found[:2]
        if used is None:
            dark = float(np.median(image[::8, ::8])) < BLACK
            return Sighting(None, None, 0.0, DetectionOutcome.DARK if dark else DetectionOutcome.NO_MARKERS)
        by_markers = (None, None) if found is None else found[:2]
        why, fit = self._look(image, *used)
        if fit is None:
            return Sighting(None, None, 0.0, why, *by_markers)
        return Sighting(fit.x, fit.y, fit.confidence, why, *by_markers)

    def _look(self, image: np.ndarray, beta: float, gamma: float) -> tuple[DetectionOutcome, OutlineFit | None]:
        """Fit outlines of spheres at places where a ball has room, and choose the only good one."""
        eye = self.camera.centre(beta, gamma)
        seen = self.floor.straighten(image, self.camera, beta, gamma)
        clear = cv2.bitwise_and(self.floor.visible(eye), self.background.known)
        empty, light = _relit(self.background.picture, seen, clear)
        if light < DARKEST:
            return DetectionOutcome.DARK, None
        fits = []
        for x, y in self._candidates(_differs(seen, empty, clear), eye):
            fit = self._outline.fit(seen, empty, clear, eye, np.array([x, y]))
            if fit is not None and fit.strength >= EDGE * self._light * light and self._possible(fit):
                fits.append(fit)
        good = [fit for fit in fits if _good(fit)]
        if not good:
            return (DetectionOutcome.UNSURE if fits else DetectionOutcome.NO_BALL), None
        best = max(good, key=lambda fit: fit.strength * fit.confidence)
        # a second ball is at another place, and nearly as clear; a shadow has a soft edge
        least, radius = RIVAL * best.strength * best.agree, self.maze.ball.radius
        others = [fit for fit in fits if np.hypot(fit.x - best.x, fit.y - best.y) > radius]
        rivals = [fit for fit in others if fit.strength * fit.agree > least]
        if rivals:
            return (DetectionOutcome.TWO if any(_good(fit) for fit in rivals) else DetectionOutcome.UNSURE), None
        return DetectionOutcome.FOUND, best

    def _candidates(self, differs: np.ndarray, eye: Array) -> list[tuple[float, float]]:
        """Places (x, y), m, where the ball's centre may be, best first.

        The score of a place is the difference inside a disc minus the difference in a ring around it."""
        ball, floor = self.maze.ball.radius, self.floor
        small = cv2.resize(differs, None, fx=1 / HALF, fy=1 / HALF, interpolation=cv2.INTER_AREA).astype(np.float32)
        score = cv2.filter2D(small, cv2.CV_32F, (self._disc - self._ring) / 255.0, borderType=cv2.BORDER_CONSTANT)
        # allowed centres, projected to the floor behind them
        k, foot = ball / eye[2], (floor.pixels(eye[None, :2])[0] + 0.5) / HALF - 0.5
        warp = np.array([[1.0 - k, 0.0, k * foot[0]], [0.0, 1.0 - k, k * foot[1]]])
        allowed = cv2.warpAffine(self._allowed, warp, score.shape[::-1], flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)
        found, first = [], 0.0
        for _ in range(CANDIDATES):
            _, best, _, at = cv2.minMaxLoc(score, allowed)
            if best < max(FILLED * self._disc.sum(), RIVAL_SCORE * first):
                break
            first = max(first, best)
            q = floor.metres(np.array([at]) * HALF + 0.5 * (HALF - 1))[0]
            found.append(tuple((q + (eye[:2] - q) * ball / eye[2]).tolist()))
            cv2.circle(allowed, at, round(1.2 * ball * PX / HALF), 0, -1)
        return found

    def _possible(self, fit: OutlineFit) -> bool:
        """Whether a ball has room at the place of the fit."""
        column, row = np.round(self.floor.pixels(np.array([[fit.x, fit.y]]))[0]).astype(int)
        side = self.floor.side
        inside = 0 <= column < side and 0 <= row < side
        return bool(inside and self._room[row, column] >= self.maze.ball.radius - TOLERANCE_M)


def _good(fit: OutlineFit) -> bool:
    return fit.clear * fit.agree >= CLEAR and fit.agree >= AGREE and fit.error <= ERROR_M and abs(fit.wider) <= WIDER_M


def _differs(seen: np.ndarray, empty: np.ndarray, clear: np.ndarray) -> np.ndarray:
    """Difference between the floor and the empty floor, 0 to 255; 0 where it is within the noise."""
    blue, green, red = cv2.split(cv2.absdiff(seen, empty))
    most = cv2.max(cv2.max(blue, green), red)
    sample = most[2::5, 2::5][clear[2::5, 2::5] > 0]
    noise = 1.5 * float(np.median(sample)) if sample.size else 0.0
    most = cv2.threshold(most, max(CONTRAST, 3.0 * noise), 0, cv2.THRESH_TOZERO)[1]
    return cv2.bitwise_and(most, clear)


def _kernels(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """A disc, and a ring around it with weight 0.7."""
    reach = int(1.6 * radius) + 1
    rho = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1])
    disc = np.clip(radius - rho + 0.5, 0.0, 1.0)
    ring = 0.7 * np.clip(1.5 * radius - rho + 0.5, 0.0, 1.0) * (1.0 - disc)
    return disc.astype(np.float32), ring.astype(np.float32)


def _relit(picture: np.ndarray, seen: np.ndarray, clear: np.ndarray) -> tuple[np.ndarray, float]:
    """The background in this picture's light, and the mean gain of the light.

    First each colour gets its gain, then a smooth correction follows the light over the floor."""
    at = clear[2::5, 2::5] > 0
    if not at.any():
        return picture, 0.0
    now, then = seen[2::5, 2::5][at].astype(np.float32), picture[2::5, 2::5][at].astype(np.float32)
    gain = np.median((now + 1.0) / (then + 1.0), axis=0)
    table = np.clip(np.arange(256)[:, None] * gain[None, :], 0, 255).astype(np.uint8)[None]
    empty = cv2.LUT(picture, table)
    small = (picture.shape[1] // LIGHT_SCALE, picture.shape[0] // LIGHT_SCALE)
    share = cv2.resize(clear, small, interpolation=cv2.INTER_AREA)
    grey = [cv2.cvtColor(one, cv2.COLOR_BGR2GRAY) for one in (seen, empty)]
    off = cv2.subtract(*(cv2.resize(one, small, interpolation=cv2.INTER_AREA) for one in grey), dtype=cv2.CV_16S)
    off = np.clip(off + 128, 0, 255).astype(np.uint8)
    off[share < 250] = 128
    off = cv2.GaussianBlur(cv2.medianBlur(off, 11), (0, 0), 2.0)
    over = cv2.resize(off, picture.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    over = cv2.cvtColor(over, cv2.COLOR_GRAY2BGR)
    return cv2.addWeighted(empty, 1.0, over, 1.0, -128.0), float(gain.mean())
