"""The firmware in simavr, over a serial port: what comes out of its pins, and what it does when things go wrong.

Wall time is judged loosely here; the figures are in BENCHMARKS.md.
"""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from emulated_chip import chip

from mazeplan.core.errors import RigError
from mazeplan.rigs.link.board import Board, Timeouts
from mazeplan.rigs.link.protocol import AxisLimits, Flag, encode

__all__ = ["chip"]

BETA, GAMMA = AxisLimits(1100, 1900, 1480, 20000), AxisLimits(1000, 2000, 1530, 20000)
LIMITS = (BETA, GAMMA)
LEVEL = (BETA.level_us, GAMMA.level_us)
QUICK = Timeouts(silence_s=1.0)

COMMANDER = """
import sys, time
from mazeplan.rigs.link.board import Board
from mazeplan.rigs.link.protocol import AxisLimits
board = Board(sys.argv[1], (AxisLimits(1100, 1900, 1480, 20000), AxisLimits(1000, 2000, 1530, 20000)))
board.open()
while True:
    board.command(1700.0, 1300.0)
    time.sleep(1 / 30)
"""


def hold(board, beta, gamma, seconds):
    """Command the same for a while; the last report."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        board.command(beta, gamma)
        time.sleep(0.03)
    return board.latest()


def command_until(board, true):
    """Command what is not level until this is so, or fail."""
    end = time.monotonic() + 5
    while not true():
        assert time.monotonic() < end
        board.command(1700, 1300)
        time.sleep(0.02)


def reach(chip, board, beta, gamma):
    """Command until both pulses are there, or fail."""
    for _ in range(60):
        board.command(beta, gamma)
        if chip.wait_for(beta, gamma, 0.05) is not None:
            return
    raise AssertionError(f"wanted {beta}, {gamma}, got {chip.pulses()}")


def test_before_anybody_speaks_both_pulses_are_in_the_middle(chip):
    assert chip.pulses()[:2] == pytest.approx((1500.0, 1500.0), abs=1.0)


def test_the_pulse_on_the_pin_is_the_commanded_one(chip):
    with Board(chip.port, LIMITS, QUICK) as board:
        assert chip.wait_for(*LEVEL, 2.0, within_us=0.6) is not None
        for beta, gamma in ((1100, 2000), (1333.5, 1777), (1500.5, 1499.5), (1900, 1000)):
            reach(chip, board, beta, gamma)
            got = chip.pulses()
            assert got[:2] == pytest.approx((beta, gamma), abs=0.4)  # whole steps of the timer
            assert hold(board, beta, gamma, 0.1).pulses_us == pytest.approx((beta, gamma), abs=0.06)


def test_the_slew_rate_is_kept_and_levelling_does_not_wait_for_it(chip):
    slow = (AxisLimits(1100, 1900, 1480, 1000), GAMMA)  # 20 us a pulse
    with Board(chip.port, slow, QUICK) as board:
        chip.wait_for(*LEVEL, 2.0)
        before = len(chip.history)
        reach(chip, board, 1680, 1530)
        widths = [pulse.width_us for pulse in chip.history[before:] if pulse.axis == 0]
        steps = np.diff([1480.0, *widths])
        assert np.all(steps <= 20.6)
        assert len([step for step in steps if step > 19]) >= 9
        before = len(chip.history)
        board.level()
        assert chip.wait_for(*LEVEL, 1.0) is not None
        assert len([pulse for pulse in chip.history[before:] if pulse.axis == 0]) <= 3


def test_volts_become_counts_with_a_stamp(chip):
    chip.set_volts(2.0, 3.0)
    with Board(chip.port, LIMITS, QUICK) as board:
        chip.set_noise(0.01)
        hold(board, *LEVEL, 0.2)
        reports = [board.wait_newer(board.latest(), 1.0) for _ in range(20)]
        means = np.mean([report.counts for report in reports], axis=0)
        assert means == pytest.approx((2.0 / 5 * 1023, 3.0 / 5 * 1023), abs=1.0)
        assert 0 < np.std([report.counts[0] for report in reports]) < 2
        times = [report.time_s for report in reports]
        assert all(late - early > 0.004 for early, late in itertools.pairwise(times))
        hold(board, *LEVEL, 0.5)
        times = [report.time_s for report in board.recent()]
        assert min(np.diff(times)) < 0.008  # a command is confirmed by the next sample, and not after 10 ms
        chip.set_volts(3.0, 2.0)
        reached = pytest.approx((613, 409), abs=4)
        latest = (board.wait_newer(board.latest(), 1.0).counts for _ in range(100))
        assert any(counts == reached for counts in latest)


def test_a_killed_host_leaves_a_level_plate(chip):
    process = subprocess.Popen([sys.executable, "-c", COMMANDER, chip.port])
    try:
        assert chip.wait_for(1700, 1300, 20.0) is not None
        hold_on = time.monotonic() + 0.5
        while time.monotonic() < hold_on:  # it goes on for as long as somebody commands
            assert chip.pulses()[:2] == pytest.approx((1700, 1300), abs=1)
            time.sleep(0.02)
    finally:
        process.send_signal(signal.SIGKILL)
        killed = time.monotonic()
        process.wait()
    level = chip.wait_for(*LEVEL, 2.0)
    assert level is not None
    assert level - killed < 0.5  # 0.25 s, and what a busy machine adds


def test_the_watchdog_strikes_says_so_and_the_next_command_goes_on(chip):
    with Board(chip.port, LIMITS, QUICK) as board:
        reach(chip, board, 1700, 1300)
        assert chip.wait_for(*LEVEL, 2.0) is not None
        time.sleep(0.1)
        report = board.latest()
        assert report.flags == Flag.WATCHDOG | Flag.LEVEL
        assert report.strikes >= 1
        reach(chip, board, 1650, 1350)
        assert hold(board, 1650, 1350, 0.2).flags == Flag(0)


def test_limits_wider_than_the_hard_ones_are_refused_and_raw_frames_do_not_get_past_them(chip):
    wide = Board(chip.port, (AxisLimits(500, 2500, 1500, 20000), GAMMA), QUICK)
    with pytest.raises(
        RigError, match="got limits 500 to 2500 us, 20000 us/s for beta, the firmware allows 800 to 2200"
    ):
        wide.open()
    raw = os.open(chip.port, os.O_RDWR | os.O_NOCTTY)
    for axis in (0, 1):
        os.write(raw, encode("L", 1, axis, 1, 65535, 15000, 65535))
    for _ in range(20):
        os.write(raw, encode("C", 1, 65535, 1))
        time.sleep(0.02)
    assert chip.pulses()[:2] == pytest.approx((2200, 800), abs=1)
    os.close(raw)


def test_a_chip_that_hangs_is_restarted_by_its_own_watchdog_with_the_plate_level(chip):
    with Board(chip.port, LIMITS, QUICK) as board:
        reach(chip, board, 1700, 1300)
        before = len(chip.history)
        chip.order("stall")
        command_until(board, lambda: chip.resets and Flag.UNSET not in board.latest().flags)
        first = [pulse for pulse in chip.history[before:] if pulse.width_us > 0][:2]
        assert [pulse.width_us for pulse in first] == pytest.approx(LEVEL, abs=1)  # the host's level, not the middle
