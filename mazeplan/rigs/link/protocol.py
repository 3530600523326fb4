"""The line protocol of docs/protocol.md: frames, and the messages in them.

    $T,17,123450,32768,32760,15000,15000,0,0,0*B6DC\\n

'$', a body of at most 64 printable characters, '*', the CRC-16 of the body in four upper-case hexadecimal digits,
newline. On the board, tools/firmware/frame.c reads and writes them. Units on the line: pulses in tenths of a
microsecond, times in tenths of a millisecond, conversions in 1/64 of a count. This module opens no port and reads no
clock.
"""

from __future__ import annotations

from binascii import crc_hqx
from dataclasses import dataclass
from enum import IntFlag

NAME, PROTOCOL = "mazeplan", 1
AXES = ("beta", "gamma")
HARD_US, HARD_SLEW = (800.0, 2200.0), 20000.0  # us, us/s: limits of the firmware (tools/firmware/control.h)
SUPPLY_V, FULL = 5.0, 1023.0  # voltage and count at the upper end of the board's converter
MOST_BODY = 64  # characters
CRC_START = 0xFFFF  # of the CRC-16 with polynomial 0x1021
U16, U32 = 1 << 16, 1 << 32
BEGIN, SUM, END, HEX = b"$"[0], b"*"[0], b"\n"[0], b"0123456789ABCDEF"


@dataclass(frozen=True)
class Frame:
    """A frame with a correct checksum: its letter, and the fields after it."""

    kind: str
    fields: tuple[str, ...]

    def numbers(self, count: int, *, first: int = 0) -> tuple[int, ...]:
        """`count` fields, from number `first` on, as whole numbers. Raises ValueError if they are not numbers."""
        fields = self.fields[first : first + count]
        whole = all(field.isascii() and field.isdigit() and len(field) <= 10 for field in fields)
        if len(fields) != count or not whole:
            raise ValueError(f"got {','.join((self.kind, *self.fields))!r}, expected {count} numbers")
        return tuple(int(field) for field in fields)


def encode(kind: str, *fields: int | str) -> bytes:
    """A frame as bytes. Raises ValueError for fields that no frame can hold."""
    body = ",".join((kind, *map(str, fields)))
    if len(body) > MOST_BODY or not body.isascii() or not body.isprintable() or {"$", "*"} & set(body):
        raise ValueError(f"got {body!r}, expected up to {MOST_BODY} printable characters, without $ and *")
    return b"$%s*%04X\n" % (body.encode(), crc_hqx(body.encode(), CRC_START))


class FrameReader:
    """Converts bytes, in pieces of any size, to frames. After noise the reader continues at the next '$'.

    bad: number of damaged frames. Bytes outside frames do not count."""

    def __init__(self) -> None:
        self.bad = 0
        self._rest = bytearray()  # empty, or a '$' and the bytes of its frame so far

    def feed(self, data: bytes) -> list[Frame]:
        """Take bytes, and return the frames that they complete."""
        found = []
        self._rest += data
        while True:
            begin = self._rest.find(BEGIN)
            if begin < 0:
                self._rest.clear()
                return found
            del self._rest[:begin]
            length, complete = _look(self._rest)
            if length == 0:
                return found
            body = bytes(self._rest[1 : length - 6])
            del self._rest[:length]
            if complete:
                kind, *fields = body.decode("ascii").split(",")
                found.append(Frame(kind, tuple(fields)))
            else:
                self.bad += 1


def _look(data: bytearray) -> tuple[int, bool]:
    """Number of bytes to remove from the start, and whether they are a good frame.

    (0, False): the frame is incomplete so far."""
    star: int | None = None
    for at in range(1, len(data)):
        byte = data[at]
        if byte == BEGIN:
            return at, False
        if star is None:
            if byte == SUM:
                star = at
            elif not 32 <= byte <= 126 or at > MOST_BODY:
                return at + 1, False
        elif at == star + 5:
            return at + 1, byte == END and int(data[star + 1 : at], 16) == crc_hqx(data[1:star], CRC_START)
        elif byte not in HEX:
            return at + 1, False
    return 0, False


class Flag(IntFlag):
    """State of the board in a report."""

    WATCHDOG = 1  # no valid command came for 200 ms: the plate is level until the next command
    UNSET = 2  # the board has got no limits since its start: it refuses commands
    LEVEL = 4  # the board holds the plate level: by request, by the watchdog, or since the start
    CLAMPED = 8  # the last command was outside the limits
    MOVING = 16  # the pulse is still on its way to the command, at the slew rate


@dataclass(frozen=True)
class AxisLimits:
    """Limits of the pulses of one servo, with min <= level <= max. The firmware has hard limits besides."""

    min_us: float
    max_us: float
    level_us: float
    slew_us_per_s: float

    def clamp(self, pulse_us: float) -> float:
        """The nearest allowed pulse; for NaN and infinity the pulse of the level plate."""
        if not abs(pulse_us) < float("inf"):
            return self.level_us
        return min(max(pulse_us, self.min_us), self.max_us)

    def on_the_line(self) -> tuple[int, int, int, int]:
        """min, max, level in tenths of a microsecond, slew rate in us/s."""
        return tenths(self.min_us), tenths(self.max_us), tenths(self.level_us), round(self.slew_us_per_s)


ServoLimits = tuple[AxisLimits, AxisLimits]  # beta, gamma


def tenths(pulse_us: float) -> int:
    """Pulse in tenths of a microsecond."""
    return round(10 * pulse_us)


@dataclass(frozen=True)
class Identity:
    """Identity of the board: name, protocol and version of its firmware, and the firmware's own limits."""

    name: str
    protocol: int
    version: str
    min_us: float
    max_us: float
    slew_us_per_s: float
    watchdog_s: float  # silence after which the board levels the plate


@dataclass(frozen=True)
class TiltReport:
    """One report of the board. About a hundred come each second."""

    time_s: float  # middle of the conversions, by the board's clock; it begins again at a restart and every 119 h
    counts: tuple[float, float]  # mean of each of the two channels, 0 to 1023
    sequence: int  # number on the line of the last accepted command; 0: none
    pulses_us: tuple[float, float]  # present pulses of beta and gamma
    flags: Flag
    strikes: int  # how often the board's watchdog has struck since the board's start
    bad_frames: int  # frames that the board could not read
    received_s: float  # when the report arrived, monotonic clock of the host

    @property
    def volts(self) -> tuple[float, float]:
        """Voltages of the two channels."""
        return self.counts[0] * SUPPLY_V / FULL, self.counts[1] * SUPPLY_V / FULL


def read_identity(frame: Frame) -> tuple[int, Identity]:
    """Number of the question, and the identity in the answer. Raises ValueError for another frame."""
    if len(frame.fields) < 4:
        raise ValueError("too few fields in an identity")
    (wire,), (protocol,) = frame.numbers(1), frame.numbers(1, first=2)
    name, version = frame.fields[1], frame.fields[3]
    if name != NAME or protocol != PROTOCOL:  # the rest may be anything
        return wire, Identity(name, protocol, version, 0.0, 0.0, 0.0, 0.0)
    low, high, slew, watchdog = frame.numbers(4, first=4)
    return wire, Identity(name, protocol, version, low / 10, high / 10, float(slew), watchdog / 1000)


def read_report(frame: Frame, received_s: float) -> TiltReport:
    """A report that arrived at `received_s`, monotonic clock of the host. Raises ValueError for another frame."""
    wire, time, first, second, beta, gamma, flags, strikes, bad = frame.numbers(9)
    if wire >= U16 or time >= U32 or max(first, second) > 64 * 1023:
        raise ValueError(f"got {frame}, expected a report")
    counts, pulses = (first / 64, second / 64), (beta / 10, gamma / 10)
    return TiltReport(time / 1e4, counts, wire, pulses, Flag(flags), strikes, bad, received_s)
