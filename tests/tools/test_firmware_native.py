"""What the firmware does with what it is told, compiled for this machine: limits, slew rate, watchdog."""

from __future__ import annotations

import re

from native_firmware import Native, native

__all__ = ["native"]

LIMITS = ("m L,1,0,12000,18000,15000,5000", "m L,2,1,12000,18000,14800,5000")  # 100 us in 20 ms
NONE, LIMITS_SET, FIELDS, RANGE, UNSET = 0, 2, 4, 5, 6  # answers in control.h
WATCHDOG, UNSET_FLAG, LEVEL, CLAMPED, MOVING = 1, 2, 4, 8, 16


def state(line):
    """{word: number}, and the pulses in tenths of a us."""
    found = re.search(r"(\w+) (\d+) now (\d+) (\d+) flags (\d+) strikes (\d+) accepted (\d+)$", line)
    assert found, line
    word, number, beta, gamma, flags, strikes, accepted = found.groups()
    return {
        word: int(number), "now": (int(beta), int(gamma)), "flags": int(flags), "strikes": int(strikes),
        "accepted": int(accepted),
    }  # fmt: skip


def last(native, *orders):
    return state(native.control(*orders)[-1])


def test_it_begins_level_and_takes_no_command_without_limits(native: Native):
    got = last(native, "m C,1,16000,16000")
    assert got == {"answer": UNSET, "now": (15000, 15000), "flags": UNSET_FLAG | LEVEL, "strikes": 0, "accepted": 0}
    assert last(native, LIMITS[0], "m C,1,16000,16000")["answer"] == UNSET  # those of one axis are not enough
    assert last(native, *LIMITS)["now"] == (15000, 14800)


def test_the_slew_rate_limits_each_pulse_and_not_levelling(native: Native):
    slow = "m L,1,0,12000,18000,15000,500"  # 10 us in 20 ms
    steps = [state(line) for line in native.control(slow, LIMITS[1], "m C,3,15350,14800", *["p 1"] * 5, "m Z,4")[3:]]
    assert [step["now"][0] for step in steps] == [15100, 15200, 15300, 15350, 15350, 15000]
    assert [step["flags"] for step in steps] == [MOVING, MOVING, MOVING, 0, 0, LEVEL]


def test_commands_are_clamped_and_say_so(native: Native):
    assert last(native, *LIMITS, "m C,3,11999,18001", "p 99")["now"] == (12000, 18000)
    assert last(native, *LIMITS, "m C,3,11999,18000")["flags"] == CLAMPED
    assert last(native, *LIMITS, "m C,3,11999,18000", "m C,4,12000,18000")["flags"] == 0


def test_no_limits_are_wider_than_the_hard_ones(native: Native):
    wide = [f"m L,1,{axis},1,65535,15000,65535" for axis in (0, 1)]
    assert last(native, *wide, "m C,3,1,65535", "p 999")["now"] == (8000, 22000)
    one = last(native, *wide, "m C,3,22000,15000", "p 1")["now"][0]
    assert one == 15000 + 4000  # 20 000 us/s


def test_the_watchdog_levels_after_200_ms(native: Native):
    moved = [*LIMITS, "m C,7,15500,15000", "p 9"]
    assert last(native, *moved, "t 39")["now"] == (15500, 15000)
    struck = last(native, *moved, "t 40")
    assert struck == {"struck": 1, "now": (15000, 14800), "flags": WATCHDOG | LEVEL, "strikes": 1, "accepted": 7}
    assert last(native, *moved, "t 39", "m C,8,15500,15000", "t 39")["now"] == (15500, 15000)
    # what is no command does not keep it quiet
    assert last(native, *moved, "t 39", "m I,8", LIMITS[0], "m C,9", "t 1")["strikes"] == 1
    # and it strikes once, and again only after a command
    assert last(native, *moved, "t 400")["strikes"] == 1
    again = last(native, *moved, "t 40", "m C,8,15400,15000", "p 1")
    assert again["flags"] == 0
    assert again["now"] == (15400, 15000)
    assert last(native, *moved, "t 40", "m C,8,15400,15000", "t 40")["strikes"] == 2
