"""Finds the ball in a picture.

1. Find the plate's tilt by its markers.
2. Straighten the picture of the floor (`floor`), and subtract the empty floor in the same light. Ball, reflections and
   shadows remain.
3. Find discs of large difference at places where a ball has room.
4. For each disc, fit the outline of a sphere to the visible edge (`outline`).

If one outline fits, it is the ball. If two fit, there is no result. The detector uses this picture alone: it has no
memory.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np

from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.camera.floor import PX, Floor
from mazeplan.rigs.camera.markers import Markers, TiltFinder
from mazeplan.rigs.camera.outline import Outline, OutlineFit
from mazeplan.rigs.camera.pinhole import CameraModel

HALF = 2  # the search for discs uses a picture this many times smaller
LIGHT = 100.0  # a floor with a median above this, 0 to 255, is brighter than the ball
SLOW = 8  # the light is compared in a picture this many times smaller


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
    """What the detector found in a picture.

    x, y: centre of the ball in the plate frame, m; None without a ball.
    confidence: 0 to 1.
    why: result of the search.
    beta, gamma: tilt of the plate by its markers, rad; None without markers.
    error: standard deviation of x and y together, from the scatter of the outline, m."""

    x: float | None
    y: float | None
    confidence: float
    why: DetectionOutcome
    beta: float | None = None
    gamma: float | None = None
    error: float | None = None


@dataclass(frozen=True)
class Background:
    """The floor without a ball, on a level plate.

    picture: (side, side, 3).
    known: 255 where the floor was seen."""

    picture: np.ndarray
    known: np.ndarray


@dataclass(frozen=True)
class DetectorSettings:
    """Limits of the detector.

    hue_deg: range of the ball's hue (0 red, 120 green, 240 blue); None for steel.
    saturation: minimum saturation of a coloured ball, of 255.
    contrast: minimum difference between ball and floor, grey levels.
    darkest: minimum light, as a share of the background's light.
    moved_px: largest rms error of the markers, px.
    clear: minimum share of the outline that is visible and on the circle.
    agree: minimum share of the visible outline that is on the circle.
    error_m: largest standard deviation of the centre, m.
    wider_m: largest difference between the radius of the edge and that of the ball, m.
    tolerance_m: allowed error of the places of walls and ball, m.
    rival: an outline with more than this share of the best outline's strength x agreement may be a second ball.
    edge: minimum step of light at the outline, as a share of the floor's light.
    filled: minimum score of a candidate, divided by the area of its disc.
    candidates: largest number of candidates.
    rival_score: minimum score of a candidate, as a share of the best score."""

    hue_deg: tuple[float, float] | None = None
    saturation: int = 90
    contrast: float = 14.0
    darkest: float = 0.2
    moved_px: float = 2.5
    clear: float = 0.3
    agree: float = 0.66
    error_m: float = 0.00012
    wider_m: float = 0.0005
    tolerance_m: float = 0.001
    rival: float = 0.5
    edge: float = 0.06
    filled: float = 0.05
    candidates: int = 4
    rival_score: float = 0.2


class BallDetector:
    """Finds the ball in pictures of one calibrated camera."""

    def __init__(
        self,
        maze: Maze,
        camera: CameraModel,
        background: Background,
        markers: Markers | None,
        settings: DetectorSettings | None = None,
    ) -> None:
        self.maze, self.camera, self.settings = maze, camera, settings or DetectorSettings()
        self.floor = Floor(maze)
        self.background = background
        self._tilt = None if markers is None else TiltFinder(camera, markers)
        floor = np.median(background.picture[background.known > 0], axis=0)
        self._light = float(floor.sum())
        self._outline = Outline(maze.ball.radius, self.floor, darker=float(floor.mean()) > LIGHT)
        room = cv2.distanceTransform(255 - self.floor.solid, cv2.DIST_L2, 5) / PX
        allowed = (room >= maze.ball.radius - self.settings.tolerance_m).astype(np.uint8) * 255
        self._room, self._allowed = room, cv2.resize(allowed, None, fx=1 / HALF, fy=1 / HALF)
        self._disc, self._ring = _kernels(maze.ball.radius * PX / HALF)

    def locate(self, image: np.ndarray, tilt: tuple[float, float] | None = None) -> Sighting:
        """Find the ball in a picture (height, width, 3), BGR.

        tilt: beta, gamma, rad; used if the picture shows no markers.

        Raises ValueError for a picture of another size than the camera's."""
        why, tilted = self._tilted(image, tilt)
        if tilted is None:
            return Sighting(None, None, 0.0, why)
        used, (beta, gamma) = tilted
        why, fit = self._look(image, *used)
        if fit is None:
            return Sighting(None, None, 0.0, why, beta, gamma)
        return Sighting(fit.x, fit.y, fit.confidence, why, beta, gamma, fit.error)

    def _tilted(
        self, image: np.ndarray, tilt: tuple[float, float] | None
    ) -> tuple[DetectionOutcome, tuple[tuple[float, float], tuple[float | None, float | None]] | None]:
        """(reason, (tilt to use, tilt by the markers)). The tilt by the markers is (None, None) without markers.

        If there is no tilt to use, (reason, None)."""
        if image.shape != (self.camera.size[1], self.camera.size[0], 3):
            raise ValueError(f"got a picture of shape {image.shape}, expected {self.camera.size[::-1]} and 3 colours")
        by_markers = None if self._tilt is None else self._tilt.tilt(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        if by_markers is not None and by_markers[2] > self.settings.moved_px:
            return DetectionOutcome.MOVED, None
        used = tilt if by_markers is None else by_markers[:2]
        if used is None:
            dark = float(np.median(image[::8, ::8])) < 12.0
            return (DetectionOutcome.DARK if dark else DetectionOutcome.NO_MARKERS), None
        return DetectionOutcome.FOUND, (used, (None, None) if by_markers is None else by_markers[:2])

    def _fits(self, image: np.ndarray, beta: float, gamma: float) -> tuple[DetectionOutcome, list[OutlineFit]]:
        """Fitted outlines of spheres at places where a ball has room, and a reason in case none of them is good."""
        settings, eye = self.settings, self.camera.centre(beta, gamma)
        seen = self.floor.straighten(image, self.camera, beta, gamma)
        clear = cv2.bitwise_and(self.floor.visible(eye), self.background.known)
        empty, light = _relit(self.background.picture, seen, clear)
        if light < settings.darkest:
            return DetectionOutcome.DARK, []
        differs = self._differs(seen, empty, clear)
        fits = []
        least = settings.edge * self._light * light
        for x, y in self._candidates(differs, clear, eye):
            fit = self._outline.fit(seen, empty, clear, eye, np.array([x, y]))
            if fit is not None and fit.strength >= least and self._possible(fit):
                fits.append(fit)
        return DetectionOutcome.NO_BALL, fits

    def _look(self, image: np.ndarray, beta: float, gamma: float) -> tuple[DetectionOutcome, OutlineFit | None]:
        why, fits = self._fits(image, beta, gamma)
        if why is DetectionOutcome.DARK:
            return why, None
        good = [fit for fit in fits if self._good(fit)]
        if not good:
            return (DetectionOutcome.UNSURE if fits else DetectionOutcome.NO_BALL), None
        best = max(good, key=lambda fit: fit.strength * fit.confidence)
        rivals = [fit for fit in fits if self._rivals(fit, best)]
        if rivals:
            return (DetectionOutcome.TWO if any(self._good(fit) for fit in rivals) else DetectionOutcome.UNSURE), None
        return DetectionOutcome.FOUND, best

    def _rivals(self, fit: OutlineFit, best: OutlineFit) -> bool:
        """Whether a fit may be a second ball: at another place, and nearly as clear. A shadow has a soft edge."""
        apart = np.hypot(fit.x - best.x, fit.y - best.y)
        return bool(
            apart > self.maze.ball.radius
            and fit.strength * fit.agree > self.settings.rival * best.strength * best.agree
        )

    def _differs(self, seen: np.ndarray, empty: np.ndarray, clear: np.ndarray) -> np.ndarray:
        """Difference between the floor and the empty floor, 0 to 255; 0 where it is within the noise.

        For a coloured ball: 255 where the floor has the ball's colour, else 0."""
        if self.settings.hue_deg is not None:
            low, high = (round(value / 2.0) for value in self.settings.hue_deg)
            hsv = cv2.cvtColor(seen, cv2.COLOR_BGR2HSV)
            own = cv2.inRange(hsv, (min(low, high), self.settings.saturation, 30), (max(low, high), 255, 255))
            if low > high:  # red: past 360
                own = cv2.bitwise_or(
                    cv2.inRange(hsv, (low, self.settings.saturation, 30), (180, 255, 255)),
                    cv2.inRange(hsv, (0, self.settings.saturation, 30), (high, 255, 255)),
                )
            return cv2.bitwise_and(own, clear)
        blue, green, red = cv2.split(cv2.absdiff(seen, empty))
        most = cv2.max(cv2.max(blue, green), red)
        sample = most[2::5, 2::5][clear[2::5, 2::5] > 0]
        noise = 1.5 * float(np.median(sample)) if sample.size else 0.0
        least = max(self.settings.contrast, 3.0 * noise)
        most = cv2.threshold(most, least, 0, cv2.THRESH_TOZERO)[1]
        return cv2.bitwise_and(most, clear)

    def _candidates(self, differs: np.ndarray, clear: np.ndarray, eye: Array) -> list[tuple[float, float]]:
        """Places (x, y), m, where the ball's centre may be, best first.

        The score of a place is the difference inside a disc minus the difference in a ring around it."""
        settings, ball, floor = self.settings, self.maze.ball.radius, self.floor
        small = cv2.resize(differs, None, fx=1 / HALF, fy=1 / HALF, interpolation=cv2.INTER_AREA).astype(np.float32)
        score = cv2.filter2D(small, cv2.CV_32F, (self._disc - self._ring) / 255.0, borderType=cv2.BORDER_CONSTANT)
        # allowed centres, projected to the floor behind them
        k, foot = ball / eye[2], (floor.pixels(eye[None, :2])[0] + 0.5) / HALF - 0.5
        warp = np.array([[1.0 - k, 0.0, k * foot[0]], [0.0, 1.0 - k, k * foot[1]]])
        allowed = cv2.warpAffine(self._allowed, warp, score.shape[::-1], flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)
        found, first = [], 0.0
        for _ in range(settings.candidates):
            _, best, _, at = cv2.minMaxLoc(score, allowed)
            if best < max(settings.filled * self._disc.sum(), settings.rival_score * first):
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
        return bool(inside and self._room[row, column] >= self.maze.ball.radius - self.settings.tolerance_m)

    def _good(self, fit: OutlineFit) -> bool:
        settings = self.settings
        return (
            fit.clear * fit.agree >= settings.clear
            and fit.agree >= settings.agree
            and fit.error <= settings.error_m
            and abs(fit.wider) <= settings.wider_m
        )


def _kernels(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """A disc, and a ring around it with weight 0.7."""
    reach = int(1.6 * radius) + 1
    rho = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1])
    disc = np.clip(radius - rho + 0.5, 0.0, 1.0)
    return disc.astype(np.float32), (0.7 * np.clip(1.5 * radius - rho + 0.5, 0.0, 1.0) * (1.0 - disc)).astype(
        np.float32
    )


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
    small = (picture.shape[1] // SLOW, picture.shape[0] // SLOW)
    share = cv2.resize(clear, small, interpolation=cv2.INTER_AREA)
    off = cv2.subtract(
        cv2.resize(cv2.cvtColor(seen, cv2.COLOR_BGR2GRAY), small, interpolation=cv2.INTER_AREA),
        cv2.resize(cv2.cvtColor(empty, cv2.COLOR_BGR2GRAY), small, interpolation=cv2.INTER_AREA),
        dtype=cv2.CV_16S,
    )
    off = np.clip(off + 128, 0, 255).astype(np.uint8)
    off[share < 250] = 128
    off = cv2.GaussianBlur(cv2.medianBlur(off, 11), (0, 0), 2.0)
    over = cv2.resize(off, picture.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    over = cv2.cvtColor(over, cv2.COLOR_GRAY2BGR)
    return cv2.addWeighted(empty, 1.0, over, 1.0, -128.0), float(gain.mean())
