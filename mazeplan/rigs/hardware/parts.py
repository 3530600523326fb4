"""Opens board, camera and detector of a rig on the table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mazeplan.core.errors import RigError
from mazeplan.core.resources import to_install
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.hardware.clocks import TiltTrack
from mazeplan.rigs.hardware.settings import HardwareSettings
from mazeplan.rigs.link.board import Board
from mazeplan.rigs.link.messages import AxisLimits, ServoLimits
from mazeplan.rigs.link.port import ports_found

if TYPE_CHECKING:  # OpenCV is not needed to talk to the board
    from mazeplan.rigs.camera.detector import BallDetector
    from mazeplan.rigs.camera.source import FrameSource, NewestPicture

AUTO = "auto"


@dataclass
class Parts:
    """Open parts of a rig.

    port, camera: names for messages."""

    board: Board
    pictures: NewestPicture
    detector: BallDetector
    track: TiltTrack
    port: str
    camera: str

    def listen(self) -> None:
        """Take the board's new reports into the track of the tilt. Raises RigError if the board is lost."""
        self.track.take(self.board.recent())

    def close(self) -> None:
        """Level the plate, and close everything."""
        try:
            self.board.close()
        finally:
            self.pictures.close()


def servo_limits(settings: HardwareSettings) -> ServoLimits:
    """The limits of the pulses that go to the board."""
    servo = settings.servo
    beta, gamma = (
        AxisLimits(axis.min_us, axis.max_us, axis.level_us, servo.slew_us_per_s) for axis in (servo.beta, servo.gamma)
    )
    return ServoLimits(beta, gamma)


def the_port(name: str) -> str:
    """The port of that name. For `auto` it is the only serial port behind USB.

    Raises RigError if `auto` finds no port, or more than one."""
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
    """Open the board. Raises RigError if that fails.

    port: by default the port in the settings."""
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
    """Open camera and board. Raises RigError or SettingsError.

    folder: folder of the rig's file.
    make: opens the camera.
    camera: name of the camera, for messages.
    board: returns an open board, which stays open if the rest fails."""
    from mazeplan.rigs.camera.section import camera_section
    from mazeplan.rigs.camera.source import NewestPicture

    assert settings.tilt is not None
    detector = camera_section(settings.camera or {}).detector(maze, folder)  # before anything is opened
    opened = board()
    return Parts(opened, NewestPicture(make, camera), detector, TiltTrack(settings.tilt.sensor()), opened.port, camera)
