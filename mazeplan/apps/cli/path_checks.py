"""Checks of all files and folders that a command line names, together, before the command begins.

- Each may be used, and is a file or a folder: a named pipe would wait for ever.
- Nothing that is written is read or written by another option, also by another name (links). A log is given once,
  but for `view`.
- A file that is read-only is not replaced.

`new_file`, `new_folder` and `renewed` (option_checks) note what is written."""

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
NEW, RENEWED = "new", "renewed"  # what an option does with its file, if it writes it
_WRITES = "mazeplan.writes"


class _Named(NamedTuple):
    """A file or folder of the command line. option: its option, or its name in the help; writes: NEW, RENEWED or '';
    metavar: its kind in the help."""

    option: str
    path: Path
    writes: str
    metavar: str


def note_written(ctx: Any, param: Any, how: str) -> None:
    """Note that an option names what its command writes. how: NEW or RENEWED."""
    ctx.meta.setdefault(_WRITES, {})[param.name] = how


def check_paths(ctx: Any) -> None:
    """Look at each file and folder of a command line that was read. Raises InputError."""
    named = list(_named(ctx))
    for one in named:
        _check_kind(one)
    for one, other in combinations(named, 2):
        _check_apart(one, other)


def unusable(problem: OSError, path: str | Path) -> InputError:
    """The error for a path that the system refuses: no right to enter its folder, a name too long."""
    return InputError(f"cannot be used: {problem.strerror}; expected a file or folder that you may use", file=path)


def unreadable(path: str | Path) -> InputError:
    """The error for a file that may not be read."""
    problem = f"cannot be read: {os.strerror(errno.EACCES)}; expected a file that you may read"
    return InputError(f"{problem}: chmod u+r {shlex.quote(str(path))}", file=path)


def _check_kind(one: _Named) -> None:
    """Raises InputError for a path that may not be used, that is no file, or that may not be written to."""
    try:
        mode = os.stat(one.path).st_mode
    except (FileNotFoundError, NotADirectoryError, ValueError):  # a new file, a bare name; a zero byte
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
    """Raises InputError for a log that is given twice, and a file that is written and another option's as well."""
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
    """Whether two names mean the same file, by links, too; both may be new. copies: or files with the same content."""
    if os.path.exists(one) and os.path.exists(other):
        files = copies and one.is_file() and other.is_file()
        return os.path.samefile(one, other) or (files and filecmp.cmp(one, other, shallow=False))
    return os.path.realpath(one) == os.path.realpath(other)


def _holds(folder: Path, path: Path) -> bool:
    """Whether a file is in a folder, other than that in which the program runs and those above it."""
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
