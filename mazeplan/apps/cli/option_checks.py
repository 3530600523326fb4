"""Checks of the values in a command line: numbers, folders, files.

A check runs while typer reads the command line, before any work begins. One rule holds for all outputs: an output
replaces a file only with --force, and never an input of the same command. An option for a new file or folder has
`callback=new_file` or `new_folder`, and its command has `force: Force`; then `check_outputs` compares all paths.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from typer import BadParameter, CallbackParam, Context

from mazeplan.core.errors import InputError
from mazeplan.core.whole_file import in_dev, is_stream

PATHS = {"DIR", "FILE", "FOLDER", "INPUT", "LOG", "MAP", "MODEL", "OUT", "RIG", "TREE"}  # metavars of files, folders
_OUTPUTS = "mazeplan.outputs"


def number(least: float, most: float) -> Callable[[str], float]:
    """Parser of a number from `least` to `most`."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not least <= value <= most:
            raise BadParameter(f"got {str(text)!r}, expected a number from {least:g} to {most:g}")
        return value

    return parse


def ring(text: str) -> int:
    """Parser of a ring that has a channel: 2, or ring2."""
    number = text.lower().removeprefix("ring")
    if not (number.isdecimal() and number.isascii() and int(number) >= 1):
        raise BadParameter(f"got {text!r}, expected a ring such as ring2")
    return int(number)


def folder(text: str) -> Path:
    """Parser of a folder to write into."""
    path = Path(text).absolute()
    place = next(place for place in (path, *path.parents) if place.exists())
    if not text or not place.is_dir() or not os.access(place, os.W_OK):
        raise BadParameter(f"got {text!r}, expected a folder that can be made or written to")
    return Path(text)


def file(*endings: str, chosen: bool = False) -> Callable[[str], Path]:
    """Parser of a file to write, with one of the endings.

    chosen: whether the ending selects what is written; otherwise names in /dev need no ending"""

    def parse(text: str) -> Path:
        path = Path(text)
        if path.is_dir() or (path.suffix.lower() not in endings and (chosen or not in_dev(path))):
            raise BadParameter(f"got {text!r}, expected a file that ends in {', '.join(endings)}")
        folder(str(path.parent))
        return path

    return parse


def check_new(option: str, path: Path, force: bool, *, folder: bool = False) -> None:
    """Raises InputError for a file that exists, or a folder with files that are not hidden, unless `force` is true.

    Devices and pipes, such as /dev/null, may always be written."""
    if folder:
        there = path.is_dir() and any(not name.startswith(".") for name in os.listdir(path))
    else:
        there = os.path.lexists(path) and not is_stream(path)
    if there and not force:
        what = "files in it" if folder else "it"
        raise InputError(f"{option}: {path} exists; expected a new name, or --force to replace {what}")


def new_file(ctx: Context, param: CallbackParam, value: Any) -> Any:
    """Check of the file that a command writes: it must be new, unless --force is given. Raises InputError."""
    return _new(ctx, param, value, folder=False)


def new_folder(ctx: Context, param: CallbackParam, value: Any) -> Any:
    """Check of the folder that a command writes: new or empty, unless --force is given. Raises InputError."""
    return _new(ctx, param, value, folder=True)


def _new(ctx: Context, param: CallbackParam, path: Path | None, *, folder: bool) -> Path | None:
    if path is not None:
        ctx.meta.setdefault(_OUTPUTS, set()).add(param.name)  # for `check_outputs`
        check_new(min(param.opts, key=len), path, bool(ctx.params.get("force")), folder=folder)
    return path


def check_outputs(ctx: Context) -> None:
    """Raises InputError for an output that is also another file of the command line, even under another name."""
    outputs, named = ctx.meta.get(_OUTPUTS, ()), list[tuple[str, str, Path]]()
    for param in ctx.command.params:
        metavar, name = str(getattr(param, "metavar", "")).partition(" ")[0], param.name or ""
        value = ctx.params.get(name)
        for text in value if isinstance(value, list | tuple) else [value]:
            if metavar in PATHS and text:
                option = metavar if param.param_type_name == "argument" else min(param.opts, key=len)
                named.append((name, option, Path(text)))
    for output, option, path in named:
        for name, other, path2 in named if output in outputs and not is_stream(path) else ():
            if name != output and os.path.realpath(path2) == os.path.realpath(path):
                raise InputError(f"{option}: {path} is the file of {other}, too; expected another name")


def listed(values: Iterable[str] | None) -> tuple[str, ...]:
    """The names of a repeatable option. Each value may have several names, separated by commas."""
    return tuple(name.strip() for text in values or () for name in text.split(","))
