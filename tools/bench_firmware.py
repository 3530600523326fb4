"""Figures of the board: the real firmware in simavr, over a pseudo terminal, in real time; and the line protocol under
whatever may come. Needs what `make emulator` needs. Part of tools/bench.py.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mazeplan.rigs.emulation.chip import EmulatedChip, built
from mazeplan.rigs.link.board import Board
from mazeplan.rigs.link.frames import Frame, FrameReader, encode
from mazeplan.rigs.link.messages import AxisLimits, ServoLimits

ROOT = Path(__file__).resolve().parent.parent
AXIS = AxisLimits(min_us=900, max_us=2100, level_us=1480, slew_us_per_s=20000)
LIMITS = ServoLimits(AXIS, AXIS)
HARD = (800.0, 2200.0)  # us, control.h
RATES = (30.0, 60.0, 100.0)  # commands a second
COMMANDER = """
import sys, time
from mazeplan.rigs.link.board import Board
from mazeplan.rigs.link.messages import AxisLimits, ServoLimits
axis = AxisLimits(900, 2100, 1480, 20000)
board = Board(sys.argv[1], ServoLimits(axis, axis))
board.open()
while True:
    board.command(1700.0, 1300.0)
    time.sleep(1 / 30)
"""


@contextlib.contextmanager
def in_time() -> Iterator[str]:
    """Before other work on this machine, where that is allowed; in words, for the table."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(5))
    except (AttributeError, OSError):  # not on this system, or not for us
        yield "as other programs"
        return
    try:
        yield "with real-time priority, as real machines have it"
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def round_trips(count: int, rate_hz: float, seed: int) -> tuple[np.ndarray, int]:
    """Times from a command to the tilt report that acknowledges it, s, and how many were lost."""
    rng = np.random.default_rng(seed)
    took, lost = [], 0
    with EmulatedChip(*built()) as chip, Board(chip.port, LIMITS) as board:
        chip.set_volts(2.5, 2.5)
        chip.set_noise(0.005)
        due = time.monotonic()
        for _ in range(count):
            beta, gamma = rng.uniform(1300, 1700, 2)
            began = time.monotonic()
            report = board.wait_confirmed(board.command(beta, gamma), 0.5)
            if report is None:
                lost += 1
            else:
                took.append(report.received_s - began)
            # not in step with the board's own 5 ms
            due = max(due + 1 / rate_hz, time.monotonic()) + rng.uniform(0, 0.005)
            time.sleep(max(0.0, due - time.monotonic()))
    return np.array(took), lost


def pulse_errors(steps: int) -> np.ndarray:
    """Pulse on the pin minus the commanded one, us, over the whole range of both axes."""
    errors = []
    with EmulatedChip(*built()) as chip, Board(chip.port, LIMITS) as board:
        for beta in np.linspace(AXIS.min_us, AXIS.max_us, steps):
            gamma = AXIS.min_us + AXIS.max_us - beta
            for _ in range(8):  # as long as the slew rate needs, and a pulse more
                board.command(beta, gamma)
                time.sleep(0.02)
            got = chip.pulses()
            errors += [got[0] - beta, got[1] - gamma]
    return np.array(errors)


def times_to_level(times: int, seed: int) -> np.ndarray:
    """From kill -9 of a process that commands at 30 Hz to level on both pins, s."""
    rng, took = np.random.default_rng(seed), []
    with EmulatedChip(*built()) as chip:
        for _ in range(times):
            process = subprocess.Popen([sys.executable, "-c", COMMANDER, chip.port], cwd=ROOT)
            if chip.wait_for(1700, 1300, 20.0) is None:
                raise SystemExit("the process that commands does not start")
            time.sleep(rng.uniform(0.2, 0.3))
            process.kill()
            killed = time.monotonic()
            level = chip.wait_for(AXIS.level_us, AXIS.level_us, 2.0)
            took.append(np.inf if level is None else level - killed)
            process.wait()
    return np.array(took)


def random_frame(rng: np.random.Generator) -> bytearray:
    """One that the board may obey, or with anything in it."""
    draw = rng.random()
    if draw < 0.3:
        return bytearray(encode("C", *rng.integers(1, 1 << 16, 3).tolist()))
    if draw < 0.4:
        low, level, high = sorted(rng.integers(0, 1 << 16, 3).tolist())
        return bytearray(encode("L", 1, int(rng.integers(2)), low, high, level, int(rng.integers(1, 1 << 16))))
    return bytearray(encode("CCLZIQ"[rng.integers(6)], *rng.integers(0, 1 << 17, rng.integers(0, 8)).tolist()))


def hostile(rng: np.random.Generator, size: int) -> bytes:
    """Noise, frames with random contents, and damaged ones."""
    stream = bytearray()
    while len(stream) < size:
        if rng.random() < 0.3:
            stream += rng.integers(0, 256, rng.integers(1, 80), dtype=np.uint8).tobytes()
        frame = random_frame(rng)
        if rng.random() < 0.3:
            frame[rng.integers(len(frame))] = rng.integers(256)
        stream += frame if rng.random() < 0.9 else frame[: rng.integers(len(frame))]
    return bytes(stream[:size])


def fuzzed_chip(size: int, seed: int) -> dict[str, float]:
    """What the firmware does under `size` hostile bytes at full speed of the line."""
    rng, sent = np.random.default_rng(seed), 0
    with EmulatedChip(*built()) as chip:
        chip.pulses()
        chip.order("fast 1")
        raw = os.open(chip.port, os.O_RDWR | os.O_NOCTTY)
        os.set_blocking(raw, False)
        answers, reader = 0, FrameReader()
        while sent < size:
            piece = hostile(rng, min(2000, size - sent))
            while piece:
                try:
                    piece = piece[os.write(raw, piece) :]
                except BlockingIOError:
                    time.sleep(0.001)
                with contextlib.suppress(BlockingIOError):
                    answers += len(reader.feed(os.read(raw, 65536)))
            sent += 2000
        time.sleep(0.5)
        chip.order("fast 0")
        os.close(raw)
        widths = [pulse.width_us for pulse in chip.history]
        with Board(chip.port, LIMITS) as board:
            board.command(1700, 1300)
            answered = chip.wait_for(1700, 1300, 1.0) is not None or board.wait_confirmed(1, 1.0) is not None
    return {
        "answers": answers, "pulses": len(widths), "low": min(widths), "high": max(widths), "resets": chip.resets,
        "answered": answered,
    }  # fmt: skip


def fuzzed_host(count: int, seed: int) -> tuple[int, int]:
    """Frames of the board's kinds with random contents through the host's end; good and bad ones. Raises nothing."""
    rng = np.random.default_rng(seed)
    board, reader, good = Board("nowhere", LIMITS), FrameReader(), 0
    for _ in range(count):
        fields = rng.integers(0, 1 << rng.integers(1, 34), rng.integers(0, 11)).tolist()
        if rng.random() < 0.2:
            fields = [*fields[:2], "WATCHDOG", *fields[2:]]
        try:
            frame = bytearray(encode("TTTTILEN?"[rng.integers(9)], *fields))
        except ValueError:  # too long for a frame
            continue
        if rng.random() < 0.2:
            frame[rng.integers(len(frame))] = rng.integers(256)
        for found in reader.feed(bytes(frame)):
            good += board._take(found)
    assert isinstance(reader.feed(encode("Z", 1))[-1], Frame)
    return good, reader.bad + board.counts.bad_frames


def native_fuzz(size: int) -> str:
    """What the firmware's parser and control say after `size` hostile bytes, with sanitizers, or how they failed."""
    folder = ROOT / "build" / "native"
    subprocess.run(["make", "-s", "-C", ROOT / "tools" / "firmware", f"OUT={folder}", "native"], check=True)
    done = subprocess.run([folder / "native", "fuzz", "1", str(size)], capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else f"FAILED: {done.stderr.strip()}"


def firmware_section(quick: bool) -> list[str]:
    """Table of all of it."""
    subprocess.run(["make", "-s", "emulator"], cwd=ROOT, check=True)
    few = quick
    with in_time() as how:
        timed = timed_rows(few)
    rows = [
        "## The board: firmware in simavr, over a serial port",
        "",
        "The firmware that goes onto the board runs on a simulated ATmega2560 in real time, its serial line is a pseudo"
        " terminal,",
        "and pulses are measured on the simulated pins. `python tools/bench.py --only firmware`. What is timed ran"
        f" {how}; {os.getloadavg()[1]:.1f}",
        "programs wanted the processor meanwhile.",
        "",
        "| what | asked | got |",
        "|---|---|---|",
        *timed,
    ]
    size = 50_000 if few else 1_000_000
    got = fuzzed_chip(size, 0)
    rows.append(
        f"| {size} hostile bytes into the firmware at full speed | no hang, answers, pulses in {HARD[0]:g} to"
        f" {HARD[1]:g} us | {'answers' if got['answered'] else 'SILENT'}, {got['resets']} resets, {got['answers']}"
        f" frames came, {got['pulses']} changes of pulses from {got['low']:.1f} to {got['high']:.1f} us |"
    )
    print(rows[-1], file=sys.stderr)
    count = 10_000 if few else 100_000
    good, bad = fuzzed_host(count, 0)
    rows.append(
        f"| {count} frames with random contents into the host | no exception | {good} reports, {bad} bad ones |"
    )
    size = 10**6 if few else 10**8
    rows.append(
        f"| {size:.0e} hostile bytes through the firmware's parser and control, with sanitizers | no finding |"
        f" {native_fuzz(size)} |"
    )
    return rows


def timed_rows(few: bool) -> list[str]:
    """Those that other work on the machine would spoil."""
    rows = []
    for rate in RATES:
        took, lost = round_trips(100 if few else 2000, rate, 0)
        p50, p99, worst = 1e3 * np.percentile(took, [50, 99, 100])
        rows.append(
            f"| command to the tilt report that acknowledges it, {len(took)} at {rate:g} Hz | p99 < 20 ms |"
            f" p50 {p50:.1f}, p99 {p99:.1f}, worst {worst:.1f} ms, {lost} lost |"
        )
        print(rows[-1], file=sys.stderr)
    errors = np.abs(pulse_errors(14 if few else 122))
    rows.append(
        f"| pulse on the pin against the commanded one, {len(errors)} over {AXIS.min_us:g} to {AXIS.max_us:g} us |"
        f" within 2 us | worst {errors.max():.2f}, mean {errors.mean():.2f} us |"
    )
    took = times_to_level(3 if few else 30, 0)
    rows.append(
        f"| kill -9 of the process that commands, {len(took)} times, to level on both pins | 250 ms |"
        f" worst {1e3 * took.max():.0f}, mean {1e3 * took.mean():.0f} ms |"
    )
    print(rows[-1], file=sys.stderr)
    return rows
