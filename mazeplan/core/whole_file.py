"""Files that appear under their name only when they are whole."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


def is_stream(path: str | Path) -> bool:
    """Whether it is a device or a pipe, such as /dev/null, or /dev/stdout wherever that leads."""
    if Path(path).absolute().parent in (Path("/dev"), Path("/dev/fd")):
        return True
    return os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path))


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """A file beside `path` to write; it takes the name when the block ends well, and is removed when it fails.

    It has the same ending. A link stays a link: the file that it names is replaced. A device or a pipe is written as it
    is. The folder must be there. Raises OSError, of `path`."""
    if is_stream(path):
        yield Path(path)
        return
    target = Path(os.path.realpath(path))
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
