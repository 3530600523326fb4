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
"""

from __future__ import annotations

from pathlib import Path
from typing import Any


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
        self.problem, self.file, self.line, self.key = problem, file, line, key
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
