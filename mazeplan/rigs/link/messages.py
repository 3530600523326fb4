"""Messages of the line protocol: frames of the board to records, commands to frames. See docs/protocol.md.

On the line pulses are in tenths of a microsecond, times in tenths of a millisecond, conversions in 1/64 of a count.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag

from mazeplan.core.errors import SettingsError
from mazeplan.rigs.link.frames import U16, U32, Frame, encode

NAME, PROTOCOL = "mazeplan", 1
AXES = ("beta", "gamma")
HARD_US, HARD_SLEW = (800.0, 2200.0), 20000.0  # us, us/s: limits of the firmware (tools/firmware/control.h)
SUPPLY_V, FULL = 5.0, 1023.0  # V and count at the upper end of the board's converter
SEQUENCES = U16 - 1  # numbers 1 to 65535; 0: no command accepted yet


class Flag(IntFlag):
    """State of the board in a report."""

    WATCHDOG = 1  # struck: no valid command for 200 ms, so the plate is level until the next one
    UNSET = 2  # no limits since its start: commands are refused
    LEVEL = 4  # held level: by request, by the watchdog, or since the start
    CLAMPED = 8  # the last command was outside the limits
    MOVING = 16  # the slew rate holds the pulse back


@dataclass(frozen=True)
class AxisLimits:
    """Pulses of one servo, us, and how fast they may change, us/s. Raises SettingsError."""

    min_us: float
    max_us: float
    level_us: float
    slew_us_per_s: float

    def __post_init__(self) -> None:
        if not 0 < self.min_us <= self.level_us <= self.max_us <= 6000:  # 65535 tenths fit a frame
            raise SettingsError(
                f"got pulses min {self.min_us:g}, level {self.level_us:g}, max {self.max_us:g} us,"
                " expected 0 < min <= level <= max <= 6000"
            )
        if not 1 <= self.slew_us_per_s < U16:
            raise SettingsError(f"got slew rate {self.slew_us_per_s:g} us/s, expected 1 to {U16 - 1}")

    def clamp(self, pulse_us: float) -> float:
        """The nearest allowed pulse; level for NaN and infinity."""
        if not abs(pulse_us) < float("inf"):
            return self.level_us
        return min(max(pulse_us, self.min_us), self.max_us)

    def on_the_line(self) -> tuple[int, int, int, int]:
        """min, max, level in tenths of a microsecond, slew rate in us/s."""
        return tenths(self.min_us), tenths(self.max_us), tenths(self.level_us), round(self.slew_us_per_s)


@dataclass(frozen=True)
class ServoLimits:
    """Limits of both servos by the rig's file. The firmware has hard limits besides."""

    beta: AxisLimits
    gamma: AxisLimits

    def axes(self) -> tuple[AxisLimits, AxisLimits]:
        """beta, gamma."""
        return self.beta, self.gamma


@dataclass(frozen=True)
class Identity:
    """Identity of the board; hard limits in us and us/s; cause: of its last start."""

    name: str
    protocol: int
    version: str
    min_us: float
    max_us: float
    slew_us_per_s: float
    watchdog_s: float
    cause: str


@dataclass(frozen=True)
class TiltReport:
    """One report, about a hundred a second.

    time_s: middle of the conversions by the board's clock, never decreasing; counts: mean of both channels, 0 to 1023;
    sequence: of the last accepted command, 0: none; pulses_us: beta, gamma now; strikes: of the board's watchdog since
    its start; bad_frames: unreadable for the board; received_s: monotonic clock of the host."""

    time_s: float
    counts: tuple[float, float]
    sequence: int
    pulses_us: tuple[float, float]
    flags: Flag
    strikes: int
    bad_frames: int
    received_s: float

    @property
    def volts(self) -> tuple[float, float]:
        """Voltages of the two channels."""
        return self.counts[0] * SUPPLY_V / FULL, self.counts[1] * SUPPLY_V / FULL


@dataclass(frozen=True)
class BoardEvent:
    """An event of the board: BOOT (value: bits of the cause), WATCHDOG (value: count so far)."""

    number: int
    word: str
    time_s: float
    value: int


CAUSES = ((8, "watchdog of the chip"), (4, "supply too low"), (2, "reset line"), (1, "power on"))


def tenths(pulse_us: float) -> int:
    """Pulse in tenths of a microsecond."""
    return round(10 * pulse_us)


def cause_name(bits: int) -> str:
    """Cause of the chip's start, in words."""
    return ", ".join(name for bit, name in CAUSES if bits & bit) or "unknown"


def wire_number(sequence: int) -> int:
    """1 to 65535 for sequence numbers from 1 on."""
    return 1 + (sequence - 1) % SEQUENCES


def unwrapped(wire: int, newest: int) -> int:
    """The newest sequence number up to `newest` with this number on the line; 0 for none."""
    if wire == 0 or newest < 1:
        return 0
    return max(newest - (wire_number(newest) - wire) % SEQUENCES, 0)


def identify(wire: int) -> bytes:
    """Question for the identity."""
    return encode("I", wire)


def set_limits(wire: int, axis: int, limits: AxisLimits) -> bytes:
    """Limits of one axis."""
    return encode("L", wire, axis, *limits.on_the_line())


def command(wire: int, beta_us: float, gamma_us: float) -> bytes:
    """Both pulses."""
    return encode("C", wire, tenths(beta_us), tenths(gamma_us))


def level(wire: int) -> bytes:
    """Level now."""
    return encode("Z", wire)


def read_identity(frame: Frame) -> tuple[int, Identity]:
    """Number of the question, and the answer. Raises ValueError."""
    if len(frame.fields) < 4:
        raise ValueError("too few fields in an identity")
    (wire,), (protocol,) = frame.numbers(1), frame.numbers(1, first=2)
    name, version = frame.fields[1], frame.fields[3]
    if name != NAME or protocol != PROTOCOL:  # the rest may be anything
        return wire, Identity(name, protocol, version, 0.0, 0.0, 0.0, 0.0, "")
    low, high, slew, watchdog, cause = frame.numbers(5, first=4)
    return wire, Identity(name, protocol, version, low / 10, high / 10, float(slew), watchdog / 1000, cause_name(cause))


def read_limits(frame: Frame) -> tuple[int, tuple[int, tuple[int, ...]]]:
    """Number of the request; axis, and accepted limits as `AxisLimits.on_the_line`. Raises ValueError."""
    wire, axis, *values = frame.numbers(6)
    return wire, (axis, tuple(values))


def read_event(frame: Frame) -> BoardEvent:
    """An event. Raises ValueError."""
    (number,), (time, value) = frame.numbers(1), frame.numbers(2, first=2)
    return BoardEvent(number, frame.fields[1], time / 1e4, value)


RESTART = 20_000  # tenths of a ms, largest difference of both clocks between two reports


class BoardClock:
    """The board's time without its wraps (every 119 h) and restarts; after a restart the host's clock continues it."""

    def __init__(self) -> None:
        self._raw: int | None = None
        self._offset = 0  # of a raw time, tenths of a ms
        self._received = 0.0

    def seconds(self, raw: int, received_s: float) -> float:
        """Time of a report, s; never decreases."""
        if self._raw is not None:
            ahead, waited = (raw - self._raw) % U32, round(1e4 * (received_s - self._received))
            if abs(ahead - waited) > RESTART:  # the board restarted
                ahead = max(waited, 1)
            self._offset += self._raw + ahead - raw
        self._raw, self._received = raw, received_s
        return (raw + self._offset) / 1e4


def read_report(frame: Frame, newest: int, clock: BoardClock, received_s: float) -> TiltReport:
    """A report; newest: sequence number sent last. Raises ValueError."""
    wire, time, first, second, beta, gamma, flags, strikes, bad = frame.numbers(9)
    if wire >= U16 or time >= U32 or max(first, second) > 64 * 1023:
        raise ValueError(f"got {frame}, expected a report")
    return TiltReport(
        time_s=clock.seconds(time, received_s),
        counts=(first / 64, second / 64),
        sequence=unwrapped(wire, newest),
        pulses_us=(beta / 10, gamma / 10),
        flags=Flag(flags),
        strikes=strikes,
        bad_frames=bad,
        received_s=received_s,
    )
