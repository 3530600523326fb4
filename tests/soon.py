"""Waiting for what another thread or process does: by the condition, not by the clock."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic, sleep


def soon(condition: Callable[[], object], within_s: float = 30.0) -> bool:
    """Whether it comes true in time; asked again and again."""
    until = monotonic() + within_s
    while not condition():
        if monotonic() > until:
            return False
        sleep(0.02)
    return True
