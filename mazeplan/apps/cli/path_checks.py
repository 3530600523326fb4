"""Checks all files and folders of a command line together, before the command begins.

- The program may use each path, and the path is a file or folder. Reading a named pipe would wait for ever.
- No option reads or writes a file that another option writes, also under another name (links).
- Each log is given once, except for `view`.
- The command does not replace a read-only file.

`new_file`, `new_folder` and `renewed` (option_checks) record which options write."""

from __future__ import annotations

import errno
import filecmp
import os
import shlex
import stat
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

from mazeplan.core.errors import InputError
from mazeplan.core.whole_file import in_dev, is_stream, read_only

METAVARS = {"DIR", "FILE", "FOLDER", "INPUT", "LOG", "MAP", "MODEL", "OUT", "RIG", "TREE"}  # of files and folders
NEW, RENEWED = "new", "renewed"  # an option writes a new file, or reads and renews a file
_WRITES = "mazeplan.writes"


class _Named(NamedTuple):
    """A file or folder of the command line.

    option: its option, or the name of its argument in the help
    writes: NEW, RENEWED or ''
    metavar: its kind in the help"""

    option: str
    path: Path
    writes: str
    metavar: str


def note_written(ctx: Any, param: Any, how: str) -> None:
    """Record that an option names a file or folder that its command writes. how: NEW or RENEWED"""
    ctx.meta.setdefault(_WRITES, {})[param.name] = how


def check_paths(ctx: Any) -> None:
    """Check each file and folder of a parsed command line. Raises InputError."""
    named = list(_named(ctx))
    for one in named:
        _check_kind(one)
    for one, other in combinations(named, 2):
        _check_apart(one, other)


def unusable(problem: OSError, path: str | Path) -> InputError:
    """The error for a path that the system refuses, because its folder may not be entered or its name is too long."""
    return InputError(f"cannot be used: {problem.strerror}; expected a file or folder that you may use", file=path)


def unreadable(path: str | Path) -> InputError:
    """The error for a file that the program may not read."""
    problem = f"cannot be read: {os.strerror(errno.EACCES)}; expected a file that you may read"
    return InputError(f"{problem}: chmod u+r {shlex.quote(str(path))}", file=path)


def _check_kind(one: _Named) -> None:
    """Raises InputError for a path that the system refuses, that is no file or folder, or that is read-only."""
    try:
        mode = os.stat(one.path).st_mode
    except (FileNotFoundError, NotADirectoryError, ValueError):  # a new file, a bare name, or a zero byte in the name
        return
    except OSError as problem:
        raise unusable(problem, one.path) from None
    if stat.S_ISREG(mode) or stat.S_ISDIR(mode):
        if one.writes and read_only(one.path):
            raise InputError(f"{one.option}: {one.path} is read-only; expected a file or folder that may be written to")
    elif not one.writes:
        raise InputError(f"{one.option}: {one.path} is a device or pipe; expected a file")
    elif stat.S_ISFIFO(mode) and not in_dev(one.path):
        raise InputError(f"{one.option}: {one.path} is a named pipe; expected a file, or /dev/stdout")


def _check_apart(one: _Named, other: _Named) -> None:
    """Raises InputError for a log that is given twice, and for a written file that another option names, too."""
    if not one.writes:
        one, other = other, one
    if one.metavar == other.metavar == "LOG" and not one.writes and _same(one.path, other.path, copies=True):
        again = f"{one.option}: {one.path} is given again as {other.option} {other.path}"
        raise InputError(f"{again}; expected each log once")
    if not one.writes or is_stream(one.path):
        return
    same = _same(one.path, other.path)
    if other.writes and same:
        raise InputError(f"{one.option}: {one.path} is the file of {other.option}, too; expected two names")
    if one.writes == NEW and not other.writes and (same or _holds(one.path, other.path)):
        is_it = "is" if same else f"holds {other.path}, the file of"
        raise InputError(f"{one.option}: {one.path} {is_it} {other.option}, which is read; expected another name")


def _same(one: Path, other: Path, *, copies: bool = False) -> bool:
    """Whether two names mean the same file, also through links. Both may be new.

    copies: whether files with the same content count as the same file"""
    if os.path.exists(one) and os.path.exists(other):
        files = copies and one.is_file() and other.is_file()
        return os.path.samefile(one, other) or (files and filecmp.cmp(one, other, shallow=False))
    return os.path.realpath(one) == os.path.realpath(other)


def _holds(folder: Path, path: Path) -> bool:
    """Whether a file is in a folder. The current folder and the folders above it do not count."""
    inside, here = Path(os.path.realpath(folder)), Path.cwd()
    return path.is_file() and inside in Path(os.path.realpath(path)).parents and inside not in (here, *here.parents)


def _named(ctx: Any) -> Iterator[_Named]:
    """The files and folders among the parameters of a command."""
    for param in ctx.command.params:
        metavar = (getattr(param, "metavar", None) or "").partition(" ")[0]
        if metavar in METAVARS:
            option = metavar if param.param_type_name == "argument" else min(param.opts, key=len)
            writes, value = ctx.meta.get(_WRITES, {}).get(param.name, ""), ctx.params.get(param.name)
            for text in value if isinstance(value, list | tuple) else [value]:
                if text not in (None, "", "-"):
                    yield _Named(option, Path(text), writes, param.metavar)
