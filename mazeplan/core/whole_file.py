"""Files that appear under their name only when they are whole."""

from __future__ import annotations

import errno
import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

WRITABLE = stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH


def is_stream(path: str | Path) -> bool:
    """Whether it is a device or a pipe, such as /dev/null, or /dev/stdout wherever that leads."""
    if in_dev(path):
        return True
    return os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path))


def in_dev(path: str | Path) -> bool:
    """Whether it is a name of the system's, such as /dev/stdout or /dev/fd/3."""
    return Path(path).absolute().parent in (Path("/dev"), Path("/dev/fd"))


def read_only(path: str | Path) -> bool:
    """Whether a file or folder is there that nobody may write to, or this user may not."""
    try:
        return not (os.stat(path).st_mode & WRITABLE and os.access(path, os.W_OK))
    except OSError:
        return False


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """A file beside `path` to write; it takes the name when the block ends well, and is removed when it fails.

    It has the same ending. A link stays a link: the file that it names is replaced. A device or a pipe is written as it
    is. The folder must be there. A file that is read-only stays. Raises OSError, of `path`."""
    if is_stream(path):
        yield Path(path)
        return
    target = Path(os.path.realpath(path))
    if read_only(target):
        raise PermissionError(errno.EACCES, "the file is read-only", str(path))
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
