"""Checks of all files and folders that a command line names, together, before the command begins."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from mazeplan.core.errors import InputError

METAVARS = {"DIR", "FILE", "FOLDER", "INPUT", "LOG", "MAP", "MODEL", "OUT", "RIG", "TREE"}  # of files and folders


class _Named(NamedTuple):
    """A file or folder of the command line. option: its option, or its name in the help."""

    option: str
    path: Path


def check_paths(ctx: Any) -> None:
    """Look at each file and folder of a command line that was read. Raises InputError."""
    for named in _named(ctx):
        try:
            os.stat(named.path)
        except (FileNotFoundError, NotADirectoryError, ValueError):  # a new file, a bare name; a zero byte
            continue
        except OSError as problem:
            raise unusable(problem, named.path) from None


def unusable(problem: OSError, path: str | Path) -> InputError:
    """The error for a path that the system refuses: no right to enter its folder, a name too long."""
    return InputError(f"cannot be used: {problem.strerror}; expected a file or folder that you may use", file=path)


def _named(ctx: Any) -> Iterator[_Named]:
    """The files and folders among the parameters of a command."""
    for param in ctx.command.params:
        metavar = (getattr(param, "metavar", None) or "").partition(" ")[0]
        if metavar in METAVARS:
            option = metavar if param.param_type_name == "argument" else min(param.opts, key=len)
            value = ctx.params.get(param.name)
            for text in value if isinstance(value, list | tuple) else [value]:
                if text not in (None, "", "-"):
                    yield _Named(option, Path(text))
