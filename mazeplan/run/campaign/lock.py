"""A lock on a file, for one process at a time. The system releases it when the process ends in any way."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mazeplan.core.errors import InputError


@contextmanager
def exclusive_lock(path: Path, option: str, what: str) -> Iterator[None]:
    """Hold the lock. Raises InputError if another process holds it, or the folder cannot be written to.

    option, what: for the error: the option that names the folder, and the work that is under way there."""
    try:
        import fcntl
    except ImportError:  # not on this system: no lock
        yield
        return
    try:
        file = path.open("a")
    except OSError as problem:
        raise InputError(f"{option}: {path.parent} cannot be written to: {problem.strerror}") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(f"{option}: {what} is under way in {path.parent} already") from None
        yield
