"""The part `camera:` of a rig's YAML file: what a calibration found, and where pictures come from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
from pydantic import Field, ValidationError

from mazeplan.errors import SettingsError
from mazeplan.maze.geometry import Maze
from mazeplan.maze.yamltree import Key, Tree, key_path, shown
from mazeplan.rigs.camera.detector import Background, BallDetector, DetectorSettings
from mazeplan.rigs.camera.markers import SIZE, Markers
from mazeplan.rigs.camera.pinhole import CameraModel, rotation
from mazeplan.rigs.settings import Section, as_tuples, sentence

Positive = Annotated[float, Field(gt=0.0)]
Hue = Annotated[float, Field(ge=0.0, le=360.0)]
Pair = tuple[float, float]
Triple = tuple[float, float, float]


class MarkerSection(Section):
    """Where markers are on the plate: id, x, y, z of the middle of each, their upper edge towards +y."""

    size_mm: Positive = 1000.0 * SIZE
    at_mm: tuple[tuple[int, float, float, float], ...]

    def markers(self) -> Markers:
        """The same in m."""
        return Markers({n: (x / 1000, y / 1000, z / 1000) for n, x, y, z in self.at_mm}, self.size_mm / 1000)


class CameraSection(Section):
    """All that is known of a camera. source: number of a device, URL or video file; turn_rad, shift_mm: rotation vector
    and translation from the level plate to the camera; pivot_mm: about which the plate tilts, in its own frame;
    ball_hue_deg: from, to, where the ball has a colour; background: picture of the empty floor, beside the rig's file;
    error_px, error_mm: what was left in the calibration."""

    source: int | str = 0
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
        """What finds the ball; `folder` is where the rig's file is. Raises SettingsError without its background."""
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


def camera_section(
    data: Mapping[str, Any], *, file: str | Path | None = None, tree: Tree | None = None
) -> CameraSection:
    """A validated section. Raises SettingsError with file, line and key."""
    return _checked(CameraSection, ("camera",), data, file, tree)


def check_begun(data: Mapping[str, Any], *, file: str | Path | None = None, tree: Tree | None = None) -> None:
    """What a section says that is not calibrated yet. Raises SettingsError as `camera_section`."""
    _checked(CameraSection, ("camera",), data, file, tree, begun=True)


def marker_section(
    data: Mapping[str, Any], *, file: str | Path | None = None, tree: Tree | None = None
) -> MarkerSection:
    """What the section says of markers, where the rest of it is not known yet. Raises SettingsError."""
    return _checked(MarkerSection, ("camera", "markers"), data, file, tree)


def _checked(
    kind: type[Any], place: Key, data: Any, file: str | Path | None, tree: Tree | None, begun: bool = False
) -> Any:
    """begun: what is missing is no mistake."""
    try:
        return kind.model_validate(as_tuples(data))
    except ValidationError as problem:
        wrong = [e for e in problem.errors() if not (begun and e["type"] == "missing" and len(e["loc"]) == 1)]
        if not wrong:
            return None
        first = wrong[0]
        key: Key = (*place, *first["loc"])
        said = sentence(first)
        if key[1:2] == ("source",):  # pydantic tells of each kind that it could be
            key, said = key[:2], f"got {shown(first.get('input'))}, expected the number of a device, a URL or a file"
        elif first["type"] == "extra_forbidden":
            known = MarkerSection if "markers" in key[:-1] else CameraSection
            said = f"unknown key, expected one of {', '.join(known.model_fields)}"
        elif first["type"] == "missing":
            said = "missing; `mazeplan calibrate camera` writes it"
        raise SettingsError(said, file=file, line=None if tree is None else tree.line(key), key=key_path(key)) from None


def mapping(camera: CameraModel, markers: Markers | None, **more: Any) -> dict[str, Any]:
    """What goes under `camera:`; more: keys of CameraSection besides, None left out."""
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
    """As a PNG whose fourth channel says what was seen. Raises SettingsError where it cannot be written."""
    picture = np.dstack([background.picture, background.known])
    done, data = cv2.imencode(".png", picture)
    try:
        path.write_bytes(data.tobytes() if done else b"")
    except OSError as problem:
        raise SettingsError(f"cannot be written: {problem.strerror or problem}", file=path) from None


def load_background(path: Path, maze: Maze) -> Background:
    """Read one. Raises SettingsError for what is none for this maze."""
    from mazeplan.rigs.camera.floor import floor_side

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
