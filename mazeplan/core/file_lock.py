"""A lock on an open file, for one process at a time. The system releases it when the process ends in any way."""

from __future__ import annotations

from typing import IO, Any


def lock(file: IO[Any]) -> bool:
    """Lock an open file until it is closed. False: another process holds the lock."""
    try:
        import fcntl
    except ImportError:  # not on this system: no lock
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
