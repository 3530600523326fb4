"""Every exception the program raises on purpose.

    MazeplanError                  exit status
    ├── InputError                 2   something that a person wrote is wrong
    │   ├── MapError                   a maze map (YAML)
    │   ├── SettingsError              rig or controller settings (YAML, keyword)
    │   ├── ModelError                 a fitted or hand-written model folder
    │   ├── TreeError                  a behaviour tree (XML)
    │   ├── TableError                 a table of measurements (CSV)
    │   └── LogError                   a run log (MCAP)
    └── RigError                   3   the machine failed: serial, camera, watchdog

A run that does not succeed raises no exception. Its failure is a value, `records.Failure`, for which the behaviour tree
chooses a recovery. Any other exception that escapes is a bug.

Below stand words for messages: hints at the name that was probably meant, and the place of an exception.
"""

from __future__ import annotations

import difflib
import traceback
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

LEAST = 0.6  # minimum similarity of a guess: difflib's ratio, 1 for the same name
MOST = 200  # maximum number of names for a guess; with more, a guess takes too long


class MazeplanError(Exception):
    """Root of all deliberate errors; `exit_status` is what the command line returns for it."""

    exit_status = 1


class InputError(MazeplanError):
    """Something that a person wrote is wrong. The message is one line: file, place, what was got, what is allowed.

    others: further errors that the same check found."""

    exit_status = 2
    others: tuple[InputError, ...] = ()

    def __init__(
        self, problem: str, *, file: str | Path | None = None, line: int | None = None, key: str | None = None
    ) -> None:
        self.problem = problem
        self.file = file
        self.line = line
        self.key = key
        where = "" if file is None else f"{file}:" if line is None else f"{file}:{line}:"
        super().__init__(" ".join(part for part in (where, f"{key}:" if key else "", problem) if part))


class MapError(InputError):
    """A maze map that cannot be used."""


class SettingsError(InputError):
    """Settings of a rig or controller that cannot be used."""


class ModelError(InputError):
    """A model folder that cannot be used."""


class TreeError(InputError):
    """A behaviour tree that cannot be used."""


class TableError(InputError):
    """A table of measurements that cannot be used."""


class LogError(InputError):
    """A run log that cannot be used."""


class ShortWarning(UserWarning):
    """A warning that a command prints as one line on stderr, and then goes on."""


class RigError(MazeplanError):
    """The machine failed: serial line, camera, watchdog.

    result: the `records.NavigationResult` up to the failure, if a run was under way."""

    exit_status = 3
    result: Any = None


def nearest(got: object, names: Iterable[str], least: float = LEAST) -> str | None:
    """The known name that `got` probably misspells; None without a similar name, or if `got` is a known name."""
    known = {name.lower().replace("-", "_").replace(" ", "_"): name for name in names}
    if not isinstance(got, str) or got in known.values() or len(known) > MOST:
        return None
    found = difflib.get_close_matches(got.lower().replace("-", "_").replace(" ", "_"), known, 1, least)
    return known[found[0]] if found else None


def guess(got: object, names: Iterable[str]) -> str:
    """End of a message about an unknown name: `; did you mean dry_friction?`, or nothing."""
    near = nearest(got, names)
    return "" if near is None else f"; did you mean {near}?"


def one_of(names: Iterable[str], got: object = None, more: str = "") -> str:
    """`one of a, b, c`, and a guess which of these names `got` misspells.

    more: what else is allowed, such as ", or a file"; it comes before the guess."""
    known = list(names)
    return f"one of {', '.join(known) or 'none'}{more}{guess(got, known)}"


def unknown_keys_first(errors: Sequence[Any]) -> list[Any]:
    """The errors of a pydantic ValidationError, in another order: unknown keys come first where the same section lacks
    a key. A misspelled key causes both errors; only its name shows the mistake."""
    lacking = {error["loc"][:-1] for error in errors if error["type"] == "missing"}
    return sorted(errors, key=lambda e: not (e["type"] == "extra_forbidden" and e["loc"][:-1] in lacking))


def reason(problem: BaseException) -> str:
    """One line about an exception, with the innermost place outside of libraries, or the place of a syntax error."""
    frames = [frame for frame in traceback.extract_tb(problem.__traceback__) if "importlib" not in frame.filename]
    frames = [frame for frame in frames if "site-packages" not in frame.filename] or frames
    where = f"{frames[-1].filename}:{frames[-1].lineno}: " if len(frames) > 1 else ""
    if isinstance(problem, SyntaxError) and problem.filename:
        where = f"{problem.filename}:{problem.lineno}: "
        problem = SyntaxError(problem.msg)
    return where + " ".join(f"{type(problem).__name__}: {problem}".split())
