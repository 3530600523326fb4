"""The rig on the table: camera, board, servos and tilt sensor, with the settings of `hardware.yaml`.

    camera --Frame--> detector -----------------> x, y
    board  --TiltReport--> TiltTrack, at the moment of the picture --> beta, gamma      Observation(number / rate, ...)
    command, rad --ServoAxis--> pulses, us --> board

Each picture makes a sample: `observe` waits for the picture. The time of a sample is the number of its picture over the
rate. A missing picture gives a sample without a ball. Samples are late by `latency`; the estimator corrects this delay.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from mazeplan.core.errors import MazeplanError, RigError, SettingsError
from mazeplan.core.records import Latency, Observation
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.camera.detector import BallDetector, Sighting
from mazeplan.rigs.camera.source import FrameSource, NewestPicture, VideoSource
from mazeplan.rigs.files import placed, validated
from mazeplan.rigs.hardware.clocks import SILENT_S, FrameClock, TiltTrack
from mazeplan.rigs.hardware.settings import HardwareSettings
from mazeplan.rigs.interface import check_command
from mazeplan.rigs.link.board import Board, open_board

MAX_PICTURE_AGE = 0.5  # periods; a picture that is later counts as missing
BLIND_S = 2.0  # s without any picture, after which the camera counts as failed
START_S = 10.0  # s, longest wait for the first picture
LEVEL_DEG = 0.7  # largest tilt of a plate that counts as level
REST_MM = 2.0  # a ball rests if it stays within this distance ...
REST_S = 0.5  # ... for this time, s
PLACED_MM = 12.0  # distance beside a ring at which a ball still counts as in it


class NotSeen(RigError):  # noqa: N818
    """The camera works, but does not show the ball or the markers."""


@dataclass
class Parts:
    """Open parts of a rig."""

    board: Board
    pictures: NewestPicture
    detector: BallDetector
    track: TiltTrack


class HardwareRig:
    """See `interface.Rig`. settings: the keys of hardware.yaml."""

    realtime = True
    settings_kind: type[HardwareSettings] = HardwareSettings  # a subclass with keys of its own replaces it

    def __init__(self, maze: Maze, settings: Mapping[str, Any]) -> None:
        self.maze = maze
        self.file: Path | None = getattr(settings, "file", None)
        self._given = settings
        self.settings = validated(self.settings_kind, settings)
        self.rate_hz = self.settings.rate_hz
        late = self.settings.latency
        self.latency = None if late is None else Latency(1e-3 * late.camera_ms, 1e-3 * (late.command_ms + late.host_ms))
        self.unseen_s = self.settings.unseen_s
        self._parts: Parts | None = None
        self._board: Board | None = None  # the board may be open while the other parts are not
        self._clock = FrameClock(self.rate_hz)
        self._numbered = False
        self._arrived = -math.inf  # when the last picture arrived, host's clock, s
        self._next, self._first = 0, 0  # number of the next picture; number of the picture at time 0
        self._stopped = False
        self._closed = False  # a reset that goes on in another thread after `close` must open nothing again
        self.sighting: Sighting | None = None  # of the last sample; None: no picture came
        self.due = 0.0  # when the last sample was due, host's clock, s

    def _open_board(self) -> Board:
        return open_board(self.settings.port, self.settings.servo.limits())

    def _open_camera(self) -> FrameSource:
        return VideoSource(self.settings.camera.source, self.settings.camera.size)

    @property
    def _camera_name(self) -> str:
        return str(self.settings.camera.source)

    def ready(self) -> None:
        """Raises SettingsError if limits or calibrations are missing. Opens nothing."""
        self.settings.check_limits(self._given)
        known = {"tilt": self.settings.tilt is not None, "camera": self.settings.camera.calibrated}
        missing = [f"mazeplan calibrate {what}" for what, there in known.items() if not there]
        if missing:
            raise SettingsError(f"not calibrated yet: first {' and '.join(missing)} (docs/hardware.md)", file=self.file)

    @property
    def board(self) -> Board:
        """The board, opened on first use, also without calibrations. Raises RigError, or SettingsError for limits."""
        if self._closed:
            raise RigError("the rig is closed; the next reset opens it again")
        if self._board is None:
            self.settings.check_limits(self._given)
            self._board = self._open_board()
        return self._board

    @property
    def parts(self) -> Parts:
        """All parts, opened on first use. Raises RigError, also after `close`; SettingsError as `ready`."""
        if self._parts is None:
            self.ready()
            assert self.settings.tilt is not None
            try:
                detector = self.settings.camera.detector(self.maze, Path() if self.file is None else self.file.parent)
            except SettingsError as problem:
                raise placed(problem, self._given) from None
            board = self.board  # stays open if the camera fails
            pictures = NewestPicture(self._open_camera, self._camera_name)
            self._parts = Parts(board, pictures, detector, TiltTrack(self.settings.tilt))
            self._numbered = False
            self._arrived = -math.inf
        return self._parts

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        """Level the plate, ask a person to place the ball in a ring, and wait until the ball rests.

        Time 0 is the time of the next picture. Raises NotSeen if no ball rests in the ring within `place_s`, RigError
        if the machine fails."""
        self._closed = False
        parts = self.parts
        self._stopped = False
        self.level()
        self._place(ring, theta, rng)
        self._await_ball(ring)
        parts.board.level()
        self._first = self._next

    def _place(self, ring: int, theta: float, rng: np.random.Generator) -> None:
        where = f"ring {ring}, near {math.degrees(theta) % 360.0:.0f} degrees"
        print(f"place the ball in {where}; waiting until it rests", file=sys.stderr, flush=True)

    def _await_ball(self, ring: int) -> None:
        channel, until = self.maze.ring(ring), monotonic() + self.settings.place_s
        rested: list[tuple[float, float, float]] = []
        due, found, without = 0, 0, Counter[str]()
        while monotonic() < until:
            seen = self.observe()
            due, found = due + 1, found + seen.seen
            if seen.x is None or seen.y is None:
                without["did not come" if self.sighting is None else str(self.sighting.why)] += 1
                rested = []
            elif max(abs(seen.beta), abs(seen.gamma)) < math.radians(LEVEL_DEG):
                r = math.hypot(seen.x, seen.y)
                inside = channel.inner_radius - 1e-3 * PLACED_MM < r < channel.outer_radius + 1e-3 * PLACED_MM
                near = not rested or math.hypot(seen.x - rested[0][1], seen.y - rested[0][2]) < 1e-3 * REST_MM
                rested = [*rested, (seen.t, seen.x, seen.y)] if inside and near else []
                if rested and seen.t - rested[0][0] >= REST_S:
                    return
        why = "".join(f", {number} {word}" for word, number in without.most_common(2))
        what = f"no ball rested in ring {ring} within {self.settings.place_s:g} s"
        hint = "is it lit, and in the picture, and does this machine keep up?"
        raise NotSeen(f"{what}: of {due} pictures {found} showed one{why}; {hint}")

    def cause(self, problem: MazeplanError) -> MazeplanError:
        """The error that caused `problem`; here `problem` itself."""
        return problem

    def close(self) -> None:
        """Level the plate, and release port and camera until the next reset. A second call does nothing."""
        self._closed = True
        parts, self._parts = self._parts, None
        board, self._board = self._board, None
        try:
            if board is not None:
                board.close()
        finally:
            if parts is not None:
                parts.pictures.close()

    def observe(self) -> Observation:
        """The next sample. Raises RigError if the camera or the board is lost."""
        try:
            return self._sample()
        except RigError as problem:
            raise self.cause(problem) from None

    def _sample(self) -> Observation:
        parts = self.parts
        number, image = self._picture(parts)
        due = self._clock.due(number)
        parts.track.take(parts.board.recent())
        sighting = None
        if image is not None:
            try:
                sighting = parts.detector.locate(image, parts.track.at(due))
            except ValueError as problem:  # a picture of another size than the calibrated one
                advice = "is it the camera that was calibrated? if so, calibrate it anew"
                raise RigError(f"camera {self._camera_name}: {problem}; {advice}") from problem
        parts.track.take(parts.board.recent())  # newer reports are nearer to the time of the picture
        newest, tilt = parts.track.newest, parts.track.at(due)
        if tilt is None or newest is None or monotonic() - newest > SILENT_S:
            raise RigError(f"{parts.board.port}: no report of the tilt for {SILENT_S:g} s; is its cable in?")
        x, y = (None, None) if sighting is None or sighting.x is None else (sighting.x, sighting.y)
        self.sighting = sighting
        self.due = due
        return Observation((number - self._first) / self.rate_hz, x, y, *tilt)

    def _picture(self, parts: Parts) -> tuple[int, np.ndarray | None]:
        """Number and image of the next sample; None for a missing picture."""
        clock = self._clock
        if not self._numbered:
            frame = parts.pictures.wait(self._arrived, monotonic() + START_S)
            if frame is None:
                raise RigError(f"camera {self._camera_name}: no picture within {START_S:g} s")
            clock.start(frame.t)
            self._numbered = True
            self._arrived = frame.t
            self._next = 1
            return 0, frame.image
        number = self._next
        while True:
            frame = parts.pictures.wait(self._arrived, clock.due(number) + MAX_PICTURE_AGE / self.rate_hz)
            if frame is None:
                if monotonic() - self._arrived > BLIND_S:
                    raise RigError(f"camera {self._camera_name}: no picture for {BLIND_S:g} s; is its cable in?")
                self._next = number + 1
                return number, None
            self._arrived = frame.t
            got = clock.take(frame.t)
            if got >= number:  # greater: this program was late and missed pictures
                self._next = got + 1
                return got, frame.image

    def command(self, u_beta: float, u_gamma: float) -> None:
        """Hold this tilt from now on. Raises RigError for NaN or a tilt beyond the limit, and if the board is lost."""
        check_command(self.maze, u_beta, u_gamma)
        parts, servo = self.parts, self.settings.servo
        if self._stopped:
            parts.board.level()
            return
        parts.board.command(servo.beta.pulse(u_beta), servo.gamma.pulse(u_gamma))

    def level(self) -> None:
        """Level the plate now."""
        if self._board is not None:
            self._board.level()

    def stop(self) -> None:
        """Emergency stop: level the plate until the next reset, and ignore commands. Any thread may call."""
        self._stopped = True
        self.level()
