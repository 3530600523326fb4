"""Imports Python modules of users. A module is found as by `python -m`, so also in the current folder, or beside a file
that names it."""

from __future__ import annotations

import importlib
import os
import sys
import traceback
from pathlib import Path
from types import ModuleType

from mazeplan.core.errors import InputError


def user_module(name: str, option: str, folder: Path | None = None) -> ModuleType:
    """Import a module. Raises InputError, which begins with the option and names the place of the fault.

    folder: folder of the file that names the module; a module in it comes first."""
    if name.endswith(".py"):
        raise InputError(f"{option}: got {name!r}, expected the module's name without .py: {Path(name).stem}")
    if not all(part.isidentifier() for part in name.split(".")):
        raise InputError(f"{option}: got {name!r}, expected the name of a Python module, such as my_module")
    here = os.getcwd()
    if here not in sys.path:
        sys.path.insert(0, here)
    place, top = None if folder is None else folder.resolve(), name.partition(".")[0]
    beside = [] if place is None else [place / f"{top}.py", place / top / "__init__.py"]
    if str(place) not in sys.path and any(file.is_file() for file in beside):  # else it is installed
        sys.path.insert(0, str(place))
        importlib.invalidate_caches()
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as problem:
        if problem.name is not None and (problem.name == name or name.startswith(f"{problem.name}.")):
            none = f"there is none of that name in {here} or installed"
            raise InputError(f"{option}: module {name!r} cannot be imported: {none}") from None
        raise InputError(f"{option}: module {name!r} cannot be imported: {reason(problem)}") from None
    except (Exception, SystemExit) as problem:  # whatever a user's code does at import
        raise InputError(f"{option}: module {name!r} cannot be imported: {reason(problem)}") from None


def reason(problem: BaseException) -> str:
    """One line about an exception, with the innermost place outside of libraries, or the place of a syntax error."""
    frames = [frame for frame in traceback.extract_tb(problem.__traceback__) if "importlib" not in frame.filename]
    frames = [frame for frame in frames if "site-packages" not in frame.filename] or frames
    where = f"{frames[-1].filename}:{frames[-1].lineno}: " if len(frames) > 1 else ""
    if isinstance(problem, SyntaxError) and problem.filename:
        where = f"{problem.filename}:{problem.lineno}: "
        problem = SyntaxError(problem.msg)
    return where + " ".join(f"{type(problem).__name__}: {problem}".split())
