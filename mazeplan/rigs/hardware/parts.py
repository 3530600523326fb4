"""Opens the parts of a rig on the table, as its settings name them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

from mazeplan.errors import RigError
from mazeplan.maze.geometry import Maze
from mazeplan.resources import to_install
from mazeplan.rigs.hardware.clocks import TiltTrack
from mazeplan.rigs.hardware.settings import HardwareSettings
from mazeplan.rigs.link.board import Board
from mazeplan.rigs.link.messages import AxisLimits, ServoLimits, TiltReport
from mazeplan.rigs.link.port import ports_found

if TYPE_CHECKING:  # OpenCV is not needed to talk to the board
    from mazeplan.rigs.camera.detector import BallDetector
    from mazeplan.rigs.camera.source import FrameSource
    from mazeplan.rigs.hardware.pictures import Pictures

AUTO = "auto"
KEPT = 10_000  # round trips
SUPPLY_V, FULL = 5.0, 1023.0  # V and count at the upper end of the board's converter


@dataclass
class Parts:
    """What is open. trips: s from each command to the report that confirmed it, the newest KEPT."""

    board: Board
    pictures: Pictures
    detector: BallDetector
    track: TiltTrack
    port: str
    camera: str
    trips: deque[float] = field(default_factory=lambda: deque(maxlen=KEPT))
    _sent: deque[tuple[int, float]] = field(default_factory=lambda: deque(maxlen=KEPT))

    def command(self, pulse_beta_us: float, pulse_gamma_us: float) -> None:
        """Have the servos go there. Raises RigError once the board is given up."""
        now = monotonic()
        self._sent.append((self.board.command(pulse_beta_us, pulse_gamma_us), now))

    def listen(self) -> None:
        """Take in what the board has told. Raises RigError once the board is given up."""
        reports = self.board.recent()
        self.track.take(Told.of(report) for report in reports)
        for report in reports:
            while self._sent and report.sequence >= self._sent[0][0]:
                self.trips.append(report.received_s - self._sent.popleft()[1])

    def close(self) -> None:
        """Level the plate, and give all back."""
        try:
            self.board.close()
        finally:
            self.pictures.close()


@dataclass(frozen=True)
class Told:
    """A report with its channels in V."""

    t: float
    volts: tuple[float, float]
    received_s: float

    @classmethod
    def of(cls, report: TiltReport) -> Told:
        """The same, as `TiltTrack` takes it."""
        return cls(report.time_s, volts(report), report.received_s)


def volts(report: TiltReport) -> tuple[float, float]:
    """Of the two channels."""
    first, second = report.counts
    return first * SUPPLY_V / FULL, second * SUPPLY_V / FULL


def servo_limits(settings: HardwareSettings) -> ServoLimits:
    """What the board is told never to exceed."""
    servo = settings.servo
    beta, gamma = (
        AxisLimits(axis.min_us, axis.max_us, axis.level_us, servo.slew_us_per_s) for axis in (servo.beta, servo.gamma)
    )
    return ServoLimits(beta, gamma)


def the_port(name: str) -> str:
    """The port of that name; for auto the only one behind USB. Raises RigError when that is none or several."""
    if name != AUTO:
        return name
    try:
        found = ports_found()
    except ModuleNotFoundError:
        raise RigError(f"port: auto: needs pyserial: {to_install('hardware')}") from None
    if len(found) != 1:
        got = f"found {', '.join(found)}; name the board's as `port:`" if found else "none found; plug the board in"
        raise RigError(f"port: auto: {got}")
    return found[0]


def open_board(settings: HardwareSettings, port: str | None = None) -> Board:
    """The board, open. Raises RigError."""
    board = Board(the_port(settings.port) if port is None else port, servo_limits(settings))
    board.open()
    return board


def assemble(
    settings: HardwareSettings,
    maze: Maze,
    folder: Path,
    make: Callable[[], FrameSource],
    camera: str,
    board: Callable[[], Board],
) -> Parts:
    """Camera and board together. folder: of the rig's file; make: opens the camera; board: gives an open one, which is
    not closed here where the rest fails. Raises RigError or SettingsError."""
    from mazeplan.rigs.camera.section import camera_section
    from mazeplan.rigs.hardware.pictures import Pictures

    assert settings.tilt is not None
    detector = camera_section(settings.camera or {}).detector(maze, folder)  # before anything is opened
    opened = board()
    return Parts(opened, Pictures(make, camera), detector, TiltTrack(settings.tilt.sensor()), opened.port, camera)
