"""The emulated board: the real firmware on a simulated ATmega2560 with a serial port (tools/emulator).

chip = EmulatedChip(*built())
board = Board(chip.port, limits)
chip.set_volts(2.5, 2.4)        # at the two tilt inputs
chip.pulses()                   # at the servo pins
"""

from __future__ import annotations

import contextlib
import os
import select
import shutil
import signal
import subprocess
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mazeplan.core.errors import RigError

START_S, END_S, ORDER_S = 5.0, 1.0, 1.0  # time limits, s: of the start, of the end, of an order
DEBIAN = ("gcc-avr", "avr-libc", "simavr", "libsimavr-dev", "libelf-dev")
BUILD = Path(__file__).resolve().parents[2] / "build"  # where `make emulator` puts its files
HEADER = Path("/usr/include/simavr/sim_avr.h")  # on Debian
KEPT = 100_000  # number of changes that are kept: more than half an hour at 50 Hz


@dataclass(frozen=True)
class Pulse:
    """A servo pulse.

    axis: 0 (beta) or 1 (gamma).
    width_us: width, us; 0: no pulse for 50 ms.
    when: end of the pulse, monotonic clock of the host, s."""

    axis: int
    width_us: float
    when: float


def paths(folder: Path | None = None) -> tuple[Path, Path]:
    """Paths of emulator and firmware, as `make emulator` builds them."""
    folder = folder or BUILD
    return folder / "emulator" / "emulator", folder / "firmware" / "mazeplan.elf"


def new_folder() -> Path:
    """A new folder for the files of a chip."""
    return Path(tempfile.mkdtemp(prefix="mazeplan-chip-"))


def built(folder: Path | None = None) -> tuple[Path, Path]:
    """Paths of emulator and firmware. Raises RigError if they are not built."""
    host, firmware = paths(folder)
    for path in (host, firmware):
        if not path.is_file():
            raise RigError(
                f"{path}: is not built; in a checkout: sudo apt-get install {' '.join(DEBIAN)}; make emulator"
            )
    return host, firmware


def how_it_ended(process: subprocess.Popen[Any]) -> str:
    """How a process ended, in words, such as "ended by SIGKILL"; "is silent" if it still runs."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        code = process.wait(END_S)
        return f"ended by {signal.Signals(-code).name}" if code < 0 else f"ended with exit status {code}"
    return "is silent"


class EmulatedChip:
    """Starts the emulator, with the firmware. Raises RigError if it does not start.

    folder: existing folder for the emulator's files, by default a new one; `close` removes it.
    apart: start the emulator in its own process group."""

    def __init__(
        self, host: str | Path, firmware: str | Path, folder: Path | None = None, *, apart: bool = True
    ) -> None:
        self._folder = folder or new_folder()
        self.port = str(self._folder / "port")
        self._changed = threading.Condition()
        self._now: list[Pulse | None] = [None, None]
        self.history: list[Pulse] = []  # every change, oldest first
        self.resets = 0
        self._zero = 0.0  # monotonic clock, s, when the chip's time was 0
        self._ready = self._ended = False
        complaints = self._folder / "complaints"
        try:
            with complaints.open("w") as stderr:
                self._process = subprocess.Popen(
                    [str(host), str(firmware), self.port],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=stderr,
                    text=True,
                    # Ctrl-C is for the program, which levels the plate first
                    process_group=0 if apart else None,
                )
        except OSError as problem:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise RigError(f"{host}: the emulator does not start: {problem.strerror}; make emulator") from problem
        self._listener = threading.Thread(target=self._listen, name="emulated chip", daemon=True)
        self._listener.start()
        with self._changed:
            self._changed.wait_for(lambda: self._ready or self._ended, START_S)
        if not self._ready:
            said = " ".join(complaints.read_text().split())
            self.close()
            raise RigError(f"{host}: the emulator does not start: {said or 'it says nothing'}; make emulator")

    @property
    def process_id(self) -> int:
        """Of the emulator."""
        return self._process.pid

    def set_volts(self, first: float, second: float) -> None:
        """Voltages at the tilt inputs, 0 to 5 V."""
        self.order(f"adc {first:.6f} {second:.6f}")

    def set_noise(self, deviation_v: float) -> None:
        """Standard deviation of the noise of each conversion, V."""
        self.order(f"noise {deviation_v:.6f}")

    def order(self, line: str) -> None:
        """Send an order to the emulator (tools/emulator/host.c): reset, stall, unplug, plug, hold, release, errors P
        ...

        Raises RigError if the emulator has ended, or hangs."""
        try:
            assert self._process.stdin is not None
            pipe = self._process.stdin.fileno()
            if not select.select([], [pipe], [], ORDER_S)[1]:  # else there is room for a line
                raise RigError(f"the emulated board hangs: it took no order for {ORDER_S:g} s")
            os.write(pipe, f"{line}\n".encode())
        except (OSError, ValueError) as problem:
            raise RigError(f"the emulated board {how_it_ended(self._process)}") from problem

    def pulses(self) -> tuple[float, float, float]:
        """Present pulse widths on both pins, us (0: no pulses), and the end of the newest pulse.

        The time is by the monotonic clock of the host, s. Raises RigError if no pulses come."""
        with self._changed:
            self._changed.wait_for(lambda: None not in self._now or self._ended, START_S)
            first, second = self._now
        if first is None or second is None:
            raise RigError(f"{self.port}: no pulses came from the emulated board")
        return first.width_us, second.width_us, max(first.when, second.when)

    def wait_for(self, beta_us: float, gamma_us: float, timeout_s: float, within_us: float = 2.0) -> float | None:
        """Wait until both pulses have these widths.

        Returns the end of the newer pulse (monotonic clock, s), or None after the timeout."""

        def reached() -> bool:
            return all(
                pulse is not None and abs(pulse.width_us - wanted) <= within_us
                for pulse, wanted in zip(self._now, (beta_us, gamma_us), strict=True)
            )

        with self._changed:
            if not self._changed.wait_for(reached, timeout_s):
                return None
            return max(pulse.when for pulse in self._now if pulse is not None)

    def close(self) -> None:
        """End the emulator, even if it hangs. A second call does nothing."""
        with contextlib.suppress(OSError, ValueError):
            if self._process.stdin is not None:
                self._process.stdin.close()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._listener.join(END_S)
        if self._process.stdout is not None:
            self._process.stdout.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def __enter__(self) -> EmulatedChip:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            word, *values = line.split()
            with self._changed:
                if word == "ready":
                    self._ready = True
                elif word == "clock":
                    self._zero = float(values[0]) - 1e-6 * float(values[1])
                elif word == "pulse":
                    self._pulse(int(values[0]), float(values[1]), float(values[2]))
                elif word == "silent":
                    self._pulse(int(values[0]), 0.0, float(values[1]))
                elif word == "reset":
                    self.resets += 1
                self._changed.notify_all()
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def _pulse(self, axis: int, width_us: float, t_us: float) -> None:
        pulse = Pulse(axis, width_us, self._zero + 1e-6 * t_us)
        self._now[axis] = pulse
        self.history.append(pulse)
        if len(self.history) > KEPT:
            del self.history[: KEPT // 2]
