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
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from mazeplan.core.errors import MazeplanError, RigError, SettingsError
from mazeplan.core.records import Latency, Observation
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.camera.detector import Sighting
from mazeplan.rigs.camera.section import camera_section, check_begun
from mazeplan.rigs.camera.source import FrameSource, VideoSource
from mazeplan.rigs.files import placed, validated
from mazeplan.rigs.hardware.clocks import SILENT_S, FrameClock
from mazeplan.rigs.hardware.parts import Parts, assemble, open_board
from mazeplan.rigs.hardware.settings import HardwareSettings
from mazeplan.rigs.link.board import Board

TOLERANCE = 1e-9  # rad by which a command may exceed the tilt limit
LATE = 0.5  # periods; a picture that is later counts as missing
BLIND_S = 2.0  # s without any picture, after which the camera counts as failed
START_S = 10.0  # s, longest wait for the first picture
LEVEL_DEG = 0.7  # largest tilt of a plate that counts as level
REST_MM = 2.0  # a ball rests if it stays within this distance ...
REST_S = 0.5  # ... for this time, s
PLACED_MM = 12.0  # distance beside a ring at which a ball still counts as in it


class NotSeen(RigError):  # noqa: N818
    """The camera works, but does not show the ball or the markers."""


class HardwareRig:
    """See `interface.Rig`.

    settings: the keys of hardware.yaml.
    latency: measured delays, or None.
    unseen_s: a run ends after so long without a sight of the ball, s.
    settings_kind: validates the settings; a subclass with keys of its own replaces it."""

    realtime = True
    settings_kind: type[HardwareSettings] = HardwareSettings

    def __init__(self, maze: Maze, settings: Mapping[str, Any]) -> None:
        self.maze = maze
        file: Path | None = getattr(settings, "file", None)
        self.file, self.folder = file, Path() if file is None else file.parent
        self._given = settings
        self.settings = validated(self.settings_kind, settings)
        camera = self.settings.camera or {}
        if self.settings.calibrated_camera:
            camera_section(camera, settings)
        else:
            check_begun(camera, settings)
        self.rate_hz = self.settings.rate_hz
        self.latency: Latency | None = None if self.settings.latency is None else self.settings.latency.record()
        self.unseen_s = self.settings.unseen_s
        self._parts: Parts | None = None
        self._board: Board | None = None  # the board may be open while the other parts are not
        self._clock = FrameClock(self.rate_hz)
        self._numbered = False
        self._arrived = -math.inf  # when the last picture arrived, host's clock, s
        self._next, self._first = 0, 0  # number of the next picture; number of the picture at time 0
        self._stopped = False
        self._closed = False  # a reset that goes on in another thread after `close` must open nothing again
        self.sighting: Sighting | None = None  # result of the detector for the last sample; None: no picture came
        self.due = 0.0  # when the last sample was due, host's clock, s

    def _open_board(self) -> Board:
        return open_board(self.settings)

    def _open_camera(self) -> FrameSource:
        return VideoSource(self.settings.source, self.settings.picture)

    @property
    def _camera_name(self) -> str:
        return str(self.settings.source)

    # -- life -------------------------------------------------------------------------------------------------------

    def ready(self) -> None:
        """Raises SettingsError if limits or calibrations are missing. Opens nothing."""
        self._limited()
        missing = self.settings.missing()
        if missing:
            advice = f"not calibrated yet: first {' and '.join(missing)} (docs/hardware.md)"
            raise SettingsError(advice, file=self.file)

    def _limited(self) -> None:
        try:
            self.settings.check_limits()
        except SettingsError as problem:
            raise placed(problem, self._given) from None

    @property
    def board(self) -> Board:
        """The board, opened on first use. Needs no calibration.

        Raises RigError if the board does not answer, or after `close`; SettingsError for missing limits."""
        self._check_open()
        if self._board is None:
            self._limited()
            self._board = self._open_board()
        return self._board

    @property
    def parts(self) -> Parts:
        """Board, camera and detector, opened on first use.

        Raises RigError if a part cannot be opened, or after `close`; SettingsError for missing limits or calibrations.
        """
        self._check_open()
        if self._parts is None:
            self.ready()
            try:
                self._parts = assemble(
                    self.settings, self.maze, self.folder, self._open_camera, self._camera_name, lambda: self.board
                )
            except SettingsError as problem:
                raise placed(problem, self._given) from None
            self._numbered, self._arrived = False, -math.inf
        return self._parts

    def _check_open(self) -> None:
        if self._closed:
            raise RigError("the rig is closed; the next reset opens it again")

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
        """Ask a person to place the ball."""
        where = f"ring {ring}, near {math.degrees(theta) % 360.0:.0f} degrees"
        print(f"place the ball in {where}; waiting until it rests", file=sys.stderr, flush=True)

    def _await_ball(self, ring: int) -> None:
        """Wait until a ball rests in the ring."""
        channel, until = self.maze.ring(ring), monotonic() + self.settings.place_s
        rested: list[tuple[float, float, float]] = []
        due, found, without = 0, 0, Counter[str]()
        while monotonic() < until:
            seen = self.observe()
            due, found = due + 1, found + seen.seen
            if not seen.seen:
                without["did not come" if self.sighting is None else str(self.sighting.why)] += 1
            at_rest = seen.seen and max(abs(seen.beta), abs(seen.gamma)) < math.radians(LEVEL_DEG)
            if at_rest and seen.x is not None and seen.y is not None:
                r = math.hypot(seen.x, seen.y)
                inside = channel.inner_radius - 1e-3 * PLACED_MM < r < channel.outer_radius + 1e-3 * PLACED_MM
                near = not rested or math.hypot(seen.x - rested[0][1], seen.y - rested[0][2]) < 1e-3 * REST_MM
                rested = [*rested, (seen.t, seen.x, seen.y)] if inside and near else []
                if rested and seen.t - rested[0][0] >= REST_S:
                    return
            elif not seen.seen:
                rested = []
        why = "".join(f", {number} {word}" for word, number in without.most_common(2))
        raise NotSeen(
            f"no ball rested in ring {ring} within {self.settings.place_s:g} s: of {due} pictures {found} showed one"
            f"{why}; is it lit, and in the picture, and does this machine keep up?"
        )

    def cause(self, problem: MazeplanError) -> MazeplanError:
        """The error that caused `problem`; here `problem` itself."""
        return problem

    def close(self) -> None:
        """Level the plate, and release port and camera until the next reset. A second call does nothing."""
        self._closed = True
        parts, self._parts = self._parts, None
        board, self._board = self._board, None
        if parts is not None:
            parts.close()
        elif board is not None:
            board.close()

    # -- the loop ---------------------------------------------------------------------------------------------------

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
        parts.listen()
        sighting = None if image is None else self._look(parts, image, due)
        parts.listen()  # reports may have come since; the newer ones are nearer to the time of the picture
        newest, tilt = parts.track.newest, parts.track.at(due)
        if tilt is None or newest is None or monotonic() - newest > SILENT_S:
            raise RigError(f"{parts.port}: no report of the tilt for {SILENT_S:g} s; is its cable in?")
        x, y = (None, None) if sighting is None or sighting.x is None else (sighting.x, sighting.y)
        self.sighting, self.due = sighting, due
        return Observation((number - self._first) / self.rate_hz, x, y, *tilt)

    def _look(self, parts: Parts, image: np.ndarray, due: float) -> Sighting:
        """Find the ball. Raises RigError for a picture of another size than the calibrated one."""
        try:
            return parts.detector.locate(image, parts.track.at(due))
        except ValueError as problem:
            advice = "is it the camera that was calibrated? if so, calibrate it anew"
            raise RigError(f"camera {parts.camera}: {problem}; {advice}") from problem

    def _picture(self, parts: Parts) -> tuple[int, np.ndarray | None]:
        """Number and image of the next sample; None for a missing picture."""
        clock = self._clock
        if not self._numbered:
            frame = parts.pictures.wait(self._arrived, monotonic() + START_S)
            if frame is None:
                raise RigError(f"camera {parts.camera}: no picture within {START_S:g} s")
            clock.start(frame.t)
            self._numbered, self._arrived, self._next = True, frame.t, 1
            return 0, frame.image
        number = self._next
        while True:
            frame = parts.pictures.wait(self._arrived, clock.due(number) + LATE / self.rate_hz)
            if frame is None:
                if monotonic() - self._arrived > BLIND_S:
                    raise RigError(f"camera {parts.camera}: no picture for {BLIND_S:g} s; is its cable in?")
                self._next = number + 1
                return number, None
            self._arrived = frame.t
            got = clock.take(frame.t)
            if got >= number:  # greater: this program was late and missed pictures
                self._next = got + 1
                return got, frame.image

    def command(self, u_beta: float, u_gamma: float) -> None:
        """Hold this tilt from now on. Raises RigError for NaN or a tilt beyond the limit, and if the board is lost."""
        limit = self.maze.tilt_limit + TOLERANCE
        for name, value in (("u_beta", u_beta), ("u_gamma", u_gamma)):
            if not -limit <= value <= limit:  # also refuses NaN
                raise RigError(f"{name}: got {value} rad, expected at most {self.maze.tilt_limit:.4f} rad either way")
        parts, servo = self.parts, self.settings.servo
        if self._stopped:
            parts.board.level()
            return
        parts.board.command(servo.beta.pulse(u_beta), servo.gamma.pulse(u_gamma))

    def level(self) -> None:
        """Level the plate now."""
        board = self._board if self._parts is None else self._parts.board
        if board is not None:
            board.level()

    def stop(self) -> None:
        """Emergency stop: level the plate until the next reset, and ignore commands. Any thread may call."""
        self._stopped = True
        self.level()
