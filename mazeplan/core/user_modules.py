"""Imports Python modules of users. A module is found as by `python -m`, so also in the current folder, or beside a file
that names it."""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path
from types import ModuleType

from mazeplan.core.errors import InputError, reason


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
