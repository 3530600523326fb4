"""What worker processes do in tests of campaigns. Imports little: it is imported in each of them."""

from __future__ import annotations

import atexit
import os
import signal
import tempfile
import time
from pathlib import Path


def square(x: float) -> float:
    return x * x


def deadly(times: int, notes: str, x: int) -> int:
    """x, but the first `times` tries end their process; each try adds a line to the file."""
    with open(notes, "a", encoding="utf-8") as file:
        file.write(f"{x} {os.getpid()}\n")
    if Path(notes).read_text(encoding="utf-8").count(f"{x} ") <= times:
        os.kill(os.getpid(), signal.SIGKILL)
    return x


def leave_something() -> str:
    """A temporary folder that nobody clears away."""
    return tempfile.mkdtemp()


def end_slowly() -> None:
    """The process needs a while to end."""
    atexit.register(time.sleep, 1.0)


def refuse(x: int) -> int:
    if x == 2:
        raise ValueError("two")
    return x


def wait_long(notes: str, x: int) -> int:
    """Ends at once for 0; else waits for somebody to end it, and writes down that this went in order."""
    if x:
        Path(f"{notes}-begun{x}").touch()
        try:
            time.sleep(60.0)
        finally:
            Path(f"{notes}{x}").touch()
    return x


def mine(x: int) -> tuple[int, int]:
    """x, and in which process, after a while."""
    time.sleep(0.05)
    return x, os.getpid()
