"""The section `camera:` of a rig's YAML file: the source of pictures, and the result of the calibration."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
from pydantic import BeforeValidator, Field, ValidationError

from mazeplan.core.errors import SettingsError
from mazeplan.core.whole_file import whole_file
from mazeplan.maze.geometry import Maze
from mazeplan.maze.sections import MISSING, Section, as_tuples, problems
from mazeplan.maze.yamltree import key_path, shown
from mazeplan.rigs.camera.detector import Background, BallDetector, DetectorSettings
from mazeplan.rigs.camera.floor import floor_side
from mazeplan.rigs.camera.markers import SIZE, Markers
from mazeplan.rigs.camera.pinhole import CameraModel, rotation
from mazeplan.rigs.files import placed, validated

Positive = Annotated[float, Field(gt=0.0)]
Hue = Annotated[float, Field(ge=0.0, le=360.0)]
Pair = tuple[float, float]
Triple = tuple[float, float, float]


def _device(source: Any) -> int | str:
    if isinstance(source, bool) or not isinstance(source, int | str):
        raise ValueError(f"got {shown(source)}, expected the number of a device, a URL or a file")
    return source


Device = Annotated[int | str, BeforeValidator(_device)]


class MarkerSection(Section):
    """Markers on the plate. The upper edge of each marker is towards +y.

    size_mm: side of a marker.
    at_mm: for each marker its id, and x, y, z of its middle."""

    size_mm: Positive = 1000.0 * SIZE
    at_mm: tuple[tuple[int, float, float, float], ...]

    def markers(self) -> Markers:
        """The markers with lengths in m."""
        return Markers({n: (x / 1000, y / 1000, z / 1000) for n, x, y, z in self.at_mm}, self.size_mm / 1000)


class CameraSection(Section):
    """A calibrated camera.

    source: number of a device, URL or video file.
    size: width and height of a picture, px.
    focal_px, centre_px: focal lengths and centre of the picture, x and y.
    distortion: k1, k2, p1, p2, k3 of the lens.
    turn_rad, shift_mm: rotation vector and translation from the level plate frame to the camera frame.
    pivot_mm: fixed point of the plate's tilt, in the plate frame.
    markers: markers on the plate, if any.
    ball_hue_deg: range of hues of a coloured ball, from and to.
    background: file with the picture of the empty floor, relative to the rig's file.
    error_px, error_mm: remaining error of the calibration."""

    source: Device = 0
    size: tuple[int, int] = (640, 480)
    focal_px: tuple[Positive, Positive]
    centre_px: Pair
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    turn_rad: Triple
    shift_mm: Triple
    pivot_mm: Triple = (0.0, 0.0, 0.0)
    markers: MarkerSection | None = None
    ball_hue_deg: tuple[Hue, Hue] | None = None
    background: str | None = None
    date: str | None = None
    error_px: float | None = None
    error_mm: float | None = None

    def model(self) -> CameraModel:
        """The camera, in m and rad."""
        (fx, fy), (cx, cy) = self.focal_px, self.centre_px
        return CameraModel(
            np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]),
            np.array(self.distortion),
            rotation(self.turn_rad),
            np.array(self.shift_mm) / 1000.0,
            self.size,
            np.array(self.pivot_mm) / 1000.0,
        )

    def detector(self, maze: Maze, folder: Path) -> BallDetector:
        """The detector of the ball. Raises SettingsError without a background.

        folder: folder of the rig's file."""
        key = "camera.background"
        if self.background is None:
            raise SettingsError("is missing; make one with `mazeplan calibrate camera`", key=key)
        try:
            background = load_background(folder / self.background, maze)
        except SettingsError as problem:
            raise SettingsError(f"{problem.file}: {problem.problem}", key=key) from None
        known = None if self.markers is None else self.markers.markers()
        how = DetectorSettings(hue_deg=self.ball_hue_deg)
        return BallDetector(maze, self.model(), background, known, how)


def camera_section(data: Mapping[str, Any], source: Mapping[str, Any] | None = None) -> CameraSection:
    """A validated section. Raises SettingsError with the key.

    source: settings of the whole file; they give the error its file and line."""
    return validated(CameraSection, data, within=("camera",), source=source)


def check_begun(data: Mapping[str, Any], source: Mapping[str, Any]) -> None:
    """Check the keys of a section that is not calibrated yet. Raises SettingsError as `camera_section`."""
    try:
        CameraSection.model_validate(as_tuples(data))
    except ValidationError as problem:
        for key, said in problems(CameraSection, problem):
            if said != MISSING or len(key) > 1:
                raise placed(SettingsError(said, key=key_path(("camera", *key))), source) from None


def marker_section(data: Mapping[str, Any], source: Mapping[str, Any] | None = None) -> MarkerSection:
    """The validated section of the markers alone; the rest of `camera:` may be missing. Raises SettingsError."""
    return validated(MarkerSection, data, within=("camera", "markers"), source=source)


def mapping(camera: CameraModel, markers: Markers | None, **more: Any) -> dict[str, Any]:
    """Content of the section `camera:` for a calibrated camera, without keys that are None.

    more: further keys of CameraSection."""
    m = camera.matrix
    turn = cv2.Rodrigues(camera.rotation)[0].ravel()
    out: dict[str, Any] = {
        "source": more.pop("source", None),
        "size": list(camera.size),
        "focal_px": [round(float(v), 3) for v in (m[0, 0], m[1, 1])],
        "centre_px": [round(float(v), 3) for v in (m[0, 2], m[1, 2])],
        "distortion": [round(float(v), 6) for v in camera.distortion],
        "turn_rad": [round(float(v), 6) for v in turn],
        "shift_mm": [round(1000.0 * float(v), 3) for v in camera.translation],
        "pivot_mm": [round(1000.0 * float(v), 3) for v in camera.pivot],
    }
    if markers is not None:
        at = [[n, *(round(1000.0 * float(v), 3) for v in place)] for n, place in markers.places.items()]
        out["markers"] = {"size_mm": round(1000.0 * markers.size, 3), "at_mm": at}
    out |= more
    return {key: value for key, value in out.items() if value is not None}


def save_background(background: Background, path: Path) -> None:
    """Write a background as a PNG, with `known` as its fourth channel. Raises SettingsError if that fails."""
    picture = np.dstack([background.picture, background.known])
    done, data = cv2.imencode(".png", picture)
    try:
        with whole_file(path) as beside:
            beside.write_bytes(data.tobytes() if done else b"")
    except OSError as problem:
        raise SettingsError(f"cannot be written: {problem.strerror or problem}", file=path) from None


def load_background(path: Path, maze: Maze) -> Background:
    """Read a background that `save_background` wrote. Raises SettingsError if it is no background of this maze."""
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
