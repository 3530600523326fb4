"""The section `camera:` of a rig's YAML file: the source of pictures, and the result of the calibration.

OpenCV is imported only where pictures are needed: a rig's file can be read without it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from mazeplan.core.errors import SettingsError
from mazeplan.maze.geometry import Maze
from mazeplan.maze.sections import Section
from mazeplan.maze.yamltree import shown

if TYPE_CHECKING:
    from mazeplan.rigs.camera.detector import BallDetector
    from mazeplan.rigs.camera.markers import Markers
    from mazeplan.rigs.camera.pinhole import CameraModel

CALIBRATED = ("focal_px", "centre_px", "turn_rad", "shift_mm")  # keys that a calibrated camera has
Positive = Annotated[float, Field(gt=0.0)]
Triple = tuple[float, float, float]


def _device(source: Any) -> int | str:
    if isinstance(source, bool) or not isinstance(source, int | str):
        raise ValueError(f"got {shown(source)}, expected the number of a device, a URL or a file")
    return source


class MarkerSection(Section):
    """Markers on the plate. The upper edge of each marker is towards +y."""

    size_mm: Positive = 24.0  # side of a marker
    at_mm: tuple[tuple[int, float, float, float], ...]  # for each marker its id, and x, y, z of its middle

    def markers(self) -> Markers:
        """The markers with lengths in m."""
        from mazeplan.rigs.camera.markers import Markers

        return Markers({n: (x / 1000, y / 1000, z / 1000) for n, x, y, z in self.at_mm}, self.size_mm / 1000)


class CameraSection(Section):
    """A camera, calibrated or not. The calibration gives all keys except source, size and pivot_mm."""

    source: Annotated[int | str, BeforeValidator(_device)] = 0  # number of a device, URL or video file
    size: tuple[int, int] = (640, 480)  # width and height of a picture, px
    focal_px: tuple[Positive, Positive] | None = None
    centre_px: tuple[float, float] | None = None
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)  # k1, k2, p1, p2, k3 of the lens
    turn_rad: Triple | None = None  # rotation vector, with shift_mm: from the level plate frame to the camera frame
    shift_mm: Triple | None = None
    pivot_mm: Triple = (0.0, 0.0, 0.0)  # fixed point of the plate's tilt, in the plate frame
    markers: MarkerSection | None = None
    background: str | None = None  # file with the picture of the empty floor, relative to the rig's file
    date: str | None = None
    error_px: float | None = None  # remaining error
    error_mm: float | None = None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        missing = [key for key in CALIBRATED if getattr(self, key) is None]
        if 0 < len(missing) < len(CALIBRATED):
            raise ValueError(f"{', '.join(missing)}: missing, expected {', '.join(CALIBRATED)} together")
        return self

    @property
    def calibrated(self) -> bool:
        """Whether the section has a calibration."""
        return self.focal_px is not None

    def model(self) -> CameraModel:
        """The camera, in m and rad. Raises SettingsError if it is not calibrated."""
        from mazeplan.rigs.camera.pinhole import CameraModel, rotation

        focal, centre, turn, shift = self.focal_px, self.centre_px, self.turn_rad, self.shift_mm
        if focal is None or centre is None or turn is None or shift is None:
            raise SettingsError("is not calibrated: first mazeplan calibrate camera", key="camera")
        matrix = np.array([[focal[0], 0.0, centre[0]], [0.0, focal[1], centre[1]], [0.0, 0.0, 1.0]])
        distortion, shift, pivot = np.array(self.distortion), np.array(shift) / 1000.0, np.array(self.pivot_mm) / 1000.0
        return CameraModel(matrix, distortion, rotation(turn), shift, self.size, pivot)

    def detector(self, maze: Maze, folder: Path) -> BallDetector:
        """The detector of the ball. folder: of the rig's file. Raises SettingsError without a background."""
        from mazeplan.rigs.camera.detector import Background, BallDetector

        if self.background is None:
            raise SettingsError("is missing; make one with `mazeplan calibrate camera`", key="camera.background")
        background = Background.read(folder / self.background, maze)
        return BallDetector(maze, self.model(), background, None if self.markers is None else self.markers.markers())


def mapping(camera: CameraModel, markers: Markers | None, **more: Any) -> dict[str, Any]:
    """Content of the section `camera:` for a calibrated camera. more: further keys of CameraSection."""
    import cv2

    m = camera.matrix
    out: dict[str, Any] = {
        "size": list(camera.size),
        "focal_px": [round(float(v), 3) for v in (m[0, 0], m[1, 1])],
        "centre_px": [round(float(v), 3) for v in (m[0, 2], m[1, 2])],
        "distortion": [round(float(v), 6) for v in camera.distortion],
        "turn_rad": [round(float(v), 6) for v in cv2.Rodrigues(camera.rotation)[0].ravel()],
        "shift_mm": [round(1000.0 * float(v), 3) for v in camera.translation],
        "pivot_mm": [round(1000.0 * float(v), 3) for v in camera.pivot],
    }
    if markers is not None:
        at = [[n, *(round(1000.0 * float(v), 3) for v in place)] for n, place in markers.places.items()]
        out["markers"] = {"size_mm": round(1000.0 * markers.size, 3), "at_mm": at}
    return out | more
