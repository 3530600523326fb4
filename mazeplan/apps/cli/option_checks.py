"""Checks of the values in a command line: numbers, folders, files.

A check runs while typer reads the command line, before any work begins. An option for a new file or folder has
`callback=new_file` or `new_folder`, and its command has `force: Force`. So a command overwrites files only with
--force. An option for a file that the command continues has `callback=renewed`. `path_checks` then checks all paths.
"""

from __future__ import annotations

import math
import os
import re
import shlex
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from typer import BadParameter, CallbackParam, Context

from mazeplan.apps.cli.output import check_new, free_name, say
from mazeplan.apps.cli.path_checks import NEW, RENEWED, note_written
from mazeplan.core.errors import InputError
from mazeplan.core.field_checks import unit_hint
from mazeplan.core.whole_file import in_dev

NEEDS = (  # an option, and the option without which it has no effect, in each command that has both
    ("--host", "--view"), ("--port", "--view"), ("--groot-host", "--groot"), ("--place", "--rings"),
    ("-o", "--learn"), ("--corners", "--boards"), ("--square-mm", "--boards"),
    ("--from", "--route"), ("--to", "--route"), ("--start-angle", "--route"), ("--close", "--route"),
)  # fmt: skip
APART = (
    ("-o", "--into"),
    ("-o", "--minari"),
    ("--markdown", "--json"),
    ("--grid", "--readings"),
    *((option, "--sheet") for option in ("--boards", "--plate", "--circles", "--dry-run", "--json")),
)  # pairs of options; the second would hide the effect of the first


def check_effect(ctx: Context) -> None:
    """Raises InputError for an option in the command line that would have no effect."""
    params, given = _options(ctx), given_options(ctx)
    for option, other in NEEDS:
        if option in given and other in params and other not in given:
            raise no_effect(option, other)
    for option, other in APART:
        if option in given and other in given:
            raise InputError(f"got {other} as well, expected one of the two", key=option)


def given_options(ctx: Context) -> set[str]:
    """The options that stand in the command line, in their shortest spelling."""
    sources = {option: ctx.get_parameter_source(name) for option, name in _options(ctx).items()}
    return {option for option, source in sources.items() if source is not None and source.name == "COMMANDLINE"}


def given_words(ctx: Context) -> dict[str, str]:
    """The options of a command line as a person would type them again, for advice. Each begins with a space."""
    given, words = given_options(ctx), dict[str, str]()
    for option, name in _options(ctx).items():
        value = ctx.params.get(name)
        if option in given and option.startswith("-") and value not in (None, False):
            values = value if isinstance(value, list | tuple) else [value]
            words[option] = "".join(f" {option}{_typed(one)}" for one in values)
    return words


def _typed(value: Any) -> str:
    """A value after its option; nothing for a flag."""
    if value is True:
        return ""
    return " " + shlex.quote(f"{value:g}" if isinstance(value, float) else str(value))


def _options(ctx: Context) -> dict[str, str]:
    """{option or argument of a command: name of its parameter}."""
    return {min(param.opts, key=len): param.name or "" for param in ctx.command.params}


def no_effect(option: str, what: str) -> InputError:
    """The error for an option that has no effect without something else. what: what it needs"""
    return InputError(f"needs {what}; without it the option has no effect", key=option)


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
            hint = unit_hint(value, {"degrees": "deg"}.get(unit, unit), low, most)
            raise BadParameter(f"got {text}, expected {wanted}{f' {unit}' if unit else ''}{hint}")
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


def folder_of_report(text: str) -> Path:
    """Parser of a folder for a report, which has a fixed file name in it."""
    if Path(text).suffix.lower() == ".html" and not Path(text).is_dir():
        raise BadParameter(f"got {str(text)!r}, the name of a file, expected a folder")
    return folder(text)


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

    Without a name in the command line, the default name is used, or the next free name (maze-2.png). Raises
    InputError."""
    force = bool(ctx.params.get("force"))
    note_written(ctx, param, NEW)
    if value is None or value == "-":
        return value
    source = ctx.get_parameter_source(param.name or "")
    if source is not None and source.name == "DEFAULT" and not force:
        free = free_name(value)
        if free != value:
            say(f"{value} exists: {free} will be written")
        return free
    check_new(min(param.opts, key=len), Path(value), force)
    return value


def new_folder(ctx: Context, param: CallbackParam, value: Path | None) -> Path | None:
    """Check of the folder that a command writes: new or empty, unless --force is given. Raises InputError."""
    note_written(ctx, param, NEW)
    if value is not None:
        check_new(min(param.opts, key=len), value, bool(ctx.params.get("force")), folder=True)
    return value


def renewed(ctx: Context, param: CallbackParam, value: Any) -> Any:
    """Check of a file or folder that a command reads and renews: it needs no --force."""
    note_written(ctx, param, RENEWED)
    return value


def listed(values: Iterable[str] | None) -> tuple[str, ...]:
    """The names of a repeatable option. Each value may have several names, separated by commas."""
    return tuple(name.strip() for text in values or () for name in text.split(","))


def listed_rings(values: Iterable[str] | None, option: str) -> tuple[str, ...]:
    """The same as `listed`, for rings. Raises InputError for rings without commas between them."""
    rings = listed(values)
    for name in rings:
        found = re.findall(r"ring ?[0-9]+|centre|center", name.lower())
        if len(found) > 1:
            raise InputError(f"got {name!r}, expected {','.join(found)}: separate rings by commas", key=option)
    return rings


def ring(text: str) -> int:
    """Parser of a ring that has a channel: 2, or ring2."""
    number = text.lower().removeprefix("ring")
    if not (number.isdecimal() and number.isascii() and int(number) >= 1):
        raise BadParameter(f"got {text!r}, expected a ring such as ring2")
    return int(number)
