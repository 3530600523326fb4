"""Messages of the line protocol, see docs/protocol.md. Converts the board's frames to records, and commands to frames.

Units on the line: pulses in tenths of a microsecond, times in tenths of a millisecond, conversions in 1/64 of a count.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag

from mazeplan.core.errors import SettingsError
from mazeplan.rigs.link.frames import U16, U32, Frame, encode

NAME, PROTOCOL = "mazeplan", 1
AXES = ("beta", "gamma")
HARD_US, HARD_SLEW = (800.0, 2200.0), 20000.0  # us, us/s: limits of the firmware (tools/firmware/control.h)
SUPPLY_V, FULL = 5.0, 1023.0  # voltage and count at the upper end of the board's converter
SEQUENCES = U16 - 1  # how many numbers commands have on the line: 1 to 65535; 0 means that none is accepted yet


class Flag(IntFlag):
    """State of the board in a report."""

    WATCHDOG = 1  # no valid command came for 200 ms: the plate is level until the next command
    UNSET = 2  # the board has got no limits since its start: it refuses commands
    LEVEL = 4  # the board holds the plate level: by request, by the watchdog, or since the start
    CLAMPED = 8  # the last command was outside the limits
    MOVING = 16  # the pulse is still on its way to the command, at the slew rate


@dataclass(frozen=True)
class AxisLimits:
    """Limits of the pulses of one servo, us, and of their rate of change, us/s.

    Raises SettingsError for impossible limits."""

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
        """The nearest allowed pulse; for NaN and infinity the pulse of the level plate."""
        if not abs(pulse_us) < float("inf"):
            return self.level_us
        return min(max(pulse_us, self.min_us), self.max_us)

    def on_the_line(self) -> tuple[int, int, int, int]:
        """min, max, level in tenths of a microsecond, slew rate in us/s."""
        return tenths(self.min_us), tenths(self.max_us), tenths(self.level_us), round(self.slew_us_per_s)


@dataclass(frozen=True)
class ServoLimits:
    """Limits of both servos, from the rig's file. The firmware has its own hard limits besides."""

    beta: AxisLimits
    gamma: AxisLimits

    def axes(self) -> tuple[AxisLimits, AxisLimits]:
        """beta, gamma."""
        return self.beta, self.gamma


@dataclass(frozen=True)
class Identity:
    """Identity of the board.

    name, version: of the firmware.
    protocol: number of its protocol.
    min_us, max_us: hard limits of the pulses, us.
    slew_us_per_s: hard limit of the slew rate, us/s.
    watchdog_s: silence after which the board levels the plate, s."""

    name: str
    protocol: int
    version: str
    min_us: float
    max_us: float
    slew_us_per_s: float
    watchdog_s: float


@dataclass(frozen=True)
class TiltReport:
    """One report of the board. About a hundred come each second.

    time_s: middle of the conversions, by the board's clock, s; never decreases.
    counts: mean of each of the two channels, 0 to 1023.
    sequence: number of the last accepted command; 0: none.
    pulses_us: present pulses of beta and gamma, us.
    flags: state of the board.
    strikes: how often the board's watchdog has struck since the board's start.
    bad_frames: frames that the board could not read.
    received_s: when the report arrived, monotonic clock of the host, s."""

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


def tenths(pulse_us: float) -> int:
    """Pulse in tenths of a microsecond."""
    return round(10 * pulse_us)


def wire_number(sequence: int) -> int:
    """The number on the line, 1 to 65535, of a sequence number from 1 on."""
    return 1 + (sequence - 1) % SEQUENCES


def unwrapped(wire: int, newest: int) -> int:
    """The newest sequence number, up to `newest`, that has the number `wire` on the line; 0: there is none."""
    if wire == 0 or newest < 1:
        return 0
    return max(newest - (wire_number(newest) - wire) % SEQUENCES, 0)


def identify(wire: int) -> bytes:
    """Frame that asks for the identity."""
    return encode("I", wire)


def set_limits(wire: int, axis: int, limits: AxisLimits) -> bytes:
    """Frame that sets the limits of one axis."""
    return encode("L", wire, axis, *limits.on_the_line())


def command(wire: int, beta_us: float, gamma_us: float) -> bytes:
    """Frame that commands both pulses."""
    return encode("C", wire, tenths(beta_us), tenths(gamma_us))


def level(wire: int) -> bytes:
    """Frame that orders the board to level the plate now."""
    return encode("Z", wire)


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


def read_limits(frame: Frame) -> tuple[int, tuple[int, tuple[int, ...]]]:
    """(number of the request, (axis, accepted limits as `AxisLimits.on_the_line`)). Raises ValueError."""
    wire, axis, *values = frame.numbers(6)
    return wire, (axis, tuple(values))


RESTART = 20_000  # tenths of a ms; if both clocks differ by more between two reports, the board has restarted


class BoardClock:
    """Continuous time of the board: removes the wraps of its counter (every 119 h) and the steps at its restarts.

    Over a restart the time advances by the host's clock."""

    def __init__(self) -> None:
        self._raw: int | None = None
        self._offset = 0  # continuous time minus raw time, tenths of a ms
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
    """A report. Raises ValueError for another frame.

    newest: sequence number of the command sent last.
    clock: makes the board's time continuous.
    received_s: when the report arrived, monotonic clock of the host, s."""
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
