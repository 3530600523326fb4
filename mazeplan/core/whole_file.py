"""Files that appear under their name only when they are whole."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """A file beside `path` to write; it takes the name when the block ends well, and is removed when it fails.

    It has the same ending. A link stays a link: the file that it names is replaced. A device or a pipe is written as it
    is. The folder must be there. Raises OSError, of `path`."""
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        yield target
        return
    beside = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
    try:
        yield beside
        if target.exists():
            shutil.copymode(target, beside)
        os.replace(beside, target)
    except BaseException as problem:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
        if isinstance(problem, OSError) and str(problem.filename) == str(beside):
            problem.filename, problem.filename2 = str(path), None
        raise
