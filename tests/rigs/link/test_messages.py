"""What goes over the line, as records."""

from __future__ import annotations

import pytest

from mazeplan.rigs.link import messages
from mazeplan.rigs.link.frames import Frame
from mazeplan.rigs.link.messages import AxisLimits, BoardClock, Flag, unwrapped, wire_number


def test_sequence_numbers_survive_the_wrap_of_the_line():
    for newest in (1, 2, 65534, 65535, 65536, 65537, 131070, 131071, 10**6):
        for behind in range(min(newest, 300)):
            assert unwrapped(wire_number(newest - behind), newest) == newest - behind
    assert {wire_number(n) for n in range(1, 70000)} == set(range(1, 65536))
    assert unwrapped(0, 5) == 0
    assert unwrapped(7, 0) == 0
    assert unwrapped(9, 5) == 0  # of somebody who commanded before us


def test_the_boards_time_goes_over_its_wrap():
    clock, late = BoardClock(), 2**32 - 50
    assert clock.seconds(late, 10.0) == late / 1e4
    assert clock.seconds(50, 10.01) == (2**32 + 50) / 1e4


def test_the_boards_time_goes_on_over_a_restart():
    clock = BoardClock()
    assert clock.seconds(500_000, 10.0) == 50.0
    assert clock.seconds(100, 11.5) == pytest.approx(51.5)
    assert clock.seconds(200, 11.51) == pytest.approx(51.51)
    assert clock.seconds(90, 11.511) > 51.51  # never back
    far = BoardClock()
    far.seconds(3_000_000_000, 10.0)
    assert far.seconds(100, 12.0) == pytest.approx(300_002.0)  # and not 36 h on, as a wrap would be


def test_the_host_clamps_what_it_commands():
    limits = AxisLimits(1200, 1800, 1490, 5000)
    assert [limits.clamp(x) for x in (1000, 1500.3, 9000, float("-inf"))] == [1200, 1500.3, 1800, 1490]
    assert limits.clamp(float("nan")) == 1490


def test_a_report_in_units_of_the_world():
    frame = Frame("T", ("3", "12345", "32768", "100", "15003", "14000", "20", "2", "1"))
    got = messages.read_report(frame, 65538, BoardClock(), 5.0)
    assert got == messages.TiltReport(
        1.2345, (512.0, 100 / 64), 65538, (1500.3, 1400.0), Flag.LEVEL | Flag.MOVING, 2, 1, 5.0
    )
