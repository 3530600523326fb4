"""Connects to a board: identity, protocol, limits and their confirmation."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic, monotonic_ns
from typing import TYPE_CHECKING, TypeVar

from mazeplan.core.errors import RigError
from mazeplan.rigs.link import messages
from mazeplan.rigs.link.frames import Frame, FrameReader
from mazeplan.rigs.link.messages import AXES, NAME, PROTOCOL, AxisLimits, Identity, ServoLimits
from mazeplan.rigs.link.port import open_port

if TYPE_CHECKING:
    import serial

FIRST_BELOW = 60000  # numbers of questions start below this at random, so that they stay below 65536
HEARD_S = 0.05  # s, longer than the time between two frames of a running board
Answer = TypeVar("Answer")
FLASH = "`make firmware` builds build/firmware/mazeplan.hex, tools/firmware/Makefile says how to flash it"


@dataclass(frozen=True)
class Timeouts:
    """Time limits, s.

    answer_s: for the whole handshake when the board is opened.
    listen_s: for the first report, before the first question.
    again_s: before a question without an answer is repeated.
    silence_s: without a report before the board counts as lost."""

    answer_s: float = 5.0
    listen_s: float = 2.5
    again_s: float = 0.25
    silence_s: float = 0.5


def connect(
    name: str, limits: ServoLimits, timeouts: Timeouts, until: float, stop: threading.Event
) -> tuple[serial.Serial, Identity]:
    """Open the port, check the identity, send the limits. Raises RigError with the port and advice.

    until: latest time for the answers, monotonic clock, s.
    stop: when set, ends the attempt earlier."""
    port = open_port(name)
    try:
        talk = _Talk(name, port, timeouts.again_s, until, stop)
        talk.listen(timeouts.listen_s)
        identity = talk.identify()
        for axis, one in enumerate(limits.axes()):
            talk.set_limits(axis, one, identity)
        return port, identity
    except BaseException:
        port.close()
        raise


class _Talk:
    """Questions and answers on an open port."""

    def __init__(self, name: str, port: serial.Serial, again_s: float, until: float, stop: threading.Event) -> None:
        self._stop = stop
        self._name, self._port, self._again, self._until = name, port, again_s, until
        self._reader, self._bytes = FrameReader(), 0
        self._wire = monotonic_ns() % FIRST_BELOW  # at random, so that answers to an earlier program do not match

    def listen(self, most_s: float) -> None:
        """Wait for reports of the board, for at most `most_s`.

        Many boards restart when a program opens their port. The boot loader takes 1 to 2 s, and longer if it receives
        bytes. The first frame may come from before the restart, so wait for another frame HEARD_S later."""
        end, first = min(monotonic() + most_s, self._until), float("inf")
        while monotonic() < end and not self._stop.is_set():
            if self._frames():
                first = min(first, monotonic())
                if monotonic() - first > HEARD_S:
                    return

    def identify(self) -> Identity:
        """Ask for the board's identity, and check it. Raises RigError for another firmware or protocol."""
        identity = self._ask("I", messages.identify, messages.read_identity)
        if identity.name != NAME:
            raise RigError(f"{self._name}: got {identity.name!r} at the other end, expected {NAME!r}: {FLASH}")
        if identity.protocol != PROTOCOL:
            raise RigError(
                f"{self._name}: got protocol {identity.protocol} of firmware {identity.version}, this program speaks"
                f" {PROTOCOL}; flash the firmware that belongs to it: {FLASH}"
            )
        return identity

    def set_limits(self, axis: int, limits: AxisLimits, identity: Identity) -> None:
        """Send the limits of one axis. Raises RigError unless the board has accepted them."""
        sent = limits.on_the_line()
        got, in_force = self._ask("L", lambda wire: messages.set_limits(wire, axis, limits), messages.read_limits)
        if (got, in_force) != (axis, sent):
            raise RigError(
                f"{self._name}: got limits {limits.min_us:g} to {limits.max_us:g} us, {limits.slew_us_per_s:g} us/s for"
                f" {AXES[axis]}, the firmware allows {identity.min_us:g} to {identity.max_us:g} us,"
                f" {identity.slew_us_per_s:g} us/s: choose narrower ones in the rig's file"
            )

    def _ask(self, kind: str, question: Callable[[int], bytes], read: Callable[[Frame], tuple[int, Answer]]) -> Answer:
        """Repeat a question until an answer comes with the number of the question."""
        while monotonic() < self._until and not self._stop.is_set():
            self._wire += 1
            with contextlib.suppress(OSError):
                self._port.write(question(self._wire))
            again = min(monotonic() + self._again, self._until)
            while monotonic() < again:
                for frame in self._frames():
                    if frame.kind != kind:
                        continue
                    with contextlib.suppress(ValueError):
                        wire, answer = read(frame)
                        if wire == self._wire:
                            return answer
        raise RigError(f"{self._name}: {self._silence()}")

    def _frames(self) -> list[Frame]:
        try:
            data = self._port.read(1)
            data += self._port.read(self._port.in_waiting) if data else b""
        except (OSError, TypeError) as problem:
            raise RigError(
                f"{self._name}: was lost during the question for the board's identity; plug it in again"
            ) from problem
        self._bytes += len(data)
        return self._reader.feed(data)

    def _silence(self) -> str:
        if self._bytes == 0:
            return f"the board does not answer; is its firmware on it ({FLASH}), and is this its port?"
        return f"{self._bytes} bytes came, but no answer; another firmware, or another baud rate: {FLASH}"
