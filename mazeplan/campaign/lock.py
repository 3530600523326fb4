"""One process at a time: a lock on a file, which goes with the process, however that ends."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mazeplan.errors import InputError


@contextmanager
def alone(path: Path, option: str, what: str) -> Iterator[None]:
    """Hold the lock. option: that gave its folder; what: that is under way there, for the words of the InputError that
    is raised where another process holds it, or the folder may not be written to."""
    try:
        import fcntl
    except ImportError:  # not on this system: nobody is kept out
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
