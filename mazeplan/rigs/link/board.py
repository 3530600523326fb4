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
from dataclasses import dataclass
from time import monotonic, monotonic_ns, sleep
from typing import TYPE_CHECKING, TypeVar

from mazeplan.core.errors import RigError
from mazeplan.core.resources import to_install
from mazeplan.rigs.link import protocol
from mazeplan.rigs.link.protocol import Flag, Frame, FrameReader, Identity, ServoLimits, TiltReport

if TYPE_CHECKING:
    import serial

Answer = TypeVar("Answer")
AUTO = "auto"  # as the name of a port: the only port behind USB
BAUD = 115200
POLL_S = 0.05  # s, longest wait of a read for the first byte
WRITE_S = 0.2  # s, longest wait of a write; a port that accepts no byte for so long is dead
LEVEL_TRIES, LEVEL_S = 3, 0.1  # tries of `level`; longest wait for a confirmation, s
REPORTS = 100  # number of newest reports that are kept: those of one second
ANSWERS = 20  # number of newest frames that are kept as possible answers to a question
SEQUENCES = protocol.U16 - 1  # commands have the numbers 1 to 65535 on the line; 0: none is accepted yet
FIRST_BELOW = 60000  # numbers of questions start below this at random, so that they stay below 65536
HEARD_S = 0.05  # s, longer than the time between two frames of a running board
CLOSE_S = 1.0  # s, longest wait for the end of the reading thread
FLASH = "`make firmware` builds build/firmware/mazeplan.hex, tools/firmware/Makefile says how to flash it"


@dataclass(frozen=True)
class Timeouts:
    """Time limits."""

    answer_s: float = 5.0  # for the whole handshake when the board is opened
    listen_s: float = 2.5  # for the first report, before the first question
    again_s: float = 0.25  # before a question without an answer is repeated
    silence_s: float = 0.5  # without a report before the board counts as lost


class Board:
    """The board; see the module's docstring. Several threads may call its methods."""

    def __init__(self, port: str, limits: ServoLimits, timeouts: Timeouts | None = None) -> None:
        """Keeps the arguments, and opens nothing yet."""
        self.port = port
        self.limits = limits
        self.timeouts = timeouts or Timeouts()
        self.identity: Identity | None = None
        self._serial: serial.Serial | None = None
        self._news = threading.Condition()
        self._writing = threading.Lock()
        self._thread: threading.Thread | None = None
        self._closing = threading.Event()
        self._failure: str | None = None
        self._reports: deque[TiltReport] = deque(maxlen=REPORTS)
        self._answers: deque[Frame] = deque(maxlen=ANSWERS)
        self._received = 0  # bytes
        self._asked = monotonic_ns() % FIRST_BELOW  # at random, so that answers to an earlier program do not match
        self._sent = 0  # number of commands so far
        self._limits_again = 0.0  # earliest time to send the limits again, monotonic clock, s

    def open(self) -> Identity:
        """Connect: check the identity, send the limits, wait for a report. Raises RigError with the port and advice."""
        if self._thread is not None:
            raise RigError(f"{self.port}: is open already")
        self._closing.clear()
        self._failure = self.identity = None
        self._reports.clear()
        self._serial = _open_port(self.port)
        self._thread = threading.Thread(target=self._work, name=f"board {self.port}", daemon=True)
        self._thread.start()
        try:
            self.identity = self._handshake(monotonic() + self.timeouts.answer_s)
            if self.wait_newer(None, self.timeouts.silence_s) is None:
                raise RigError(f"{self.port}: the board answers, but sends no reports; unplug it and plug it in again")
        except BaseException:
            self._release()
            raise
        return self.identity

    def _handshake(self, until: float) -> Identity:
        """Check the board's identity, and send the limits. until: latest time of the answers, monotonic clock, s.

        Many boards restart when a program opens their port. The boot loader takes 1 to 2 s, and longer if it receives
        bytes. The first report may come from before the restart, so wait for another report HEARD_S later."""
        listened = min(monotonic() + self.timeouts.listen_s, until)
        if self.wait_newer(None, listened - monotonic()) is not None:
            sleep(HEARD_S)
            self.wait_newer(self.latest(), max(0.0, listened - monotonic()))
        identity = self._ask("I", (), protocol.read_identity, until)
        if (identity.name, identity.protocol) != (protocol.NAME, protocol.PROTOCOL):
            got = f"got protocol {identity.protocol} of firmware {identity.name!r} {identity.version}"
            wanted = f"expected {protocol.PROTOCOL} of {protocol.NAME!r}"
            raise RigError(f"{self.port}: {got}, {wanted}: {FLASH}")
        for axis, limits in enumerate(self.limits):
            sent = (axis, *limits.on_the_line())
            if self._ask("L", sent, lambda frame: (frame.numbers(1)[0], frame.numbers(5, first=1)), until) != sent:
                got, hard = (f"{x.min_us:g} to {x.max_us:g} us, {x.slew_us_per_s:g} us/s" for x in (limits, identity))
                what = f"got limits {got} for {protocol.AXES[axis]}, the firmware allows {hard}"
                raise RigError(f"{self.port}: {what}: choose narrower ones in the rig's file")
        return identity

    def _ask(
        self, kind: str, fields: tuple[int, ...], read: Callable[[Frame], tuple[int, Answer]], until: float
    ) -> Answer:
        """Repeat a question until an answer comes with the number of the question."""

        def answers() -> list[Answer]:
            found = []
            for frame in self._answers:
                with contextlib.suppress(ValueError):
                    number, answer = read(frame)
                    if frame.kind == kind and number == self._asked:
                        found.append(answer)
            return found

        while (now := monotonic()) < until:
            self._asked += 1
            with self._writing:
                self._write(protocol.encode(kind, self._asked, *fields))
            with self._news:
                self._news.wait_for(lambda: self._failure or answers(), min(self.timeouts.again_s, until - now))
                self._check()
                if found := answers():
                    return found[0]
        what = "the board does not answer; is its firmware on it, and is this its port?"
        if self._received > 0:
            what = f"{self._received} bytes came, but no answer; another firmware, or another baud rate?"
        raise RigError(f"{self.port}: {what} {FLASH}")

    def command(self, pulse_beta_us: float, pulse_gamma_us: float) -> int:
        """Command both pulses, clamped to the limits; returns the command's number. Raises RigError as `latest`."""
        pulses = self.limits[0].clamp(pulse_beta_us), self.limits[1].clamp(pulse_gamma_us)
        return self._send("C", *(protocol.tenths(pulse) for pulse in pulses))

    def latest(self) -> TiltReport | None:
        """The newest report. Raises RigError if the board is lost."""
        return self._wait(lambda: True, 0.0)

    def recent(self) -> list[TiltReport]:
        """The reports of the last second, newest last. Raises RigError if the board is lost."""
        with self._news:
            self._check()
            return list(self._reports)

    def wait_newer(self, than: TiltReport | None, timeout_s: float) -> TiltReport | None:
        """Wait for a report newer than the report `than`; None after the timeout. Raises RigError as `latest`."""
        return self._wait(lambda: self._newest() is not than, timeout_s)

    def wait_confirmed(self, number: int, timeout_s: float) -> TiltReport | None:
        """Wait for a report that confirms this command or a later one; None after the timeout. Raises as `latest`."""
        return self._wait(lambda: self._confirmed(number), timeout_s)

    def _wait(self, true: Callable[[], bool], timeout_s: float) -> TiltReport | None:
        with self._news:
            self._news.wait_for(lambda: self._failure or true(), timeout_s)
            self._check()
            return self._newest() if true() else None

    def level(self) -> TiltReport:
        """Level the plate now, without the limit of the slew rate. Raises RigError if no report confirms it."""
        for _ in range(LEVEL_TRIES):
            report = self.wait_confirmed(self._send("Z"), LEVEL_S)
            if report is not None and Flag.LEVEL in report.flags:
                return report
        what = "the board does not confirm that the plate is level; without commands it levels it itself after 0.2 s"
        raise RigError(f"{self.port}: {what}, and if it does not: take its supply away")

    def close(self) -> None:
        """Level the plate if possible, and release the port. Never raises; a second call does nothing."""
        if self._thread is None:
            return
        with contextlib.suppress(RigError):
            self.level()
        self._release()

    def _release(self) -> None:
        """End the reading thread, and close the port."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join(timeout=CLOSE_S)
        self._thread = None
        with self._writing:
            serial, self._serial = self._serial, None
        if serial is not None:
            with contextlib.suppress(OSError):
                serial.close()

    def __enter__(self) -> Board:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _send(self, kind: str, *fields: int) -> int:
        """Send a frame with a new number, and return the number. The reading thread notices a lost port."""
        with self._writing:
            self._check()
            if self._thread is None:
                raise RigError(f"{self.port}: is not open")
            self._sent += 1
            self._write(protocol.encode(kind, _wire_number(self._sent), *fields))
            return self._sent

    def _write(self, data: bytes) -> None:
        """Write to the port. The caller holds the lock."""
        if self._serial is not None:
            with contextlib.suppress(OSError):
                self._serial.write(data)

    def _check(self) -> None:
        if self._failure:
            raise RigError(self._failure)

    def _newest(self) -> TiltReport | None:
        return self._reports[-1] if self._reports else None

    def _confirmed(self, number: int) -> bool:
        newest = self._newest()
        if newest is None or newest.sequence == 0:
            return False
        behind = (_wire_number(self._sent) - newest.sequence) % SEQUENCES
        return self._sent - behind >= number

    def _work(self) -> None:
        """Read until the end. An unexpected error makes the board count as lost: no thread may end in silence."""
        try:
            self._read()
        except (OSError, TypeError):  # pyserial raises TypeError for a port that was closed meanwhile
            self._fail("was lost (unplugged?)")
        except Exception as problem:
            self._fail(f"reading failed: {type(problem).__name__}: {' '.join(str(problem).split())}")

    def _read(self) -> None:
        """Read reports and answers until the board is closed or lost."""
        reader, heard = FrameReader(), monotonic()
        while not self._closing.is_set():
            assert self._serial is not None
            data = self._serial.read(1)  # waits for at most 50 ms
            data += self._serial.read(self._serial.in_waiting) if data else b""
            self._received += len(data)
            reports = [self._take(frame) for frame in reader.feed(data)]
            if any(reports) or self.identity is None:
                heard = monotonic()
            elif monotonic() - heard > self.timeouts.silence_s:
                return self._fail(f"gave no report for {self.timeouts.silence_s:g} s")

    def _take(self, frame: Frame) -> bool:
        """Take in a frame. Returns whether it is a report."""
        report = None
        if frame.kind == "T":
            with contextlib.suppress(ValueError):
                report = protocol.read_report(frame, monotonic())
        if report is not None and Flag.UNSET in report.flags and self.identity is not None:
            self._send_limits(report.received_s)
        with self._news:
            if report is None:
                self._answers.append(frame)
            else:
                self._reports.append(report)
            self._news.notify_all()
        return report is not None

    def _send_limits(self, now: float) -> None:
        """Send the limits to a board that has restarted. Later reports repeat this until the board has its limits."""
        if now < self._limits_again:
            return
        self._limits_again = now + LEVEL_S
        with self._writing:
            for axis, limits in enumerate(self.limits):
                self._write(protocol.encode("L", 0, axis, *limits.on_the_line()))

    def _fail(self, problem: str) -> None:
        """Let every call raise this problem from now on."""
        with self._news:
            self._failure = f"{self.port}: {problem}"
            self._news.notify_all()


def _wire_number(sequence: int) -> int:
    """The number on the line, 1 to 65535, of a sequence number from 1 on."""
    return 1 + (sequence - 1) % SEQUENCES


def ports_found() -> list[str]:
    """Names of the serial ports behind USB. One of them may be the board. Raises RigError without pyserial."""
    try:
        from serial.tools.list_ports import comports
    except ImportError as missing:
        raise RigError(f"a serial port needs pyserial: {to_install('hardware')}") from missing
    return sorted(port.device for port in comports() if port.vid is not None)


def _open_port(name: str) -> serial.Serial:
    """Open the port at 115200 baud, exclusively. Raises RigError with the port and advice."""
    found = ", ".join(ports_found()) or "none"
    import serial

    try:
        return serial.Serial(name, BAUD, timeout=POLL_S, write_timeout=WRITE_S, exclusive=True)
    except Exception as problem:  # also termios.error, which is no OSError: a port that vanishes while it is opened
        what = f"cannot be opened ({' '.join(str(problem).split())})"
        raise RigError(
            f"{name}: {what}; is it the board's port (found: {found}), does no other program use it, and may you open"
            " it (often: sudo usermod -aG dialout $USER, then log in again)?"
        ) from problem


def open_board(port: str, limits: ServoLimits) -> Board:
    """An open board. port: name of the serial port, or `auto`, the only one behind USB. Raises RigError."""
    if port == AUTO:
        found = ports_found()
        if len(found) != 1:
            got = f"found {', '.join(found)}; name the board's as `port:`" if found else "none found; plug the board in"
            raise RigError(f"port: auto: {got}")
        port = found[0]
    board = Board(port, limits)
    board.open()
    return board
