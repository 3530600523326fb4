"""Frames of the line protocol, in Python and in the firmware's C."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from native_firmware import Native, native

from mazeplan.rigs.link.protocol import PROTOCOL, AxisLimits, Flag, Frame, FrameReader, TiltReport, encode, read_report

__all__ = ["native"]

ROOT = Path(__file__).resolve().parents[3]


def read(*pieces):
    reader = FrameReader()
    return [frame for piece in pieces for frame in reader.feed(piece)], reader.bad


def damaged_stream(rng, frames):
    """Frames, whole, cut, with wrong bytes, and noise between them."""
    stream = bytearray()
    for _ in range(frames):
        fields = rng.integers(0, 1 << 17, rng.integers(0, 9)).tolist()
        frame = bytearray(encode("CLZITNEQ"[rng.integers(8)], *fields))
        if rng.random() < 0.3:
            frame[rng.integers(len(frame))] = rng.integers(256)
        if rng.random() < 0.1:
            del frame[rng.integers(len(frame)) :]
        if rng.random() < 0.1:
            frame += bytes(rng.choice(list(b"$*,0A\n\x00\xff"), rng.integers(80)).tolist())
        stream += frame
    return bytes(stream)


@pytest.mark.parametrize("page", ["docs/protocol.md", "mazeplan/rigs/link/protocol.py", "tools/firmware/frame.h"])
def test_frames_that_are_shown_are_frames(page):
    shown = re.findall(r"^ +(\$.*\*[0-9A-F]{4})\\+n$", (ROOT / page).read_text(), re.MULTILINE)
    assert shown
    for text in shown:
        assert len(read(text.encode() + b"\n")[0]) == 1, text


def test_the_page_has_every_message_and_limit():
    page = (ROOT / "docs" / "protocol.md").read_text()
    control, main = ((ROOT / "tools" / "firmware" / name).read_text() for name in ("control.h", "main.c"))
    for letter in "ILCZ":
        assert f"`{letter},n" in page
    for name, unit in (("HARD_MIN", 10), ("HARD_MAX", 10), ("HARD_SLEW", 1), ("MIDDLE", 10), ("WATCHDOG_MS", 1)):
        found = re.search(rf"#define {name} (\d+)", control)
        assert found
        assert re.search(rf"\b{int(found[1]) // unit}\b", page), name
    for name, value in re.findall(r"FLAG_(\w+) = (\d+)", control):
        assert Flag[name] == int(value)
    protocol = re.search(r"#define PROTOCOL (\d+)", main)
    assert protocol
    assert int(protocol[1]) == PROTOCOL


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(0, 2**32 - 1), max_size=5), st.data())
def test_frames_come_out_of_pieces_of_any_size(numbers, data):
    stream = b"".join(encode("C", number) for number in numbers)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=6)))
    pieces = [stream[a:b] for a, b in zip([0, *cuts], [*cuts, len(stream)], strict=True)]
    assert read(*pieces) == ([Frame("C", (str(number),)) for number in numbers], 0)


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=200))
def test_noise_gives_no_frame_and_what_follows_is_read(noise):
    frames, _ = read(noise, encode("C", 1, 2))
    assert frames[-1:] == [Frame("C", ("1", "2"))]


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 16), st.integers(1, 255))
def test_a_wrong_byte_never_passes(at, change):
    frame = bytearray(encode("C", 15000, 14000))
    frame[at] ^= change
    frames, bad = read(bytes(frame), encode("Z", 1))
    assert frames == [Frame("Z", ("1",))]
    assert bad or at == 0  # without its "$" it is no frame at all


def test_the_firmware_reads_the_same_frames(native: Native):
    stream = damaged_stream(np.random.default_rng(0), 3000)
    frames, bad = read(stream)
    bodies, given_up = native.frames(stream)
    assert [",".join((frame.kind, *frame.fields)) for frame in frames] == bodies
    assert (bad - given_up) % 65536 == 0
    assert 1000 < len(bodies) < 2900
    assert bad > 300


def test_the_host_clamps_what_it_commands():
    limits = AxisLimits(1200, 1800, 1490, 5000)
    assert [limits.clamp(x) for x in (1000, 1500.3, 9000, float("-inf"))] == [1200, 1500.3, 1800, 1490]
    assert limits.clamp(float("nan")) == 1490


def test_a_report_in_units_of_the_world():
    frame = Frame("T", ("3", "12345", "32768", "100", "15003", "14000", "20", "2", "1"))
    wanted = TiltReport(1.2345, (512.0, 100 / 64), 3, (1500.3, 1400.0), Flag.LEVEL | Flag.MOVING, 2, 1, 5.0)
    assert read_report(frame, 5.0) == wanted
