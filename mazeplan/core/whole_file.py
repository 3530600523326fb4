"""Files that get their name only when they are complete, folders that a failure does not leave half made, locks.

`end_process` saves open work before a watchdog ends the process: a loop that hangs runs no `finally`."""

from __future__ import annotations

import errno
import os
import shutil
import stat
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, NoReturn
from weakref import WeakSet

from mazeplan.core.errors import InputError

WRITABLE = stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH
SAVE_S = 0.5  # for saving one object; a disk may hang, too
_open: WeakSet[Any] = WeakSet()


def is_stream(path: str | Path) -> bool:
    """Whether a path is a device or a pipe, such as /dev/null; /dev/stdout counts, wherever it leads."""
    return in_dev(path) or (os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path)))


def in_dev(path: str | Path) -> bool:
    """Whether a path is directly in /dev or /dev/fd, such as /dev/stdout or /dev/fd/3."""
    return Path(path).absolute().parent in (Path("/dev"), Path("/dev/fd"))


def read_only(path: str | Path) -> bool:
    """Whether a path exists and is write-protected, for everybody or for this user."""
    try:
        return not (os.stat(path).st_mode & WRITABLE and os.access(path, os.W_OK))
    except OSError:
        return False


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """A file beside `path` to write. It gets the name `path` when the block succeeds, and is removed when it fails.

    The file beside has the same suffix. If `path` is a link, the file that the link names is replaced. A device or a
    pipe is written directly. The folder must exist. A read-only file is not replaced. Raises OSError that names `path`.
    """
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
            problem.filename = str(path)
            problem.filename2 = None
        raise


@contextmanager
def whole_folder(folder: Path) -> Iterator[None]:
    """Make a folder for the block. If the block raises InputError, everything new is removed. Any other exception keeps
    the files, because measurements may be valuable, and removes empty new folders."""
    made = [place for place in (folder, *folder.parents) if not place.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    before = set(folder.rglob("*"))
    try:
        yield
    except BaseException as problem:
        new = set(folder.rglob("*")) - before
        for path in new if isinstance(problem, InputError) else ():
            if not path.is_dir():
                path.unlink()
        for place in sorted(new.union(made), reverse=True):
            with suppress(OSError):  # a file, or a folder that is not empty
                place.rmdir()
        raise


def write_text(path: Path, text: str) -> None:
    """Write a whole file and the folders above it. Raises InputError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as beside:
            beside.write_text(text, encoding="utf-8")
    except OSError as problem:
        raise InputError(f"cannot be written: {problem.strerror or problem}", file=path) from None


def lock(file: IO[Any]) -> bool:
    """Lock an open file until it is closed, or the process ends in any way. False: another process holds the lock."""
    try:
        import fcntl
    except ImportError:  # not on this system: no lock
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def save_at_hard_end(what: Any) -> None:
    """Call `what.save()` before a watchdog ends the process, in another thread than the one that hangs.

    Only a weak reference is kept."""
    _open.add(what)


def end_process(status: int) -> NoReturn:
    """Save what can be saved, each object within SAVE_S, and end the process at once."""
    for what in list(_open):
        saver = threading.Thread(target=_save, args=(what,), daemon=True)
        saver.start()
        saver.join(SAVE_S)
    os._exit(status)


def _save(what: Any) -> None:
    with suppress(Exception):  # the process ends for another reason, which has been reported
        what.save()
