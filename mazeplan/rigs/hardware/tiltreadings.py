"""Takes the readings for `tiltcalibration`: moves the plate over a grid and asks for the clinometer's value.

The board levels the plate after 200 ms without a command. So a thread repeats the current pulses while a person reads
the clinometer and types.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic, sleep

import numpy as np

from mazeplan.core.errors import RigError
from mazeplan.rigs.hardware.clocks import SILENT_S
from mazeplan.rigs.hardware.settings import Servo
from mazeplan.rigs.hardware.tiltcalibration import Reading
from mazeplan.rigs.link.board import Board

AGAIN_S = 0.05  # s between commands
SETTLE_S, AVERAGE_S = 0.8, 0.4  # s: wait for the plate to settle; average of the voltages
REACH = 1.15  # the grid goes to this many times the tilt limit: a polynomial is worst at the end of its range
Ask = Callable[[int, tuple[float, float]], tuple[float, float] | None]


def grid(servo: Servo, limit_deg: float, count: int) -> list[tuple[float, float]]:
    """Pulses (beta, gamma), us, for a grid of count x count tilts around level. The rows alternate in direction."""
    steps = np.linspace(-REACH * limit_deg, REACH * limit_deg, count)
    beta, gamma = (
        [min(max(axis.level_us + axis.us_per_deg * float(step), axis.min_us), axis.max_us) for step in steps]
        for axis in (servo.beta, servo.gamma)
    )
    return [(b, g) for i, b in enumerate(beta) for g in (gamma if i % 2 == 0 else gamma[::-1])]


class StopReadings(Exception):  # noqa: N818
    """`ask` raises this to end the readings."""


class PulseHolder:
    """Sends the same pulses again and again, until `end`."""

    def __init__(self, board: Board, pulses: tuple[float, float]) -> None:
        self.board, self.pulses = board, pulses
        self.problem: RigError | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._work, name="mazeplan hold", daemon=True)
        self._thread.start()

    def _work(self) -> None:
        while not self._ended.wait(AGAIN_S):
            try:
                self.board.command(*self.pulses)
            except RigError as problem:
                self.problem = problem
                return

    def end(self) -> None:
        """Stop sending pulses."""
        self._ended.set()
        self._thread.join()


@contextmanager
def hold_pulses(board: Board, pulses: tuple[float, float]) -> Iterator[PulseHolder]:
    """Hold the pulses inside the `with` block; at its end level the plate."""
    holding = PulseHolder(board, pulses)
    try:
        yield holding
    finally:
        holding.end()
        board.level()


def mean_volts(board: Board, over_s: float) -> np.ndarray:
    """Mean of both channels over the last `over_s` seconds, V, (2,). Raises RigError if the board is silent or lost."""
    reports = board.recent()
    if not reports or monotonic() - reports[-1].received_s > SILENT_S:
        raise RigError(f"{board.port}: the board has sent no report for {SILENT_S:g} s; is its cable in?")
    latest = [report.volts for report in reports if report.received_s > reports[-1].received_s - over_s]
    return np.mean(latest, axis=0)


def take_readings(
    board: Board, pulses: list[tuple[float, float]], ask: Ask, keep: Callable[[list[Reading]], None] | None = None
) -> list[Reading]:
    """Take a reading at each pair of pulses. Raises RigError if the board is silent or lost.

    ask(number from 1, pulses): returns beta and gamma by the clinometer, deg, or None to skip these pulses, or raises
      Enough.
    keep: called after each reading, with all readings so far."""
    readings: list[Reading] = []
    with hold_pulses(board, pulses[0]) as holding:
        for number, pair in enumerate(pulses, start=1):
            holding.pulses = pair
            sleep(SETTLE_S + AVERAGE_S)
            first, second = _held_volts(board, holding)
            try:
                tilt = ask(number, pair)
            except StopReadings:
                break
            if tilt is not None:
                _held_volts(board, holding)  # a board that fell silent meanwhile did not hold the plate
                readings.append(Reading((float(first), float(second)), *tilt, number, pair))
                if keep is not None:
                    keep(readings)
    return readings


def _held_volts(board: Board, holding: PulseHolder) -> np.ndarray:
    """Mean voltages of a plate that is held, V, (2,). Raises RigError if the board is silent or lost."""
    if holding.problem is not None:
        raise holding.problem
    return mean_volts(board, AVERAGE_S)
