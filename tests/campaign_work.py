"""What worker processes do in tests of campaigns. Imports little: it is imported in each of them."""

from __future__ import annotations

import os
import signal
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


def refuse(x: int) -> int:
    if x == 2:
        raise ValueError("two")
    return x


def wait_long(notes: str, x: int) -> int:
    """Ends at once for 0; else after a minute."""
    time.sleep(60.0 if x else 0.0)
    return x


def mine(x: int) -> tuple[int, int]:
    """x, and in which process, after a while."""
    time.sleep(0.05)
    return x, os.getpid()
