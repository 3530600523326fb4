"""The board that moves the plate, over a serial port.

    board = Board("/dev/ttyACM0", limits)
    board.open()                            # identity, limits, first report
    number = board.command(1510.0, 1490.0)  # us; again at least every 200 ms, or the board levels the plate
    board.wait_newer(board.latest(), 0.1)   # the next TiltReport

A thread reads from the port. If the port is lost, or silent for `Timeouts.silence_s`, the board counts as lost: every
call raises RigError, with the port, and the board levels the plate itself. A board that restarts gets its limits again.
"""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable
from time import monotonic
from typing import TYPE_CHECKING

from mazeplan.core.errors import RigError
from mazeplan.rigs.link import messages
from mazeplan.rigs.link.frames import Frame, FrameReader
from mazeplan.rigs.link.handshake import Timeouts, connect
from mazeplan.rigs.link.messages import BoardClock, Flag, Identity, ServoLimits, TiltReport

if TYPE_CHECKING:
    import serial

LEVEL_TRIES, LEVEL_S = 3, 0.1  # tries of `level`; longest wait for a confirmation, s
REPORTS = 100  # number of newest reports that are kept: those of one second
CLOSE_S = 1.0  # s, longest wait for the end of the reading thread


class Board:
    """The board; see the module's docstring. Several threads may call its methods."""

    def __init__(self, port: str, limits: ServoLimits, timeouts: Timeouts | None = None) -> None:
        """Keeps the arguments, and opens nothing yet."""
        self.port, self.limits, self.timeouts = port, limits, timeouts or Timeouts()
        self.identity: Identity | None = None
        self._serial: serial.Serial | None = None
        self._news = threading.Condition()
        self._writing = threading.Lock()
        self._thread: threading.Thread | None = None
        self._closing = threading.Event()
        self._failure: str | None = None
        self._report: TiltReport | None = None
        self._reports: deque[TiltReport] = deque(maxlen=REPORTS)
        self._sent = 0
        self._clock = BoardClock()
        self._limits_again = 0.0  # earliest time to send the limits again, monotonic clock, s

    def open(self) -> Identity:
        """Connect: check the identity, send the limits, wait for the first report.

        Raises RigError with the port and advice."""
        if self._thread is not None:
            raise RigError(f"{self.port}: is open already")
        self._closing.clear()
        self._failure = None
        until = monotonic() + self.timeouts.answer_s
        self._serial, self.identity = connect(self.port, self.limits, self.timeouts, until, self._closing)
        self._thread = threading.Thread(target=self._work, name=f"board {self.port}", daemon=True)
        self._thread.start()
        if self.wait_newer(None, self.timeouts.silence_s) is None:
            self.close()
            raise RigError(f"{self.port}: the board answers, but sends no reports; unplug it and plug it in again")
        return self.identity

    @property
    def connected(self) -> bool:
        """Whether the port is open and reports come."""
        return self._serial is not None and self._failure is None

    def command(self, pulse_beta_us: float, pulse_gamma_us: float) -> int:
        """Command both pulses, clamped to the limits. Returns the command's number; a report confirms it.

        Raises RigError if the board is lost."""
        beta, gamma = self.limits.beta.clamp(pulse_beta_us), self.limits.gamma.clamp(pulse_gamma_us)
        return self._send(lambda wire: messages.command(wire, beta, gamma))

    def latest(self) -> TiltReport | None:
        """The newest report. Raises RigError if the board is lost."""
        with self._news:
            self._check()
            return self._report

    def recent(self) -> list[TiltReport]:
        """The reports of the last second, newest last. Raises RigError if the board is lost."""
        with self._news:
            self._check()
            return list(self._reports)

    def wait_newer(self, than: TiltReport | None, timeout_s: float) -> TiltReport | None:
        """Wait for a report newer than the report `than`; None after the timeout. Raises RigError as `latest`."""
        with self._news:
            self._news.wait_for(lambda: self._failure or self._report is not than, timeout_s)
            self._check()
            return self._report if self._report is not than else None

    def wait_confirmed(self, number: int, timeout_s: float) -> TiltReport | None:
        """Wait until the board has accepted this command or a later one.

        Returns the report that confirms it, or None after the timeout. Raises RigError as `latest`."""
        with self._news:
            self._news.wait_for(lambda: self._failure or self._confirmed(number), timeout_s)
            self._check()
            return self._report if self._confirmed(number) else None

    def level(self) -> TiltReport:
        """Level the plate now, without the limit of the slew rate. Returns the report that confirms it.

        Raises RigError if no report confirms it."""
        for _ in range(LEVEL_TRIES):
            report = self.wait_confirmed(self._send(messages.level), LEVEL_S)
            if report is not None and Flag.LEVEL in report.flags:
                return report
        raise RigError(
            f"{self.port}: the board does not confirm that the plate is level; without commands it levels it itself"
            " after 0.2 s, and if it does not: take its supply away"
        )

    def close(self) -> None:
        """Level the plate if possible, and release the port. Never raises; a second call does nothing."""
        if self._thread is None:
            return
        with contextlib.suppress(RigError):
            self.level()
        self._closing.set()
        self._thread.join(timeout=CLOSE_S)
        self._thread = None
        self._drop_port()

    def __enter__(self) -> Board:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ---- sending

    def _send(self, frame: Callable[[int], bytes]) -> int:
        """Send the frame with a new number, and return the number. The reading thread notices a lost port."""
        with self._writing:
            self._check()
            if self._thread is None:
                raise RigError(f"{self.port}: is not open")
            self._sent += 1
            self._write(frame(messages.wire_number(self._sent)))
            return self._sent

    def _write(self, data: bytes) -> None:
        """Write to the port. The caller holds the lock; the reading thread notices a lost port."""
        if self._serial is not None:
            with contextlib.suppress(OSError):
                self._serial.write(data)

    def _check(self) -> None:
        if self._failure:
            raise RigError(self._failure)

    def _confirmed(self, number: int) -> bool:
        return self._report is not None and self._report.sequence >= number

    # ---- the thread that reads

    def _work(self) -> None:
        """Read until the end. An unexpected error makes the board count as lost: no thread may end in silence."""
        try:
            self._read()
        except Exception as problem:
            self._fail(f"reading failed: {type(problem).__name__}: {' '.join(str(problem).split())}")

    def _read(self) -> None:
        """Read reports until the board is closed or lost."""
        reader, heard = FrameReader(), monotonic()
        while not self._closing.is_set():
            try:
                frames = reader.feed(self._bytes())
            except (OSError, TypeError):  # pyserial raises TypeError for a port that was closed meanwhile
                return self._fail("was lost (unplugged?)")
            reports = [self._take(frame) for frame in frames]
            if any(reports):
                heard = monotonic()
            elif monotonic() - heard > self.timeouts.silence_s:
                return self._fail(f"gave no report for {self.timeouts.silence_s:g} s")

    def _bytes(self) -> bytes:
        """Bytes received, after the first byte or 50 ms. Raises OSError if the port is lost."""
        assert self._serial is not None
        data = self._serial.read(1)
        return data + self._serial.read(self._serial.in_waiting) if data else data

    def _take(self, frame: Frame) -> bool:
        """Take in a report. Returns False for any other frame."""
        if frame.kind != "T":
            return False
        try:
            self._take_report(messages.read_report(frame, self._sent, self._clock, monotonic()))
        except ValueError:
            return False
        return True

    def _take_report(self, report: TiltReport) -> None:
        if Flag.UNSET in report.flags:
            self._send_limits(report.received_s)
        with self._news:
            self._report = report
            self._reports.append(report)
            self._news.notify_all()

    def _send_limits(self, now: float) -> None:
        """Send the limits to a board that has restarted. Later reports repeat this until the board has its limits."""
        if now < self._limits_again:
            return
        self._limits_again = now + LEVEL_S
        with self._writing:
            for axis, limits in enumerate(self.limits.axes()):
                self._write(messages.set_limits(0, axis, limits))

    def _fail(self, problem: str) -> None:
        """Let every call raise this problem from now on."""
        with self._news:
            self._failure = f"{self.port}: {problem}"
            self._news.notify_all()

    def _drop_port(self) -> None:
        with self._writing:
            serial, self._serial = self._serial, None
        if serial is not None:
            with contextlib.suppress(OSError):
                serial.close()
