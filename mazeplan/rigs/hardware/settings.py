"""The file of a rig on a table: its settings, which hardware.yaml explains, and how calibrations write their sections.

OpenCV is imported only where pictures are needed: a rig's file can be read without it.

Writing replaces sections and keeps the comments. The file to write is the user's file, or a copy of a packaged file in
the current folder. In a section, new values replace old ones. New keys come last, and keys that the new section lacks
are removed. Spacing may change.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from mazeplan.core.errors import SettingsError
from mazeplan.core.whole_file import write_text
from mazeplan.maze.geometry import Maze
from mazeplan.maze.sections import Section
from mazeplan.maze.yamltree import parse_yaml, shown
from mazeplan.rigs.files import placed, read_rig_file, validated
from mazeplan.rigs.link.protocol import HARD_SLEW, HARD_US, AxisLimits, ServoLimits
from mazeplan.rigs.registry import PACKAGED, rig_class, rig_file

if TYPE_CHECKING:
    from mazeplan.rigs.camera.detector import BallDetector
    from mazeplan.rigs.camera.pinhole import CameraModel, Markers

CLASS = "mazeplan.rigs.hardware:HardwareRig"
LINE_WIDTH = 120  # characters of a line that is written
CALIBRATED = ("focal_px", "centre_px", "turn_rad", "shift_mm")  # keys that a calibrated camera has
SLOWEST = 100.0  # us/s, smallest slew rate
POWERS = {  # of a and b in each term of the tilt sensor's polynomials
    "one": (0, 0), "a": (1, 0), "b": (0, 1), "ab": (1, 1), "aa": (2, 0), "bb": (0, 2),
    "aaa": (3, 0), "aab": (2, 1), "abb": (1, 2), "bbb": (0, 3),
}  # fmt: skip
VALID_RANGE = 1.3  # times the calibrated half range: farther out the polynomial is not valid
Term = Literal["one", "a", "b", "ab", "aa", "bb", "aaa", "aab", "abb", "bbb"]
Terms = Annotated[dict[Term, float], Field(min_length=1)]
Positive = Annotated[float, Field(gt=0.0)]
Triple = tuple[float, float, float]
Pulse = Annotated[float, Field(ge=HARD_US[0], le=HARD_US[1])]  # us; the firmware sends nothing beyond


class TiltSensor(Section):
    """The section `tilt:`: converts the voltages of the tilt sensor's diode to the tilt of the plate.

        beta = sum_k c_k a^i b^j,   a = (v0 - centre0) / scale0,   b = (v1 - centre1) / scale1,   gamma alike

    The plate turns a laser. The laser's spot on the diode moves nearly in proportion to both tilts. Products and powers
    correct for a diode that is turned, not flat, and not linear. `tiltcalibration` finds the coefficients."""

    centre_v: tuple[float, float]  # of the two channels
    scale_v: tuple[Positive, Positive]
    beta_deg: Terms  # coefficients by the name of their term
    gamma_deg: Terms
    error_deg: float = Field(default=0.0, ge=0.0)  # rms of the worse axis at a left-out reading, with the clinometer's
    readings: int = Field(default=0, ge=0)
    date: str = ""

    def tilt(self, v0: float, v1: float) -> tuple[float, float]:
        """beta, gamma, rad, at these voltages. Voltages beyond VALID_RANGE are clamped."""
        pairs = zip((v0, v1), self.centre_v, self.scale_v, strict=True)
        a, b = (min(max((v - c) / s, -VALID_RANGE), VALID_RANGE) for v, c, s in pairs)

        def value(terms: dict[Term, float]) -> float:
            return math.radians(sum(k * a ** POWERS[name][0] * b ** POWERS[name][1] for name, k in terms.items()))

        return value(self.beta_deg), value(self.gamma_deg)

    def reaches(self, v0: float, v1: float) -> bool:
        """Whether the voltages are within VALID_RANGE. If not, the laser's spot has left the diode."""
        pairs = zip((v0, v1), self.centre_v, self.scale_v, strict=True)
        return all(abs(v - c) <= VALID_RANGE * s for v, c, s in pairs)


class ServoAxis(Section):
    """One servo. us_per_deg is negative if a longer pulse tilts the plate in the negative direction."""

    level_us: Pulse = Field(default=1500.0, description="pulse of a level plate")
    us_per_deg: float = Field(default=40.0, ge=-400.0, le=400.0, description="of pulse for a degree of the plate")
    min_us: Pulse = 1200.0
    max_us: Pulse = 1800.0

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.min_us < self.level_us < self.max_us:
            got = f"min_us {self.min_us:g}, level_us {self.level_us:g}, max_us {self.max_us:g}"
            raise ValueError(f"got {got}, expected min_us < level_us < max_us")
        if abs(self.us_per_deg) < 1.0:
            raise ValueError(f"us_per_deg: got {self.us_per_deg:g}, expected at least 1 us per degree, either way")
        return self

    def pulse(self, u: float) -> float:
        """Pulse for a tilt of u rad, us, within the limits."""
        return min(max(self.level_us + self.us_per_deg * math.degrees(u), self.min_us), self.max_us)


class Servo(Section):
    """The section `servo:` of the file."""

    beta: ServoAxis = ServoAxis()
    gamma: ServoAxis = ServoAxis()
    slew_us_per_s: float = Field(default=6000.0, ge=SLOWEST, le=HARD_SLEW, description="fastest change of the pulses")

    def limits(self) -> ServoLimits:
        """The limits of the pulses that go to the board."""
        beta, gamma = (AxisLimits(a.min_us, a.max_us, a.level_us, self.slew_us_per_s) for a in (self.beta, self.gamma))
        return beta, gamma


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
        from mazeplan.rigs.camera.pinhole import Markers

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


class LatencySection(Section):
    """The section `latency:` of the file, with delays that a person knows."""

    command_ms: float = Field(ge=0.0, le=500.0, description="from a command to the first movement of the plate")
    camera_ms: float = Field(ge=0.0, le=500.0, description="age of a picture when its sample is taken")
    host_ms: float = Field(default=0.0, ge=0.0, le=200.0, description="from a sample to the command that answers it")
    date: str = ""


class HardwareSettings(Section):
    """All keys of the file except `class`."""

    model: str | None = Field(default=None, description="model of ball and stage for navigation: a name or folder")
    port: str = Field(default="auto", min_length=1, description="serial port of the board; auto: the only Arduino")
    rate_hz: float = Field(default=30.0, ge=5.0, le=120.0, description="pictures, samples and commands per second")
    servo: Servo = Servo()
    tilt: TiltSensor | None = None
    camera: CameraSection = CameraSection()
    latency: LatencySection | None = None
    unseen_s: float = Field(default=2.0, ge=0.2, le=60.0, description="a run ends after so long without the ball")
    place_s: float = Field(default=120.0, ge=1.0, le=3600.0, description="time to place the ball")

    def check_limits(self, file: Mapping[str, Any]) -> None:
        """Raises SettingsError if the file has no limits for a servo, because no default fits every linkage."""
        for axis in ("beta", "gamma"):
            given = getattr(self.servo, axis).model_fields_set if axis in self.servo.model_fields_set else set()
            for name in ("min_us", "max_us"):
                if name not in given:
                    why = "is missing: no servo moves without limits, beyond which nothing is sent (docs/hardware.md)"
                    raise placed(SettingsError(why, key=f"servo.{axis}.{name}"), file)


@dataclass(frozen=True)
class RigFile:
    """A rig's file."""

    path: Path  # file to read
    target: Path  # file to write
    settings: HardwareSettings
    data: Mapping[str, Any]  # sections of the file

    def write(self, sections: Mapping[str, Any]) -> Path:
        """Replace sections of the file, or of a copy of the packaged one, and return the path of the written file.

        For invalid sections, raises SettingsError and writes nothing."""
        try:
            validated(type(self.settings), {**self.data, **sections})
        except SettingsError as problem:
            raise SettingsError(f"not written: {problem.problem}", file=self.target, key=problem.key) from None
        write_sections(self.target, sections, base=self.path)
        return self.target


def is_hardware(spec: str) -> bool:
    """Whether `spec` names a rig on a table, real or emulated. Raises SettingsError for a file that cannot be read."""
    path = rig_file(spec)
    return path is not None and _settings_kind(path) is not None


def hardware_file(spec: str) -> RigFile:
    """The file of the rig on a table that `spec` names. Raises SettingsError with file, line and key."""
    path = rig_file(spec)
    settings_kind = None if path is None else _settings_kind(path)
    if path is None or settings_kind is None:
        raise SettingsError(f"got rig {shown(spec)}, expected one on a table: its file has class: {CLASS}")
    packaged = path.resolve().parent == PACKAGED
    given = read_rig_file(path)[1]
    return RigFile(path, Path(path.name) if packaged else path, validated(settings_kind, given), given)


def _settings_kind(path: Path) -> type[HardwareSettings] | None:
    """What validates the settings of a rig on a table; None for another rig's file."""
    kind, settings = read_rig_file(path)
    if kind is None or ":" not in kind:
        return None
    if kind == CLASS:  # without OpenCV, which the class needs
        return HardwareSettings
    found = getattr(rig_class(kind, {"file": path, "line": settings.tree.line(("class",))}), "settings_kind", None)
    return found if isinstance(found, type) and issubclass(found, HardwareSettings) else None


def write_sections(path: Path, sections: Mapping[str, Any], *, base: Path | None = None) -> None:
    """Replace sections (top-level keys) of a file. Raises InputError if it cannot be read or written.

    base: file whose text a new file starts with."""
    source = path if path.exists() or base is None else base
    text = source.read_text(encoding="utf-8-sig")
    for key, value in sections.items():
        text = merged(text, key, value, file=source)
    parse_yaml(text, file=path, error=SettingsError)
    write_text(path, text)


def merged(text: str, key: str, value: Any, *, file: str | Path) -> str:
    """The text with `key: value` at its top level. Raises SettingsError for text that is no mapping in YAML."""
    from ruamel.yaml import YAML

    if not isinstance(parse_yaml(text, file=file, error=SettingsError).data, dict):
        raise SettingsError(f"cannot be written: {key} needs a file with `key: value` lines", file=file)
    editor, out = YAML(), StringIO()
    editor.preserve_quotes = True
    editor.width = LINE_WIDTH
    data = editor.load(text)
    _put(data, key, value)
    editor.dump(data, out)
    return out.getvalue()


def _put(section: Any, key: str, value: Any) -> None:
    """Set a key of a mapping. Mappings in it are merged, so that their comments stay in their places."""
    old = section.get(key)
    if isinstance(old, Mapping) and isinstance(value, Mapping) and any(name in value for name in old):
        for name in [name for name in old if name not in value]:
            del section[key][name]
        for name, item in value.items():
            _put(old, name, item)
    elif key not in section or old != value:
        section[key] = _node(value)


def _node(value: Any) -> Any:
    """A value for the editor: lists, and mappings without further collections, are written on one line."""
    from ruamel.yaml.comments import CommentedMap, CommentedSeq

    if isinstance(value, Mapping):
        node: Any = CommentedMap({name: _node(item) for name, item in value.items()})
        flat = not any(isinstance(item, Mapping | list | tuple) for item in value.values())
    elif isinstance(value, list | tuple):
        node, flat = CommentedSeq([_node(item) for item in value]), True
    else:
        return value
    if flat:
        node.fa.set_flow_style()
    return node


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
