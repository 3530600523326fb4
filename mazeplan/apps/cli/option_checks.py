"""Checks of the values in a command line: numbers, folders, files.

A check runs while typer reads the command line, before any work begins. One rule holds for all outputs: an output
replaces a file only with --force, and never an input of the same command. An option for a new file or folder has
`callback=new_file` or `new_folder`, and its command has `force: Force`; then `check_outputs` compares all paths.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from typer import BadParameter, CallbackParam, Context

from mazeplan.apps.cli.output import check_new
from mazeplan.core.errors import InputError
from mazeplan.core.whole_file import in_dev, is_stream

PATHS = {"DIR", "FILE", "FOLDER", "INPUT", "LOG", "MAP", "MODEL", "OUT", "RIG", "TREE"}  # metavars of files, folders
_OUTPUTS = "mazeplan.outputs"


def number(
    unit: str = "", *, positive: bool = True, least: float = -math.inf, most: float = math.inf
) -> Callable[[str], float]:
    """Parser of a finite number.

    positive: whether it has to be greater than 0
    least, most: minimum and maximum"""
    low = max(least, 0.0) if positive else least
    expected = "a finite number" + " > 0" * positive + (f" of {unit}" if unit else "")

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or (positive and value <= 0.0):
            raise BadParameter(f"got {str(text)!r}, expected {expected}")
        if not low <= value <= most:
            wanted = f"{low:g} to {most:g}"
            if math.inf in (-low, most):
                wanted = f"at most {most:g}" if low == -math.inf else f"at least {low:g}"
            raise BadParameter(f"got {text}, expected {wanted}{f' {unit}' if unit else ''}")
        return value

    return parse


def folder_problem(folder: Path) -> str:
    """Why a folder can neither be made nor written to; empty if it can."""
    place = next(place for place in (folder.absolute(), *folder.absolute().parents) if place.exists())
    if place.is_dir() and os.access(place, os.W_OK):
        return ""
    why = "may not be written to" if place.is_dir() else "is a file"
    return f"got {folder}, but {place} {why}; expected a folder that can be made or written to"


def folder(text: str) -> Path:
    """Parser of a folder to write into."""
    problem = folder_problem(Path(text)) if str(text) else "got '', expected a folder"
    if problem:
        raise BadParameter(problem)
    return Path(text)


def file(*endings: str, chosen: bool = False) -> Callable[[str], Path]:
    """Parser of a file to write, with one of the endings.

    chosen: whether the ending selects what is written; otherwise names in /dev need no ending"""

    def parse(text: str) -> Path:
        path = Path(text)
        problem = folder_problem(path.absolute().parent)
        wrong = endings and path.suffix.lower() not in endings and (chosen or not in_dev(path))
        if wrong or path.is_dir():
            what = ", a folder" if path.is_dir() else ""
            ends = f" that ends in {', '.join(endings)}" if endings else ""
            problem = f"got {str(path)!r}{what}, expected a file{ends}"
        if problem:
            raise BadParameter(problem)
        return path

    return parse


def file_or_stdout(*endings: str) -> Callable[[str], str]:
    """Parser of a file to write, with one of the endings, or - for stdout."""
    parse = file(*endings)
    return lambda text: text if text == "-" else str(parse(text))


def new_file(ctx: Context, param: CallbackParam, value: Any) -> Any:
    """Check of the file that a command writes: it must be new, unless --force is given. - is stdout.

    Raises InputError."""
    if value is not None and value != "-":
        check_new(_note_output(ctx, param), Path(value), bool(ctx.params.get("force")))
    return value


def new_folder(ctx: Context, param: CallbackParam, value: Path | None) -> Path | None:
    """Check of the folder that a command writes: new or empty, unless --force is given. Raises InputError."""
    if value is not None:
        check_new(_note_output(ctx, param), value, bool(ctx.params.get("force")), folder=True)
    return value


def _note_output(ctx: Context, param: CallbackParam) -> str:
    """Record that an option names an output, for `check_outputs`. Returns the option."""
    ctx.meta.setdefault(_OUTPUTS, set()).add(param.name)
    return min(param.opts, key=len)


def check_outputs(ctx: Context) -> None:
    """Raises InputError for an output that is also another file of the command line, even under another name."""
    named = list(_named_paths(ctx))
    for output, path, is_output in named:
        for option, other, _ in named if is_output and not is_stream(path) else ():
            if option != output and os.path.realpath(other) == os.path.realpath(path):
                raise InputError(f"{output}: {path} is the file of {option}, too; expected another name")


def _named_paths(ctx: Context) -> Iterator[tuple[str, Path, bool]]:
    """(option or name of an argument, path, whether it is an output) of the files in a command line."""
    for param in ctx.command.params:
        metavar = (getattr(param, "metavar", None) or "").partition(" ")[0]
        value = ctx.params.get(param.name or "")
        for text in value if isinstance(value, list | tuple) else [value]:
            if metavar in PATHS and text not in (None, "", "-"):
                option = metavar if param.param_type_name == "argument" else min(param.opts, key=len)
                yield option, Path(text), param.name in ctx.meta.get(_OUTPUTS, ())


def listed(values: Iterable[str] | None) -> tuple[str, ...]:
    """The names of a repeatable option. Each value may have several names, separated by commas."""
    return tuple(name.strip() for text in values or () for name in text.split(","))


def ring(text: str) -> int:
    """Parser of a ring that has a channel: 2, or ring2."""
    number = text.lower().removeprefix("ring")
    if not (number.isdecimal() and number.isascii() and int(number) >= 1):
        raise BadParameter(f"got {text!r}, expected a ring such as ring2")
    return int(number)
