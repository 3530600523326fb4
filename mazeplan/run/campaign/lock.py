"""A lock on a folder, for one process at a time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mazeplan.core.errors import InputError
from mazeplan.core.whole_file import lock


@contextmanager
def exclusive_lock(path: Path, option: str, what: str) -> Iterator[None]:
    """Hold the lock. Raises InputError if another process holds it, or the folder cannot be written to.

    option, what: for the error: the option that names the folder, and the work that is under way there."""
    try:
        file = path.open("a")
    except OSError as problem:
        raise InputError(f"{option}: {path.parent} cannot be written to: {problem.strerror}") from None
    with file:
        if not lock(file):
            raise InputError(f"{option}: {what} is under way in {path.parent} already")
        yield
