"""A board of a few lines at the other end of a pseudo terminal, which says what a test wants it to say."""

from __future__ import annotations

import contextlib
import os
import tempfile
import threading
import time
import tty
from collections.abc import Callable
from pathlib import Path

from mazeplan.rigs.link.protocol import AxisLimits, Frame, FrameReader, encode

AXIS = AxisLimits(min_us=1200, max_us=1800, level_us=1500, slew_us_per_s=5000)
LIMITS = (AXIS, AXIS)
Answer = Callable[["FakeBoard", Frame], bytes]


def identity(board: FakeBoard, frame: Frame) -> bytes:
    return encode("I", frame.fields[0], "mazeplan", 1, "1.0", 8000, 22000, 20000, 200, 1)


def echo(board: FakeBoard, frame: Frame) -> bytes:
    return encode(frame.kind, *frame.fields)


def accept(board: FakeBoard, frame: Frame) -> bytes:
    board.accepted, board.flags = int(frame.fields[0]), 4 if frame.kind == "Z" else 0
    return b""


def silent(board: FakeBoard, frame: Frame) -> bytes:
    return b""


class FakeBoard:
    """Answers each frame by its letter, and sends reports. answers: other ways than usual; reports: whether they come;
    noise: bytes sent all the time."""

    def __init__(self, *, reports: bool = True, noise: bytes = b"", **answers: Answer) -> None:
        self.answers: dict[str, Answer] = {"I": identity, "L": echo, "C": accept, "Z": accept, **answers}
        self.reports, self.noise = reports, noise
        self.accepted, self.flags, self.got = 0, 4, []
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._folder = tempfile.TemporaryDirectory()  # a name of its own: those of terminals are given out again
        self.port = str(Path(self._folder.name) / "port")
        Path(self.port).symlink_to(os.ttyname(self._slave))
        self._began = time.monotonic()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        reader = FrameReader()
        while not self._stop.is_set():
            try:
                frames = reader.feed(os.read(self._master, 4096))
            except OSError:
                frames = []
            for frame in frames:
                self.got.append(frame)
                self._send(self.answers.get(frame.kind, silent)(self, frame))
            if self.reports:
                self._send(self.report())
            self._send(self.noise)
            time.sleep(0.01)

    def report(self) -> bytes:
        tenths = round(1e4 * (time.monotonic() - self._began))
        return encode("T", self.accepted, tenths, 32768, 32000, 15000, 15000, self.flags, 0, 0)

    def _send(self, data: bytes) -> None:
        with contextlib.suppress(OSError):  # nobody reads
            os.write(self._master, data)

    def unplug(self) -> None:
        self._stop.set()
        self._thread.join()
        if self._master >= 0:
            self._folder.cleanup()
            os.close(self._slave)
            os.close(self._master)
        self._master = self._slave = -1

    def __enter__(self) -> FakeBoard:
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()
